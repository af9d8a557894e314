"""What a benchmark measured as a page to read: `report.md` beside its JSON."""

import shutil
from pathlib import Path

from experiments.errors import ConfigError
from experiments.reporting.documents.kept_tables import read_kept
from experiments.reporting.pages.markdown import tables_markdown
from experiments.running.finished import RESULTS
from experiments.running.results_folder import write_whole

MARKDOWN = "report.md"


def keep_benchmark(measured: Path, kept: Path) -> Path:
    """Copies the JSON of `python -m experiments benchmark --out`, and writes its page.

    Args:
        measured: The file NAME.json.
        kept: Holds the folders of kept results; the file goes to that of its name.

    Returns:
        The folder.

    Raises:
        ConfigError: There is no such file, it is damaged, or a suite is kept under its name.
    """
    if not measured.is_file():
        raise ConfigError(f"{measured}: there is no such file")
    read_kept(measured)
    folder = kept / measured.stem
    if (folder / RESULTS).exists():
        raise ConfigError(f"{folder} holds the results of a suite; give {measured.name} another name")
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / measured.name
    if target.resolve() != measured.resolve():
        shutil.copyfile(measured, target)
    write_page(target, folder / MARKDOWN)
    return folder


def write_page(measured: Path, page: Path) -> None:
    """Writes the tables of a kept JSON file as Markdown.

    Raises:
        ConfigError: The file is damaged.
    """
    tables, _, commit = read_kept(measured)
    parts = [f"# {measured.parent.name}", f"Code of commit {commit}."]
    for table in tables:
        parts += [f"## {table.title}", *tables_markdown([table])]
    write_whole(page, "\n\n".join(parts) + "\n")
