"""Names are the field's: no two public things share a name, and no module has a private word."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "shoal"
# Verbs that the parts share, since who knows one part is to know the others, and what each format
# or view of a kind has.
SHARED = {"run", "check", "main", "scan", "write", "clip_of", "page_data", "player_page"}


def test_no_two_public_things_share_a_name():
    homes: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted(SOURCE.rglob("*.py")):
        # kernels have no users but their own part; a command is named by its verb
        if {"kernels", "cli"} & {*path.relative_to(SOURCE).parts}:
            continue
        for name in {*re.findall(r"^(?:def|class) ([A-Za-z]\w*)", path.read_text(), re.M)}:
            if name not in SHARED:
                homes[name].append(str(path))
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
