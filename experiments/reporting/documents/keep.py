"""Keeping a suite's results in the repository: numbers, report and figures, small enough for it."""

import shutil
from pathlib import Path

from PIL import Image

from experiments.errors import ConfigError
from experiments.reporting.report import SUMMARY, write_report
from experiments.reporting.results_file import RESULTS, TIMES, read_finished

COLOURS = 64
"""Of a kept figure. Choice: no difference is seen, and files are a third as large."""


def keep(out: Path, kept: Path) -> Path:
    """Copies what was made of a finished suite.

    Args:
        out: The results folder of the suite.
        kept: Holds the folders of kept results; that of the suite is replaced.

    Returns:
        The suite's folder there.

    Raises:
        ConfigError: Runs are missing, or files differed from the commit that the results name.
    """
    finished = read_finished(out / RESULTS, out)
    if finished.unfinished:
        missing = ", ".join(run.id for run in finished.unfinished[:3])
        raise ConfigError(f"{out}: {len(finished.unfinished)} runs are not finished, such as {missing}")
    commit = finished.versions["commit"]
    if "+" in commit or commit == "unknown":
        raise ConfigError(
            f"{out} was made by files that no commit has ({commit}); commit them, and run it again"
        )
    write_report(finished)
    target = kept / finished.suite.name
    shutil.rmtree(target, ignore_errors=True)
    (target / "figures").mkdir(parents=True)
    for name in (RESULTS, TIMES, SUMMARY, "report.md"):
        shutil.copyfile(out / name, target / name)
    for figure in sorted((out / "figures").glob("*.png")):
        with Image.open(figure) as image:
            image.convert("RGB").quantize(COLOURS).save(target / "figures" / figure.name, optimize=True)
    return target
