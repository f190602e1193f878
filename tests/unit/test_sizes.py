"""No file, folder or function of the library is larger than what a reader can hold in mind."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2] / "src" / "shoal"
SOURCES = sorted(ROOT.rglob("*.py"))
LINES, ENTRIES, FUNCTION = 800, 12, 60
OF_PYTHON = {"__init__.py", "__main__.py", "__pycache__", "py.typed"}  # names that Python asks for


def length(function):
    """Return how many lines a function has without its docstring."""
    first = function.body[0]
    told = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str)
    return function.end_lineno - function.lineno + 1 - (first.end_lineno - first.lineno + 1 if told else 0)


def test_no_file_is_long():
    assert {path.name: count for path in SOURCES if (count := len(path.read_text().splitlines())) > LINES} == {}


def test_no_folder_is_full():
    folders = {path.parent for path in SOURCES}
    assert {str(folder): len(entries) for folder in folders if len(entries := inside(folder)) > ENTRIES} == {}


def inside(folder):
    return [path for path in folder.iterdir() if path.name not in OF_PYTHON and path.suffix not in (".nbi", ".nbc")]


def test_no_function_is_long():
    """Kernels aside, which cannot be divided without cost."""
    plain = [path for path in SOURCES if "kernels" not in path.parts]
    functions = [
        (path, node) for path in plain for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)
    ]
    assert {f"{path.name}: {node.name}": length(node) for path, node in functions if length(node) > FUNCTION} == {}
