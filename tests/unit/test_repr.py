"""What a prompt shows of an object is one line, however much the object holds; a large map is not
printed as its rows.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest
from tests.swarm_runs import run

import shoal
from shoal import GridWorkspace, open_map
from shoal.core.dataclass import one_line
from shoal.swarm.grid.board import Board
from shoal.swarm.maps.workspace import MOST_LINES

LONGEST = 3000  # characters
LARGE = {
    "NDArray|Points|Mask|Grey|Words|Any": np.zeros((40, 50)),
    "str": "one\ntwo " * 100,
    r"tuple(?!\[[^.]*\])|Sequence|list|Iterable": tuple(range(1000)),  # a pair of numbers is short
    "dict|Mapping": {number: np.zeros((9, 9)) for number in range(1000)},
}


def records():
    """Yield the dataclasses and named tuples of the package; those of kernels stay within them."""
    for module in pkgutil.walk_packages(shoal.__path__, "shoal."):
        if "__main__" not in module.name and ".kernels" not in module.name:
            for kind in vars(importlib.import_module(module.name)).values():
                if inspect.isclass(kind) and kind.__module__ == module.name:
                    if dataclasses.is_dataclass(kind) and not inspect.isabstract(kind):
                        yield kind, {one.name: str(one.type) for one in dataclasses.fields(kind)}
                    elif hasattr(kind, "_fields") and not kind.__name__.startswith("_"):
                        yield kind, {name: str(kind.__annotations__[name]) for name in kind._fields}


def value_for(annotation):
    return next(
        (value for words, value in LARGE.items() if re.search(rf"\b({words})\b", annotation)), 1
    )


def test_every_record_is_told_in_one_line():
    told = 0
    for kind, fields in records():
        if kind.__repr__ is not one_line and not hasattr(kind, "_fields"):
            continue
        if hasattr(kind, "_fields"):
            thing = kind(*map(value_for, fields.values()))
        else:
            thing = object.__new__(kind)
            for name, annotation in fields.items():
                object.__setattr__(thing, name, value_for(annotation))
        text = repr(thing)
        assert text.startswith(f"{kind.__name__}(")
        assert "\n" not in text, kind
        assert len(text) < LONGEST, kind
        told += 1
    assert told > 150


@pytest.mark.parametrize(
    "made",
    [
        lambda: open_map("vessels3d:400"),
        lambda: run(open_map("vessels3d:60"), particles=9, policy="closest-frontier"),
        lambda: run(
            open_map("cave:20x15"), particles=9, policy="closest-frontier", slip=0.1, seed=2
        ),
        lambda: shoal.run("disk", start=[(0, 0), (0.2, 0.4)], goal=[(0.3, 0), (-0.3, 0)]),
        lambda: shoal.run("rectangle:60x40", robots=3, footprint=10),
    ],
    ids=["volume", "episode in a volume", "noise", "steering", "search"],
)
def test_what_is_reached_from_an_object_is_told_in_one_line(made):
    seen, waiting = set(), [made()]
    while waiting:
        thing = waiting.pop()
        if (
            id(thing) in seen
            or not re.match(r"shoal\.(?!.*kernels)", type(thing).__module__)
            or len(seen) > 300
        ):
            continue
        seen.add(id(thing))
        assert "\n" not in repr(thing), type(thing)
        assert len(repr(thing)) < LONGEST, type(thing)
        assert str(thing).count("\n") < 2 * MOST_LINES, type(thing)
        waiting += (
            [getattr(thing, name, None) for name in vars(thing)]
            if hasattr(thing, "__dict__")
            else []
        )
    assert len(seen) > (0 if isinstance(made(), GridWorkspace) else 2)


def test_a_large_map_is_not_printed_as_its_rows():
    for shape in ((30, 40, 50), (2000, 10)):
        workspace = GridWorkspace(np.ones(shape))
        assert str(workspace) == repr(workspace)
        assert workspace.text.count(".") == workspace.n_free
        board = Board.of_mask(workspace.free)
        assert str(board) == repr(board)
    assert str(GridWorkspace(np.ones((2, 2, 3)))) == "...\n...\n\n...\n..."


def test_dataclasses_are_the_librarys_own():
    for path in Path(shoal.__file__).parent.rglob("*.py"):
        if path.name != "dataclass.py":
            assert not re.search(
                r"^from dataclasses import .*\bdataclass\b", path.read_text(), re.M
            ), path
