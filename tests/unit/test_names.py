"""Names are the field's: no two public things share a name, and no module has a private word."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "shoal"
# Verbs that the parts share, since who knows one part is to know the others, and what each format
# or view of a kind has.
SHARED = {"run", "check", "main", "scan", "write", "clip_of", "page_data", "player_page"}


def modules() -> Iterator[tuple[Path, ast.Module]]:
    for path in sorted(SOURCE.rglob("*.py")):
        yield path.relative_to(SOURCE), ast.parse(path.read_text())


def test_no_two_public_things_share_a_name():
    homes: defaultdict[str, list[str]] = defaultdict(list)
    for path, tree in modules():
        # kernels have no users but their own part; a command is named by its verb
        if "kernels" in path.parts or "cli" in path.parts:
            continue
        for node in tree.body:
            if (
                isinstance(node, ast.FunctionDef | ast.ClassDef)
                and not node.name.startswith("_")
                and node.name not in SHARED
            ):
                homes[node.name].append(str(path))
    assert {name: where for name, where in homes.items() if len(where) > 1} == {}


@pytest.mark.parametrize(
    "old",
    [
        "ways",
        "gates",
        "rings",
        "standing",
        "rising",
        "lifting",
        "played",
        "sharing",
        "sight",
        "seen",
        "asking",
        "wonder",
        "manner",
        "ground",
        "passages",
        "corners",
        "stops",
        "judgement",
        "arrivals",
        "assembling",
        "named",
        "methods",
        "fleet",
        "presence",
        "pilot",
        "heights",
        "growing",
        "opposite",
        "filling",
        "plays",
        "mending",
        "foresight",
        "guess",
        "experience",
        "prospect",
        "survey",
        "planned",
        "crews",
        "claim",
        "looks",
        "plant",
    ],
)
def test_no_module_has_a_private_word(old):
    assert [str(path) for path in SOURCE.rglob(f"{old}.py")] == []
