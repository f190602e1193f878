"""Spelling of pages, docstrings and help: English, the glossary, plain words of public names, or
docs/spelling.txt.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from spellchecker import SpellChecker

ROOT = Path(__file__).parents[2]
LISTS = (ROOT / "docs" / "spelling.txt",)
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
CODE = re.compile(
    r"```.*?```|`[^`]*`|\]\([^)]*\)|<!--.*?-->|doi:\S+|^:::[^\n]*$|^    [^\n]*$|^[^\n]*\s>>>"
    r" [^\n]*$|\$[^$]*\$"
    r"|\b\w+(?:[./_:\\]\w+)+\b"
    r"|\b[A-Z][a-z]+(?:[A-Z]\w*)+",  # names of classes
    re.S | re.M,
)


@pytest.fixture(scope="module")
def known():
    words = {
        line.lower()
        for path in LISTS
        for line in path.read_text().splitlines()
        if not line.startswith("#")
    }
    glossary = set(re.findall(r"[a-zà-ÿ]+", (ROOT / "docs" / "glossary.md").read_text().lower()))
    english = SpellChecker(language="en").word_frequency.dictionary
    return lambda word: word in words or word in glossary or word in english


def strange(text, known):
    """Return the words that nobody knows; those of two letters are too often symbols."""
    words = (
        word.lower().removesuffix("'s")
        for word in re.findall(r"[A-Za-zÀ-ÿ]+(?:'[a-z]+)?", CODE.sub(" ", text))
    )
    return sorted(
        {
            word
            for word in words
            if len(word) > 2 and not known(word) and not known(word.removesuffix("s"))
        }
    )


def docstrings(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            text = ast.get_docstring(node) or ""
            # examples, and names with types
            yield re.sub(r"^(>>>|\.\.\.).*(\n(?!\n|>>>).*)*|^\S.* : .*$", "", text, flags=re.M)


def test_it_finds_a_mistake(known):
    assert strange("A partical in `freee` cells, a Viewpoint's way\n\n    its code", known) == [
        "partical"
    ]


def test_pages(known):
    found = {
        str(page.relative_to(ROOT)): words
        for page in PAGES
        if (words := strange(page.read_text(), known))
    }
    assert found == {}, "mend the spelling, or add the word to docs/spelling.txt"


def test_docstrings(known):
    found = {
        str(path.relative_to(ROOT)): words
        for path in sorted((ROOT / "src").rglob("*.py"))
        if (words := sorted({word for text in docstrings(path) for word in strange(text, known)}))
    }
    assert found == {}, "mend the spelling, or add the word to docs/spelling.txt"
