"""Draw the packages of Shoal in their layers: what stands higher may import what stands lower. Made
from pyproject.toml. The file of the picture also has its words, so that a test finds an old picture.

Run: python docs/make_house_image.py
"""

from __future__ import annotations

import argparse
import ast
import json
import textwrap
import tomllib
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from shoal.views.drawing.charts import BLUE, GREEN, INK, MUTED, ORANGE, new_figure, save_figure

ROOT = Path(__file__).parents[1]
WIDTH, HEIGHT, GAP = 10.0, 0.86, 0.14
COLOURS = {"swarm": BLUE, "steering": ORANGE, "search": GREEN}


def layers() -> list[list[str]]:
    """Return the packages of each layer, the highest first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    rows = next(one["layers"] for one in contracts if one.get("containers") == ["shoal"])
    return [[name.strip() for name in row.split("|")] for row in rows]


def purpose(name: str) -> str:
    """Return the first sentence that a package or module says of itself."""
    base = ROOT / "src" / "shoal" / name
    path = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
    said = (
        (ast.get_docstring(ast.parse(path.read_text())) or "")
        .split("\n\n")[0]
        .replace("\n", " ")
        .replace("``", "")
    )
    return said.split(". ")[0].rstrip(".")


def words() -> list[dict[str, str]]:
    """Return the words of the picture: for each layer, its packages with their purposes."""
    return [{name: purpose(name) for name in row} for row in layers()]


def house() -> Figure:
    """Return the picture."""
    rows = words()
    figure = new_figure(WIDTH, len(rows) * HEIGHT)
    axes = figure.subplots()
    axes.set(xlim=(0, WIDTH), ylim=(-len(rows) * HEIGHT, 0))
    axes.axis("off")
    for number, row in enumerate(rows):
        side = WIDTH / len(row)
        for place, (name, said) in enumerate(row.items()):
            left, top = place * side + GAP / 2, -number * HEIGHT - GAP / 2
            colour = COLOURS.get(name, MUTED)
            style = {
                "boxstyle": "round,pad=0,rounding_size=0.06",
                "fc": colour,
                "ec": "none",
                "alpha": 0.15,
            }
            axes.add_patch(
                FancyBboxPatch((left, top - HEIGHT + GAP), side - GAP, HEIGHT - GAP, **style)
            )
            axes.text(
                left + 0.12, top - 0.2, name, color=INK, fontsize=11, fontweight="bold", va="center"
            )
            told = textwrap.wrap(said, width=int(side * 16.2 - 1))
            axes.text(
                left + 0.12,
                top - 0.32,
                "\n".join(told[:3]),
                color=INK,
                fontsize=6.6,
                va="top",
                linespacing=1.25,
            )
    return figure


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    picture = Path(__file__).parent / "images" / "house.png"
    save_figure(house(), picture)
    about = PngInfo()
    about.add_text("layers", json.dumps(words()))
    with Image.open(picture) as drawn:
        drawn.convert("RGB").quantize(32).save(picture, optimize=True, pnginfo=about)
