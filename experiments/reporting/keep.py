"""Keeping results in the repository: a suite's numbers, report and small figures, or a benchmark's JSON."""

import shlex
import shutil
from dataclasses import replace
from pathlib import Path

from PIL import Image

from experiments.errors import ConfigError
from experiments.reporting.finished_suite import FinishedSuite
from experiments.reporting.kept_tables import page_of, read_kept
from experiments.reporting.pages import MARKDOWN, PAGE
from experiments.reporting.report import SUMMARY, films_in, write_report
from experiments.reporting.results_file import RESULTS, TIMES, read_finished
from experiments.running.results_folder import FIGURES, write_whole
from experiments.running.versions import commit, is_of_no_commit, versions

COLOURS = 256
"""Of a kept figure. Choice: files are a third as large. Of 64, blue lines became as green ones."""


def keep(out: Path, kept: Path) -> Path:
    """Copies the numbers of a finished suite, and makes its report of them; returns its kept folder.

    Of the kept folder itself the report is made again, whichever code made the numbers. Its rows may be
    deleted, where a repository has no room for them.

    Raises:
        ConfigError: Runs are missing; the suite was changed by `--set`; files differed from the commit that
            the results name, or differ now; other code made the results; the suite's name is that of kept
            results of another kind.
    """
    finished = read_finished(out / RESULTS, out)
    target = kept / finished.suite.name
    _refuse(finished, target, again=out.resolve() == target.resolve())
    partial, old = (kept / f".{target.name}.{what}" for what in ("partial", "old"))
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for path in filter(Path.exists, (out / RESULTS, out / TIMES, *films_in(out))):
        shutil.copyfile(path, partial / path.name)
    write_report(replace(finished, out=partial))
    (partial / PAGE).unlink()
    for figure in sorted((partial / FIGURES).iterdir()):
        if figure.suffix == ".png":
            keep_figure(figure, figure)
        else:
            figure.unlink()
    shutil.rmtree(old, ignore_errors=True)
    if target.exists():
        target.rename(old)
    partial.rename(target)
    shutil.rmtree(old, ignore_errors=True)
    return target


def keep_figure(drawn: Path, target: Path) -> None:
    """Copies a figure, in few colours."""
    with Image.open(drawn) as image:
        small = fewer_colours(image)
    small.save(target, optimize=True)


def fewer_colours(image: Image.Image) -> Image.Image:
    """A figure in so few colours that its file is small; lines keep theirs."""
    return image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)


def _refuse(finished: FinishedSuite, target: Path, again: bool) -> None:
    out = finished.out
    if finished.unfinished:
        missing = ", ".join(run.id for run in finished.unfinished[:3])
        raise ConfigError(f"{out}: {len(finished.unfinished)} runs are not finished, such as {missing}")
    if "--set" in shlex.split(finished.command):
        raise ConfigError(
            f"{out} is of a suite changed by --set ({finished.command}); run the file as it stands"
        )
    made_by, here = finished.versions["commit"], commit()
    for whose, found in ((f"{out} was made by", made_by), ("this report would be made by", here)):
        _refuse_no_commit(whose, found)
    if (code := finished.versions["code"]) != (now := versions()["code"]) and not again:
        raise ConfigError(f"{out} was made by other code ({code}, here it is {now}); run it again")
    if target.exists() and not (target / SUMMARY).exists():
        raise ConfigError(
            f"{target} holds kept results that are no suite's ({SUMMARY} is missing); give the suite "
            "another name"
        )


def _refuse_no_commit(whose: str, found: str) -> None:
    if is_of_no_commit(found):
        raise ConfigError(f"{whose} files that no commit has ({found}); commit them, and run it again")


def keep_benchmark(measured: Path, kept: Path) -> Path:
    """Copies NAME.json and NAME.png, which `benchmark --out` wrote, and writes a page; returns the folder."""
    if not measured.is_file():
        raise ConfigError(f"{measured}: there is no such file")
    _refuse_no_commit(f"{measured} was made by", read_kept(measured)[2])
    folder = kept / measured.stem
    if (folder / SUMMARY).exists():
        raise ConfigError(f"{folder} holds the results of a suite; give {measured.name} another name")
    page = page_of(measured, folder.name)
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / measured.name
    if target.resolve() != measured.resolve():
        write_whole(target, measured.read_text(encoding="utf-8"))
        if (figure := measured.with_suffix(".png")).exists():
            keep_figure(figure, target.with_suffix(".png"))
    write_whole(folder / MARKDOWN, page)
    return folder
