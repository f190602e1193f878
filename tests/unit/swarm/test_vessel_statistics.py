"""Statistics of vessels: drawn trees with known angles, radii and lengths."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.imaging import (
    box_dimension,
    centre_lines,
    murray_exponents,
    vessel_statistics,
)

pytest.importorskip("skimage")  # an extra

ROWS, COLUMNS = np.mgrid[:150, :150].astype(float)


def stroke(places, radius):
    """Return the pixels within a radius of a line through places (row, column)."""
    mask = np.zeros(ROWS.shape, bool)
    for (row, column), (to_row, to_column) in itertools.pairwise(places):
        down, right = to_row - row, to_column - column
        share = np.clip(
            ((ROWS - row) * down + (COLUMNS - column) * right) / (down**2 + right**2), 0, 1
        )
        mask |= np.hypot(ROWS - row - share * down, COLUMNS - column - share * right) < radius
    return mask


def fork(heading, turns, radii):
    """Return a fork in the middle: its parent has a heading (degrees), the daughters leave at
    angles to its left and right.
    """
    mask = np.zeros(ROWS.shape, bool)
    for angle, radius in zip(
        (heading + 180, heading + turns[0], heading - turns[1]), radii, strict=True
    ):
        mask |= stroke(
            [
                (75.3, 74.6),
                (75.3 + 60 * np.sin(np.radians(angle)), 74.6 + 60 * np.cos(np.radians(angle))),
            ],
            radius,
        )
    return mask


@pytest.mark.parametrize("heading", [0, 33, 161])
@pytest.mark.parametrize(
    ("turns", "radii", "off"),
    [
        ((20, 60), (5, 4, 3.5), 2),
        ((37, 37), (7, 6, 4), 3),
        ((10, 45), (5, 4.5, 2), 3),
        ((5, 85), (2, 1.6, 1.2), 5),
    ],
)
def test_a_drawn_fork_is_measured(heading, turns, radii, off):
    measured = vessel_statistics(fork(heading, turns, radii))
    assert measured.angles == pytest.approx([sum(turns)], abs=off)
    assert measured.radii == pytest.approx(np.array([radii]), abs=0.35)
    assert measured.area_ratios == pytest.approx(
        (radii[1] ** 2 + radii[2] ** 2) / radii[0] ** 2, rel=0.25
    )
    assert measured.asymmetry == pytest.approx(radii[2] / radii[1], rel=0.2)
    assert measured.exponents == pytest.approx(murray_exponents([radii]), rel=0.3)


def test_the_parent_of_alike_vessels_leaves_the_smallest_angle():
    assert vessel_statistics(fork(70, (40, 40), (3, 3, 3))).angles == pytest.approx([80], abs=5)


def test_exponents_solve_the_law():
    radii = np.array([[2 ** (1 / k), 1.0, 1.0] for k in (1.5, 2.0, 3.0, 7.0)])
    assert murray_exponents(radii) == pytest.approx([1.5, 2, 3, 7])
    assert murray_exponents([[5, 3, 4], [3, 3, 1], [1, 2, 0.5]]) == pytest.approx(
        [2, np.inf, np.inf]
    )


@pytest.mark.parametrize("radius", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("turn", [0, 20, 45])
def test_a_straight_vessel_has_its_length_and_width(radius, turn):
    step = 50 * np.array([np.sin(np.radians(turn)), np.cos(np.radians(turn))])
    middle = np.array([75.2, 75.1])
    posts = [
        stroke([end - step[::-1] * (-0.4, 0.4), end + step[::-1] * (-0.4, 0.4)], radius)
        for end in (middle - step, middle + step)
    ]
    measured = vessel_statistics(
        stroke([middle - step, middle + step], radius) | posts[0] | posts[1]
    )
    # a junction moves a little towards the branch
    assert measured.lengths == pytest.approx([100], rel=0.04)
    assert measured.chords == pytest.approx([100], rel=0.04)
    assert measured.widths == pytest.approx([2 * radius], rel=0.15)
    assert measured.summary()["tortuosity"] == pytest.approx(1, abs=0.01)


def test_a_half_circle_is_longer_than_its_chord_by_half_of_pi():
    angles = np.linspace(0, np.pi, 40)
    arc = np.column_stack([110 - 50 * np.sin(angles), 75 - 50 * np.cos(angles)])
    feet = [stroke([(110, column - 12), (110, column + 12)], 2) for column in (25, 125)]
    measured = vessel_statistics(stroke(arc, 2) | feet[0] | feet[1])
    assert measured.summary()["tortuosity"] == pytest.approx(np.pi / 2, rel=0.02)


def test_density_and_dead_ends_are_counted_inside_the_view():
    mask = fork(0, (40, 40), (3, 2, 2))
    assert vessel_statistics(mask).dead_ends == pytest.approx(
        100 * 3 * mask.sum() / 180**2, rel=0.05
    )
    view = np.hypot(ROWS - 75, COLUMNS - 75) < 40
    seen = vessel_statistics(mask, view=view)
    assert seen.dead_ends == 0  # the border of the view cuts all three
    assert seen.area_density == (mask & view).sum() / view.sum()
    assert vessel_statistics(mask, view=np.ones_like(mask)).area_density == mask.mean()


def test_a_crossing_is_one_junction_and_no_bifurcation():
    mask = stroke([(20, 20), (130, 130)], 3) | stroke([(20, 110), (130, 40)], 2)
    lines = centre_lines(mask)
    assert sorted(map(len, lines.branches())) == [1, 1, 1, 1, 4]
    assert len(vessel_statistics(mask).angles) == 0


def test_rough_edges_make_no_branches():
    mask = stroke([(75, 10), (75, 140)], 5)
    mask[80, 20:130:10] = mask[81, 20:130:10] = True
    lines = centre_lines(mask)
    assert [one.length for one in lines.segments] == pytest.approx([135], abs=8)
    assert vessel_statistics(mask).summary()["dead_ends"] > 0


@pytest.mark.parametrize(
    ("mask", "dimension"),
    [
        (np.ones((128, 128)), 2.0),
        (np.eye(128), 1.0),
        (np.kron(*2 * [np.kron(*2 * [np.array([[1, 1], [0, 1]])])]), np.log2(3)),
    ],
)
def test_boxes_count_the_dimension(mask, dimension):
    assert box_dimension(mask, smallest=1) == pytest.approx(dimension, abs=0.03)


@pytest.mark.parametrize(
    "mask", [np.hypot(ROWS - 75, COLUMNS - 75) < 1, abs(np.hypot(ROWS - 75, COLUMNS - 75) - 40) < 3]
)
def test_what_has_no_bifurcation_has_no_angle(mask):
    told = vessel_statistics(mask).summary()
    assert np.isnan(
        [told["branching_angle"], told["exponent"], told["tortuosity"], told["dead_ends"]]
    ).all()


@pytest.mark.parametrize(
    ("mask", "view", "message"),
    [
        (
            np.zeros((4, 4)),
            None,
            "expected a mask of shape .H, W. with vessels, got shape .4, 4. with 0",
        ),
        (np.ones(4), None, "expected a mask of shape .H, W. with vessels, got shape .4,."),
        (np.ones((4, 4)), np.ones((3, 4)), r"expected a view of shape \(4, 4\), got \(3, 4\)"),
    ],
)
def test_what_is_no_mask_is_refused(mask, view, message):
    with pytest.raises(InvalidInputError, match=message):
        vessel_statistics(mask, view=view)
