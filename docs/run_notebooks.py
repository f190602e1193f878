"""Run the cells of the notebooks in docs/notebooks and write what they show into them, as a
notebook server would.

Run: python docs/run_notebooks.py [NAME.ipynb ...], without a name for all.
"""

from __future__ import annotations

import argparse
import ast
import base64
import io
import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "notebooks"


def shown(value: Any, count: int) -> dict[str, Any]:
    """Return what a notebook shows of a value: its picture or page, and its text."""
    data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
    if page := getattr(value, "_repr_html_", str)():
        data["text/html"] = page.splitlines(keepends=True)
    elif hasattr(value, "_repr_png_"):
        data["image/png"] = base64.b64encode(value._repr_png_()).decode()
    return {"output_type": "execute_result", "execution_count": count, "data": data, "metadata": {}}


def run_cell(source: str, names: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Run a cell in the given names; return its outputs: what was printed, and the value of the
    last line.
    """
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, outputs, value = io.StringIO(), [], None
    with redirect_stdout(printed):
        exec(compile(tree, f"cell {count}", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {count}", "eval"), names)
    if printed.getvalue():
        outputs.append(
            {
                "output_type": "stream",
                "name": "stdout",
                "text": printed.getvalue().splitlines(keepends=True),
            }
        )
    return outputs if value is None else [*outputs, shown(value, count)]


def run_notebook(notebook: dict[str, Any]) -> dict[str, Any]:
    """Run all cells of a notebook, which is changed and returned."""
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, start=1):
        cell["outputs"], cell["execution_count"] = (
            run_cell("".join(cell["source"]), names, count),
            count,
        )
    return notebook


def main() -> None:
    """Run the notebooks that were asked for."""
    paths = {path.name: path for path in sorted(FOLDER.glob("*.ipynb"))}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(paths)}; default: all"
    )
    given = parser.parse_args()
    if unknown := set(given.names) - set(paths):
        parser.error(f"expected {', '.join(paths)}, got {', '.join(sorted(unknown))}")
    for name, path in paths.items():
        if not given.names or name in given.names:
            path.write_text(
                json.dumps(run_notebook(json.loads(path.read_text())), indent=1, ensure_ascii=False)
                + "\n"
            )
            print(path.name, path.stat().st_size)


if __name__ == "__main__":
    main()
