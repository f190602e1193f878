"""Generated maps: exact counts, connectedness, shape of the graph, names and their errors."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.swarm.maps.generators import GENERATORS, generate, is_spec
from shoal.swarm.maps.generators.mazes import draw_bars, half_lengths, tree_size


def parts(free):
    return ndimage.label(free)[1]


def edges(free):
    """Pairs of free cells side by side or one above the other."""
    return np.count_nonzero(free[1:] & free[:-1]) + np.count_nonzero(free[:, 1:] & free[:, :-1])


def is_tree(free):
    return parts(free) == 1 and np.count_nonzero(free) - edges(free) == 1


def holes(free):
    """Walls inside a map; they touch by corners where free cells do not."""
    return ndimage.label(np.pad(~free, 1, constant_values=True), np.ones((3, 3)))[1] - 1


def dead_ends(free):
    around = ndimage.convolve(free.astype(int), [[0, 1, 0], [1, 0, 1], [0, 1, 0]], mode="constant")
    return np.count_nonzero(free & (around == 1))


@pytest.mark.parametrize("name", list(GENERATORS))
def test_every_generator_draws_its_example(name):
    generator = GENERATORS.get(name)
    free = generate(generator.example)
    assert generator.name == name
    assert generator.example.startswith(name + ":")
    assert generator.summary.endswith(".")
    assert free.dtype == np.bool_
    assert free.ndim == (3 if name.startswith("vessels3d") else 2)
    assert free.flags["C_CONTIGUOUS"]
    assert parts(free) == 1


@pytest.mark.parametrize(
    "spec", [generator.example for generator in map(GENERATORS.get, GENERATORS)]
)
def test_the_same_name_gives_the_same_map(spec):
    np.testing.assert_array_equal(generate(spec), generate(spec))


@pytest.mark.parametrize("spec", ["vessels:500", "maze:31x21", "cave:40x30"])
def test_the_seed_is_0_unless_given_and_matters(spec):
    np.testing.assert_array_equal(generate(spec), generate(spec + ":0"))
    other = generate(spec + ":1")
    assert generate(spec).shape != other.shape or (generate(spec) != other).any()


def test_line_and_rectangle():
    assert generate("line:5000").shape == (1, 5000)
    assert generate("rectangle:50x100").shape == (50, 100)
    assert generate("rectangle:50X100").all()


def test_htree_of_the_paper():
    free = generate("htree:5000")
    assert half_lengths(5000) == (32, 32, 16, 16, 8, 8, 4, 4, 2, 2)
    assert tree_size(half_lengths(5000)) == 5953
    assert free.shape == (125, 125)
    assert np.count_nonzero(free) == 5000
    assert is_tree(free)
    # Only the lower left corner is cut: the other three are those of the whole tree.
    whole = draw_bars(half_lengths(5000), 5953)
    np.testing.assert_array_equal(free[:62], whole[:62])
    np.testing.assert_array_equal(free[:, 63:], whole[:, 63:])


@pytest.mark.parametrize("count", [*range(1, 120), 305, 306, 1000, 5953, 5954, 20000])
def test_htree_of_any_size_is_a_tree(count):
    free = generate(f"htree:{count}")
    assert np.count_nonzero(free) == count
    assert is_tree(free)
    assert free.any(axis=0).all()
    assert free.any(axis=1).all()


@pytest.mark.parametrize("halves", [(7,), (5, 3), (16, 16, 8, 8, 4, 4, 2), (12, 6, 6, 3, 2)])
def test_htree_with_other_levels(halves):
    for count in (1, tree_size(halves) // 3, tree_size(halves)):
        free = draw_bars(halves, count)
        assert np.count_nonzero(free) == count
        assert is_tree(free)


@pytest.mark.parametrize("seed", [0, 1, 7])
def test_vessels_like_those_of_the_paper(seed):
    free = generate(f"vessels:5000:{seed}")
    assert np.count_nonzero(free) == 5000
    assert parts(free) == 1
    assert 60 <= holes(free) <= 100
    assert dead_ends(free) >= 20
    assert min(free.shape) >= 100
    assert max(free.shape) <= 190
    # Corridors are one to four cells wide; a little more where they meet.
    wide = ndimage.binary_opening(np.pad(free, 3), np.ones((6, 6)))
    assert np.count_nonzero(wide) < 0.05 * 5000
    assert np.count_nonzero(ndimage.binary_opening(free, np.ones((3, 3)))) > 0.2 * 5000


@settings(max_examples=25, deadline=None)
@given(count=st.integers(30, 700), seed=st.integers(0, 2**70))
def test_vessels_of_any_size(count, seed):
    free = generate(f"vessels:{count}:{seed}")
    assert np.count_nonzero(free) == count
    assert parts(free) == 1
    assert free.any(axis=0).all()
    assert free.any(axis=1).all()


@settings(max_examples=60, deadline=None)
@given(width=st.integers(1, 40), height=st.integers(1, 40), seed=st.integers(0, 1000))
def test_maze_is_perfect(width, height, seed):
    free = generate(f"maze:{width}x{height}:{seed}")
    assert free.shape == (height, width)
    assert free[::2, ::2].all()
    assert is_tree(free)


@settings(max_examples=60, deadline=None)
@given(width=st.integers(1, 60), height=st.integers(1, 60), seed=st.integers(0, 1000))
def test_cave_is_one_connected_space(width, height, seed):
    free = generate(f"cave:{width}x{height}:{seed}")
    assert free.shape == (height, width)
    assert parts(free) == 1
    assert np.count_nonzero(free) >= free.size / 3


def test_cave_is_smooth():
    free = generate("cave:120x80")
    assert 0.35 < free.mean() < 0.7
    assert dead_ends(free) < 0.01 * free.size


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (
            "line",
            r"expected a size \(CELLS\) in the map name, got 'line': write for example line:5000",
        ),
        ("line:", "write for example line:5000"),
        ("maze::3", r"expected a size \(WIDTHxHEIGHT\)"),
        ("line:0", "expected at least 1 for the cells, got '0' in 'line:0'"),
        ("line:-5", "expected at least 1 for the cells, got '-5'"),
        ("rectangle:5x0", "expected at least 1 for the columns, got '0'"),
        ("line:many", "expected a whole number of cells, got 'many'"),
        ("line:5.5", "expected a whole number of cells, got '5.5'"),
        ("line:1_000", "expected a whole number"),
        ("line:٣", "expected a whole number"),
        ("line:268435457", "expected from 1 to 268435456 cells .* got 268435457"),
        ("rectangle:20000x20000", "expected from 1 to 268435456 cells .* got 400000000"),
        ("line:" + "9" * 500, "expected from 1 to 268435456 cells"),
        ("htree:200000000", "expected an H-tree in a picture of at most 268435456 cells"),
        ("vessels:29", "expected from 30 to 1000000 cells for a map of kind vessels, got 29"),
        ("vessels:1000001", "expected from 30 to 1000000 cells"),
        ("line:50x100", r"expected a size of 1 number \(CELLS\), got '50x100' in 'line:50x100'"),
        ("rectangle:50", r"expected a size of 2 numbers \(ROWSxCOLUMNS\), got '50'"),
        ("rectangle:5x5x5", "expected a size of 2 numbers"),
        ("rectangle:5x", "expected a whole number of columns, got ''"),
        (
            "maze:5x5:-1",
            "expected a seed that is an integer of at least 0, got '-1' in 'maze:5x5:-1'",
        ),
        ("maze:5x5:x", "expected a seed"),
        ("maze:5x5:", "expected a seed"),
        ("maze:5x5:1.0", "expected a seed"),
        ("maze:5x5:1:2", r"expected maze:WIDTHxHEIGHT\[:SEED\], got 'maze:5x5:1:2'"),
        ("line:5:1", "expected no seed, because nothing in a map of kind line is random, got 1"),
        (5, "expected a map name such as 'vessels:5000:7', got int"),
    ],
)
def test_bad_names_are_refused(spec, message):
    with pytest.raises(InvalidInputError, match=message):
        generate(spec)


@pytest.mark.parametrize(
    ("spec", "near"), [("htre:50", "htree"), ("Maze:5x5", "maze"), ("vessel:100", "vessels")]
)
def test_an_unknown_name_brings_the_nearest_one(spec, near):
    with pytest.raises(UnknownNameError, match=f"unknown map generator .* did you mean '{near}'"):
        generate(spec)


@pytest.mark.parametrize("spec", ["", "zzzz", "zzzz:5", ":5", "x" * 10_000])
def test_an_unknown_name_without_a_near_one(spec):
    with pytest.raises(
        UnknownNameError, match=r"unknown map generator .*\(known: line, rectangle"
    ) as caught:
        generate(spec)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("line:5", True),
        ("maze", True),
        ("maze:nonsense", True),
        ("maze.png", False),
        ("C:/maps/line.png", False),
        ("maps/line:5", False),
        ("", False),
    ],
)
def test_is_spec(text, expected):
    assert is_spec(text) is expected


def test_importing_generators_imports_neither_scipy_nor_scikit_image():
    code = "import sys, shoal.swarm.maps.generators; print({'scipy', 'skimage'} & set(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout == "set()\n"
