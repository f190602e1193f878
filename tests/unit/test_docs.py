"""The documentation is true: its commands run, its links lead somewhere, its generated page is fresh.

The `>>>` examples of all pages are collected by pytest itself (--doctest-glob).
"""

from __future__ import annotations

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

import shoal
from shoal.cli import app, run

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
WITH_COMMANDS = [page for page in PAGES if "```console" in page.read_text()]


def commands_of(text: str) -> list[str]:
    blocks = re.findall(r"```console\n(.*?)```", text, re.S)
    return [line[2:] for block in blocks for line in block.splitlines() if line.startswith("$ ")]


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_a_page_run_in_their_order(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for command in commands_of(page.read_text()):
        name, *arguments = shlex.split(command)
        assert name == "shoal"
        assert run(arguments) == 0, f"{command}: {capsys.readouterr().err}"


def test_examples_of_help_run(tmp_path, monkeypatch):
    """Each command's --help ends with an example. That of demo is what `make demo` runs: it takes ten seconds."""
    monkeypatch.chdir(tmp_path)
    assert run(["map", "maze:9x7", "-n", "3", "--out", "result"]) == 0  # what replay's example replays
    for command in app.registered_commands:
        example = command.epilog.removeprefix("Example: shoal ")
        assert example.split()[0] == command.name
        if command.name != "demo":
            assert run(shlex.split(example)) == 0, example


def test_page_of_commands_is_fresh():
    spec = importlib.util.spec_from_file_location("generate_cli", ROOT / "docs" / "generate_cli.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert {command.name for command in app.registered_commands} == set(module.COMMANDS) - {""}
    assert module.page() == (ROOT / "docs" / "cli.md").read_text(), "run: python docs/generate_cli.py"


def test_public_names_are_documented():
    text = (ROOT / "docs" / "index.md").read_text()
    for name in shoal.__all__:
        assert name == "__version__" or f"`{name}`" in text, f"docs/index.md does not name {name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        assert "://" not in target, f"{page.name} links to the network: {target}"
        assert (page.parent / target).exists(), f"{page.name}: no {target}"
