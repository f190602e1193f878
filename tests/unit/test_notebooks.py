"""The notebooks of the documentation run, and show what they hold."""

from __future__ import annotations

import importlib.util
import json
from copy import deepcopy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


def told(notebook):
    """Return what each cell says in words, and the kinds of what else it shows."""
    outputs = [
        output
        for cell in notebook["cells"]
        if cell["cell_type"] == "code"
        for output in cell["outputs"]
    ]
    return [
        (
            "".join(output.get("text", output.get("data", {}).get("text/plain", []))),
            sorted(output.get("data", {})),
        )
        for output in outputs
    ]


def test_there_are_five():
    assert [path.stem for path in NOTEBOOKS] == ["lab", "learning", "search", "steering", "swarm"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_it_holds(path):
    spec = importlib.util.spec_from_file_location("run_notebooks", DOCS / "run_notebooks.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    held = json.loads(path.read_text())
    assert told(module.run_notebook(deepcopy(held))) == told(held), (
        "run: python docs/run_notebooks.py"
    )
