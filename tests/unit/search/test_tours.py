"""Tours: what each promises on many shapes, what is refused, and the command."""

from __future__ import annotations

import csv
import itertools
import json
import math

import numpy as np
import pytest

from shoal.cli import run
from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.search import (
    Tour,
    components,
    hilbert_decode,
    hilbert_encode,
    make_tour,
    moore_decode,
    moore_encode,
)
from shoal.search.tours import TOURS
from shoal.testing import check_tour_maker
from shoal.views.search.tour import tour_figure

NAMES = list(TOURS)
SHAPES = [
    (1, 1),
    (1, 2),
    (2, 1),
    (1, 9),
    (9, 1),
    (2, 2),
    (2, 3),
    (3, 2),
    (3, 3),
    (5, 4),
    (4, 7),
    (7, 9),
    (8, 8),
    (15, 16),
    (64, 65),
]
CLOSED_BY_A_STEP = ["hilbert-rectangle", "comb", "spanning-tree"]


@pytest.mark.parametrize("name", NAMES)
def test_conformance(name):
    check_tour_maker(name)


@pytest.mark.parametrize("name", CLOSED_BY_A_STEP)
@pytest.mark.parametrize(
    "shape", [*itertools.product(range(2, 12), repeat=2), (33, 64), (64, 33), (65, 65)], ids=str
)
def test_steps_in_a_rectangle_go_to_neighbours_and_one_diagonally_where_both_sides_are_odd(
    name, shape
):
    steps = np.sort(make_tour(name, shape).steps)
    odd = shape[0] % 2 and shape[1] % 2
    assert np.all(steps[:-1] == 1)
    assert steps[-1] == pytest.approx(math.sqrt(2) if odd else 1)


@pytest.mark.parametrize("name", [*CLOSED_BY_A_STEP, "hilbert", "moore"])
def test_one_row_is_walked_there_and_back(name):
    for shape in ((1, 9), (9, 1)):
        assert make_tour(name, shape).metrics().length == 16


def test_boxes_of_even_sides_need_steps_to_neighbours_only():
    for shape in itertools.product((2, 4, 6, 8), repeat=3):
        assert np.all(make_tour("hilbert-rectangle", shape).steps == 1), shape


def test_boxes_with_odd_sides_need_no_step_longer_than_a_diagonal():
    for shape in itertools.product((2, 3, 5, 6, 9), repeat=3):
        assert make_tour("hilbert-rectangle", shape).steps.max() < 1.5, shape


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_closing_edges(order):
    side = 2**order
    assert make_tour("hilbert", (side, side)).metrics().closing_edge == side - 1
    assert make_tour("hilbert", (side, side, side)).metrics().closing_edge == side - 1
    assert make_tour("moore", (side, side)).metrics().closing_edge == 1
    opened = make_tour("open-hilbert", (side, side)).metrics()
    assert (opened.closing_edge, opened.length) == (0, side**2 - 1)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_hilbert_ii_is_the_curve_of_its_l_system(order):
    """Drawn by the turtle of Fractint's Hilbert II, which knows no squares."""
    rules = {"X": "XFYFX+F+YFXFY-F-XFYFX", "Y": "YFXFY-F-XFYFX+F+YFXFY"}
    words = "X"
    for _ in range(order):
        words = "".join(rules.get(letter, letter) for letter in words)
    side, cell, step = 3**order, np.array([3**order - 1, 0]), np.array([-1, 0])
    drawn = [cell]
    for letter in words:
        if letter in "+-":
            step = step[::-1] * (-1, 1) if letter == "-" else step[::-1] * (1, -1)
        elif letter == "F":
            drawn.append(cell := cell + step)
    assert make_tour("hilbert-ii", (side, side)).cells.tolist() == np.array(drawn).tolist()


def test_turns_of_comb_and_hilbert():
    """The specification's figures: about 0.03 turns a cell against 0.8."""
    assert make_tour("comb", (64, 64)).metrics().turns == 128
    assert make_tour("spanning-tree", (64, 64)).metrics().turns == 128
    assert make_tour("hilbert", (64, 64)).metrics().turns_per_cell == pytest.approx(0.8, abs=0.001)


def test_a_ring_one_cell_wide_is_walked_round():
    mask = np.ones((20, 31), dtype=bool)
    mask[1:-1, 1:-1] = False
    assert make_tour("spanning-tree", mask).metrics().length == mask.sum()


def test_spanning_tree_round_a_hole():
    mask = np.ones((60, 80), dtype=bool)
    mask[20:36, 30:50] = False
    assert np.all(make_tour("spanning-tree", mask).steps == 1)
    mask = np.ones((60, 80), dtype=bool)
    mask[21:36, 31:50] = False  # across the blocks, and an odd number of cells
    steps = make_tour("spanning-tree", mask).steps
    assert np.count_nonzero(steps != 1) <= 4
    assert steps.max() < 1.5


def test_a_dead_end_costs_its_way_back():
    mask = np.zeros((4, 12), dtype=bool)
    mask[:, :4] = True
    mask[3, 4:] = True
    metrics = make_tour("spanning-tree", mask).metrics()
    # 23 steps to neighbours and one back to the room
    assert metrics.length == pytest.approx(23 + math.hypot(8, 1))


def test_components_are_visited_one_after_the_other():
    rng = np.random.default_rng(0)
    mask = rng.random((30, 40)) < 0.55
    labels = components(mask)
    for name in NAMES:
        of_cell = labels[tuple(make_tour(name, mask).cells.T)]
        assert np.count_nonzero(np.diff(of_cell)) == labels.max() - 1, name


def test_components():
    mask = np.array([[1, 0, 1], [1, 0, 1], [0, 1, 0]], dtype=bool)
    assert components(mask).tolist() == [[1, 0, 2], [1, 0, 2], [0, 3, 0]]
    assert components(np.ones((2, 2, 2), dtype=bool)).max() == 1


def test_position_is_the_inverse_of_cells():
    tour = make_tour("comb", np.array([[True, False, True], [True, True, True]]))
    assert tour.position[0, 1] == -1
    assert [tour.position[tuple(cell)] for cell in tour.cells.tolist()] == list(range(5))
    with pytest.raises(ValueError, match="read-only"):
        tour.cells[0, 0] = 1


def test_encode_and_decode_keep_shapes():
    indices = np.arange(24).reshape(2, 3, 4)
    cells = hilbert_decode(indices, order=3)
    assert cells.shape == (2, 3, 4, 2)
    assert np.array_equal(hilbert_encode(cells, order=3), indices)
    assert hilbert_decode(5, order=3).shape == (2,)
    assert hilbert_encode((2, 3), order=3) == 28
    assert hilbert_encode(np.empty((0, 3)), order=3).shape == (0,)
    assert hilbert_decode([], order=0).shape == (0, 2)
    assert hilbert_decode(np.uint8([28]), order=3).tolist() == [[2, 3]]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: hilbert_decode(2**20, order=10),
            "expected 0 to 1048575 on the Hilbert curve of order 10, got 1048576",
        ),
        (lambda: hilbert_decode([0, -1], order=31), "got -1 at number 1"),
        (lambda: hilbert_decode(np.uint64(2**63), order=31), "got 9223372036854775808"),
        (lambda: hilbert_decode(8, order=1, dimensions=3), "expected 0 to 7 on"),
        (
            lambda: hilbert_decode(0, order=1, dimensions=4),
            "dimensions: expected a whole number from 2 to 3, got 4",
        ),
        (
            lambda: hilbert_decode(0.5, order=1),
            "expected whole numbers that fit 64 bits, got dtype float64",
        ),
        (
            lambda: hilbert_decode(0, order=32),
            "order: expected a whole number from 0 to 31, got 32",
        ),
        (lambda: hilbert_decode(0, order=21, dimensions=3), "from 0 to 20, got"),
        (lambda: hilbert_decode(0, order=2.0), "got 2.0"),
        (lambda: hilbert_decode(0, order=True), "got True"),
        (
            lambda: hilbert_encode([[0, 0], [0, 8]], order=3),
            r"expected 0 to 7 on the Hilbert curve of order 3, got \(0, 8\) at number 1",
        ),
        (lambda: hilbert_encode([0, 0, 8], order=3), r"got \(0, 0, 8\)"),
        (lambda: hilbert_encode([-1, 0], order=31), r"got \(-1, 0\)"),
        (lambda: hilbert_encode(3, order=3), r"got shape \(\)"),
        (lambda: hilbert_encode([[1, 2], [3]], order=3), "rows of different lengths"),
        (lambda: moore_encode([[0, 0, 0]], order=3), r"\(row, col\)"),
        (lambda: moore_encode([4, 0], order=2), "Moore curve of order 2"),
        (lambda: moore_encode([1, 0], order=0), "Moore curve of order 0"),
        (lambda: moore_decode(1, order=0), "expected 0 to 0"),
        (lambda: moore_decode(16, order=2), "expected 0 to 15"),
    ],
)
def test_what_is_not_on_a_curve_is_refused(call, message):
    with pytest.raises(InvalidInputError, match=message):
        call()


class Broken:
    name = "broken"
    dimensions = (2,)

    def __init__(self, made):
        self.made = made

    def make(self, mask):
        return self.made


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: make_tour("comb", np.zeros((3, 3), dtype=bool)),
            "expected at least one cell to be searched, got none",
        ),
        (
            lambda: make_tour("comb", np.ones((3, 3))),
            "expected booleans, True for a cell to be searched, got dtype float64",
        ),
        (lambda: make_tour("comb", np.ones((3, 3, 3, 3), dtype=bool)), "got an array of 4"),
        (
            lambda: make_tour("comb", (3, 0)),
            r"expected at least one cell along each side, got \(3, 0\)",
        ),
        (lambda: make_tour("comb", (3,)), r"expected \(rows, columns\)"),
        (lambda: make_tour("comb", (2**20, 2**20)), "expected at most 268435456 cells"),
        (
            lambda: make_tour("hilbert", (2, 2, 2**21)),
            "expected at most 1048576 cells along each side",
        ),
        (lambda: make_tour("combe", (3, 3)), "did you mean 'comb'"),
        (lambda: make_tour("math:pi", (3, 3)), "expected name, dimensions and make"),
        (lambda: make_tour(Broken(None), (2, 2)), "expected make.. to return a Tour, got NoneType"),
        (
            lambda: make_tour(Broken(make_tour("comb", (2, 3))), (2, 2)),
            r"expected the shape \(2, 2\) of the mask, got \(2, 3\)",
        ),
        (lambda: make_tour(Broken(tour_of([[0, 0], [0, 1]])), (2, 2)), r"leaves out cell \(1, 0\)"),
        (
            lambda: make_tour(Broken(tour_of([[0, 0], [0, 1]])), np.eye(2, dtype=bool)),
            r"visits cell \(0, 1\)",
        ),
        (
            lambda: tour_of([[0, 0], [0, 1], [0, 0]]),
            r"expected each cell once, got \(0, 0\) again as number 2",
        ),
        (lambda: tour_of([[0, 0], [2, 1]]), r"cell \(2, 1\), number 1, is outside \(2, 2\)"),
        (lambda: tour_of([[0.0, 0]]), "expected whole numbers"),
        (lambda: tour_of(np.empty((0, 2), dtype=int)), "N at least 1"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(call, message):
    with pytest.raises((InvalidInputError, UnknownNameError), match=message):
        call()


def tour_of(cells):
    return Tour(np.array(cells), (2, 2), closed=True, name="given")


FIELDS = [
    "tour",
    "region",
    "shape",
    "closed",
    "cells",
    "length",
    "closing_edge",
    "turns",
    "turns_per_cell",
    "longest_step",
]
FIELDS += ["neighbour_steps", "neighbour_stretch", "dilation"]


def test_command(tmp_path, capsys):
    assert run(["tour", "hilbert-rectangle", "12x7", "--json", "--out", str(tmp_path)]) == 0
    result = json.loads(capsys.readouterr().out)
    assert list(result) == FIELDS
    assert (result["shape"], result["length"], result["closed"]) == ([7, 12], 84, True)
    assert {path.name for path in tmp_path.iterdir()} == {"tour.png", "tour.csv", "summary.json"}
    assert json.loads((tmp_path / "summary.json").read_text()) == result
    header, *rows = csv.reader((tmp_path / "tour.csv").read_text().splitlines())
    assert header == ["row", "col"]
    assert (
        np.array(rows, dtype=int).tolist() == make_tour("hilbert-rectangle", (7, 12)).cells.tolist()
    )


def test_command_in_space_and_on_a_map(tmp_path, capsys):
    assert run(["tour", "hilbert", "3x4x5", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "tour.csv").read_text().startswith("layer,row,col\n")
    (tmp_path / "region.txt").write_text("..#\n.#.\n")
    capsys.readouterr()
    assert run(["tour", "comb", str(tmp_path / "region.txt"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cells"] == 4


@pytest.mark.parametrize("size", ["64x", "0", "axb", "1x2x3x4", "", "99999x99999", "-3"])
def test_sizes_that_are_none(size, capsys):
    assert run(["tour", "comb", "--", size]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize(
    "shape", [(8, 8), (1, 1), (1, 7), (40, 3), (210, 210), (4, 5, 6), (1, 1, 1)], ids=str
)
def test_figures_are_drawn(shape, tmp_path):
    figure = tour_figure(make_tour("hilbert", shape))
    figure.savefig(tmp_path / "tour.png")
    assert (tmp_path / "tour.png").stat().st_size > 3000


def test_figure_has_a_line_a_step_and_a_dashed_closing_edge():
    axes = tour_figure(make_tour("hilbert", (8, 8))).axes[0]
    assert len(axes.collections[0].get_segments()) == 63
    dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
    assert [line.get_xydata().tolist() for line in dashed] == [[[7, 7], [0, 7]]]
    assert not [
        line
        for line in tour_figure(make_tour("open-hilbert", (8, 8))).axes[0].lines
        if line.get_linestyle() == "--"
    ]
