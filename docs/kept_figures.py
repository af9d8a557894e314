"""Brings the kept figures of `experiments/results/` into the site, where pages link them by their path."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

KEPT = "experiments/results"
"""Where the figures are kept, and where they stand in the site."""
ROOT = Path(__file__).parents[1]


def on_files(files: Files, config: Any, **_: Any) -> Files:
    """Called by mkdocs with the pages; adds the figures."""
    for figure in sorted((ROOT / KEPT).rglob("*.png")):
        files.append(
            File.generated(config, figure.relative_to(ROOT).as_posix(), abs_src_path=str(figure)),
        )
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by mkdocs with every page; seen from the repository, figures lie one folder up."""
    return markdown.replace(f"](../{KEPT}/", f"]({KEPT}/")
