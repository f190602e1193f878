"""The built pages: lists are lists, names and numbers break at good places, and nothing comes from the network."""

from __future__ import annotations

import re
from pathlib import Path

import markdown
import pytest
import yaml
from docs.page_hooks import on_page_content

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").rglob("*.md"))
EXTENSIONS = ["admonition", "attr_list", "tables", "toc", "pymdownx.highlight", "pymdownx.superfences"]  # those of mkdocs.yml


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lists_are_lists(page):
    """A list directly after a paragraph, or after a paragraph that is not indented by four, becomes a part of it."""
    built = markdown.markdown(page.read_text(), extensions=EXTENSIONS)
    assert re.findall(r"<p>(?:(?!</p>).)*?\n *- ", built, re.S) == []
