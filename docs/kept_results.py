"""Brings kept reports and figures of `experiments/results/` into the site, where pages link them by path."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

KEPT = "experiments/results"
"""Where they are kept, and where they stand in the site."""
ROOT = Path(__file__).parents[1]


def on_files(files: Files, config: Any, **_: Any) -> Files:
    """Called by mkdocs with the pages; adds reports and figures."""
    for pattern in ("*/report.md", "**/*.png"):
        for path in sorted((ROOT / KEPT).glob(pattern)):
            files.append(File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Called by mkdocs with every page.

    Seen from the repository, reports lie one folder further up than in the site. They are not searched: they
    are long. What they fold away is Markdown, too.
    """
    if page.file.src_uri.startswith(KEPT):
        page.meta["search"] = {"exclude": True}
        return re.sub(r"<(details|summary)>", r'<\1 markdown="1">', markdown)
    return re.sub(rf"\]\(((?:\.\./)*)\.\./{KEPT}/", rf"](\1{KEPT}/", markdown)
