"""Run the code of docs/gallery.md; its pictures and films are written to docs/images/gallery.

Run: python docs/make_gallery.py [NAME ...], without a name for all.
"""

from __future__ import annotations

import argparse
import os
import re
from pathlib import Path

from PIL import Image

import shoal

PAGE = Path(__file__).with_name("gallery.md")
FOLDER = Path(__file__).parent / "images" / "gallery"
WIDEST = 1200  # pixels
COLOURS = 128


def blocks_of(text: str) -> dict[str, str]:
    """Return the code that makes each file, by the file's name."""
    return {
        re.findall(r'"([\w-]+\.(?:png|gif))"', block)[-1]: block
        for block in re.findall(r"```python\n(.*?)```", text, re.S)
    }


def main() -> None:
    """Make what was asked for, as small files."""
    blocks = blocks_of(PAGE.read_text())
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(blocks)}; default: all"
    )
    given = parser.parse_args()
    if unknown := set(given.names) - set(blocks):
        parser.error(f"expected names of {PAGE.name}, got {', '.join(sorted(unknown))}")
    FOLDER.mkdir(exist_ok=True)
    os.chdir(FOLDER)
    for name, block in blocks.items():
        if given.names and name not in given.names:
            continue
        exec(compile(block, f"{PAGE.name}: {name}", "exec"), {"shoal": shoal})
        if name.endswith(".png"):
            with Image.open(name) as picture:
                picture.thumbnail((WIDEST, WIDEST))
                picture.convert("RGB").quantize(COLOURS).save(name, optimize=True)
        print(name, os.path.getsize(name))


if __name__ == "__main__":
    main()
