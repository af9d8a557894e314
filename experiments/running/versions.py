"""Which code and which packages made a result."""

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from experiments.config.own_agents import hash_of

REPOSITORY = Path(__file__).resolve().parents[2]
KEPT = REPOSITORY / "experiments" / "results"
UNKNOWN = "unknown"
"""The commit of code that is in no repository."""

PACKAGES = (
    "gymnasium",
    "mujoco",
    "numpy",
    "opencv-python-headless",
    "sb3-contrib",
    "stable-baselines3",
    "torch",
)

WHAT_MAKES_A_RESULT = (
    "calfree_gym",
    "agents",
    "configs/agents",
    "experiments/config",
    "experiments/evaluation.py",
    "experiments/running",
)
MAKES_REPORTS = ("calfree_gym", "agents", "experiments", ":(exclude)experiments/results", "configs")
"""Sources of results and reports, as git takes them; kept results are none."""


def versions(also: tuple[str, ...] = ()) -> dict[str, str]:
    """Versions of Python, of packages that results depend on, and of our code, with more of our sources."""
    found = {"code": _code(also), "python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def commit() -> str:
    """The commit of our code, with a "+" where its files differ or are new; "unknown" outside a repository.

    Kept results and documents are no code: they may differ, as where several are made anew one after the
    other.
    """
    git = ["git", "-C", str(REPOSITORY)]
    try:
        head = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True)
        changed = subprocess.run(
            [*git, "status", "--porcelain", "-uall", "--", *MAKES_REPORTS], capture_output=True, text=True
        )
    except OSError:
        return UNKNOWN
    return head.stdout.strip() + "+" * bool(changed.stdout.strip()) or UNKNOWN


def is_of_no_commit(name: str) -> bool:
    """Whether what `commit` found, or a folder says, is more or other than commits."""
    return "+" in name or UNKNOWN in name


def _code(also: tuple[str, ...]) -> str:
    """A hash over all our sources that can change a result; commits would miss edits."""
    return hash_of([REPOSITORY / root for root in (*WHAT_MAKES_A_RESULT, *also)], REPOSITORY)
