"""The data behind the figures of paper W: the numbers that hold, and those that do not."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from tests.goal_sweeps import sweep_goals
from tests.reference import disk_reach as reference

from shoal.core.errors import InvalidInputError
from shoal.papers.steering.figures import (
    disk_fractions,
    largest_two_move_fraction,
    polygon_fractions,
    swap_antipodes,
)
from shoal.papers.steering.shortest_paths import DISK_GOALS, DISK_START, SQUARE_CASES
from shoal.steering import (
    ContactWorld,
    disk,
    disk_reach,
    open_workspace,
    polygon,
    polygon_reach,
    reached_in_two_moves,
    regular_polygon,
)


def test_fractions_of_the_disk_are_those_of_the_paper() -> None:
    data = disk_fractions([0.1, 0.001])
    assert data.moves.tolist() == [2, 4, 6, 8, 10, 12, 14]
    np.testing.assert_allclose(
        100 * data.fractions[0], [6.34, 30.1, 55.7, 74.9, 86.5, 93.0, 96.5], atol=0.15
    )
    assert 100 * data.fractions[1, -1] == pytest.approx(89.8, abs=0.05)


def test_more_contacts_change_hardly_anything() -> None:
    few, many = (
        disk_fractions([0.001, 0.1, 0.3], directions=directions).fractions
        for directions in (720, 1440)
    )
    np.testing.assert_allclose(few, many, atol=3e-4)


@pytest.mark.parametrize("distance", [0.05, 0.3, 0.9])
def test_radii_of_the_disk_agree_with_the_sets(distance: float) -> None:
    radii = [reach.radii for reach in disk_reach(distance, moves=6)]
    angles = pi * (np.arange(360) + 0.5) / 360
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for e, far in zip(around[::5], radii[0][::5], strict=True):
        assert far < 1e-3 or reached_in_two_moves(disk(), (distance, 0), 0.995 * far * e)
        assert not reached_in_two_moves(disk(), (distance, 0), min(1, 1.005 * far + 1e-6) * e)
    depths = reference.depths_of(distance, moves=6, radius=0.5, contacts=360)
    for deep, far in zip(depths[1:], radii[1:], strict=True):
        inside, outside = (
            reference.contains(deep, 0.5, around * share[:, None])
            for share in (far * 0.98, far * 1.001 + 1e-3)
        )
        assert inside.mean() > 0.98  # it looks at few contacts, and says no too often
        assert not outside.any()


def test_two_moves_reach_most_from_where_the_paper_says_and_a_little_more() -> None:
    distance, fraction = largest_two_move_fraction()
    assert 0.80 < distance < 0.83
    assert fraction == pytest.approx(0.377, abs=5e-4)
    near = disk_fractions([0.81], moves=2).fractions[0, 0]
    assert near < fraction
    assert near > 0.3765  # the paper: 0.373


def test_the_longest_difference_grows_by_square_roots() -> None:
    for cycle, reach in enumerate(disk_reach(0.01, moves=10), start=1):
        assert reach.radii.max() == pytest.approx(0.01 ** (1 / 2**cycle), rel=2e-3)


def test_outlines_have_the_radii_all_around() -> None:
    outline = disk_reach(0.3, moves=2)[0].outline
    area = 0.5 * abs(
        np.sum(
            outline[:, 0] * np.roll(outline[:, 1], -1) - outline[:, 1] * np.roll(outline[:, 0], -1)
        )
    )
    assert area / pi == pytest.approx(disk_fractions([0.3], moves=2).fractions[0, 0], rel=1e-2)


@pytest.mark.parametrize(
    ("sides", "before", "moves"),
    [
        (3, (0.43, 0.36), 6),
        (4, (0.27, 0.11), 6),
        *((n, (0.13, 0.06), 6) for n in (5, 6)),
        *((n, (0.13, 0.06), 8) for n in (7, 8)),
    ],
)
def test_moves_that_fill_regular_polygons(
    sides: int, before: tuple[float, float], moves: int
) -> None:
    """The paper has 4 for the triangle and 6 for seven and eight sides."""
    filling = polygon_fractions(regular_polygon(sides), before)
    assert filling.moves == moves
    assert (np.diff(filling.fractions) >= -1e-12).all()


def test_four_moves_of_the_square_miss_one_corner() -> None:
    filling = polygon_fractions(open_workspace("square"), (0.27, 0.11), moves=4)
    assert 1 - filling.fractions[1] == pytest.approx(0.27 * 0.11 / 4, rel=0.1)
    assert filling.moves is None


def test_four_moves_of_a_triangle_may_miss_much() -> None:
    missing = 1 - polygon_fractions(regular_polygon(3), (0.43, 0.36), moves=4).fractions[1]
    assert 0.03 < missing < 0.10
    # obtuse: six, as the paper has it
    assert polygon_fractions(polygon([(0, 0), (1, 0), (0.3, 0.25)]), (0.4, 0.1)).moves == 6


def test_areas_of_polygons_agree_with_sampled_sets() -> None:
    filling = polygon_fractions(regular_polygon(6), (0.2, 0.1), moves=6)
    space = filling.workspace.differences
    steps = (np.arange(60) + 0.5) / 30 - 1
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    sampled = [reach.contains(grid[space.depth(grid) > 0]).mean() for reach in filling.sets]
    # as the command, its figure and the union of all pieces have it
    assert round(100 * filling.fractions[0], 2) == 15.54
    np.testing.assert_allclose(filling.fractions, sampled, atol=1e-2)
    reach = polygon_reach(regular_polygon(5), (0.2, 0.1), moves=4)[1]
    assert reach.contains(0.9999 * reach.outline).all()
    assert not reach.contains(1.01 * reach.outline + 1e-3).all()


def test_the_printed_error_law_is_that_of_particle_2_always_touching() -> None:
    second, nearer = swap_antipodes(toucher="second"), swap_antipodes()
    coefficient, exponent = second.law()
    assert exponent == pytest.approx(3, abs=0.2)
    late = second.lengths > 4
    np.testing.assert_allclose(second.errors[late], 8.66 / second.lengths[late] ** 3, rtol=0.2)
    assert coefficient == pytest.approx(8.66, rel=0.3)
    np.testing.assert_allclose(nearer.errors, second.errors, rtol=1e-6)  # the same differences
    assert 9 < second.length_to(0.01) < 9.6
    assert nearer.length_to(0.01) < 4.5
    assert swap_antipodes(turn=pi / 2).length_to(0.01) == pytest.approx(2.6, abs=0.1)


@pytest.mark.parametrize("toucher", ["nearer", "second"])
def test_swaps_hold_when_they_are_played(toucher: str) -> None:
    swap = swap_antipodes(toucher=toucher, cycles=25)  # type: ignore[arg-type]  # one of the two
    states = ContactWorld(disk()).play(swap.start, [*swap.moves])
    left = swap.goal - states[2::2]
    np.testing.assert_allclose(
        np.linalg.norm(left[:, 1] - left[:, 0], axis=1) / 2, swap.errors, atol=1e-9
    )
    last = swap.goal.mean(axis=0) - states[-1].mean(axis=0)
    assert np.linalg.norm(swap.moves, axis=1).sum() + np.linalg.norm(last) == pytest.approx(
        swap.lengths[-1]
    )
    end = ContactWorld(disk()).play(states[-1], [last])[-1]
    np.testing.assert_allclose(np.linalg.norm(end - swap.goal, axis=1), swap.errors[-1], atol=1e-9)


def test_a_goal_in_the_middle_makes_the_numbers_of_moves_symmetrical() -> None:
    sweep = sweep_goals(disk(), DISK_START, DISK_GOALS[0], samples=13)
    assert sweep.unsolved == 0
    assert np.isfinite(sweep.moves).sum() == np.isfinite(sweep.lengths).sum() > 100
    # Both starts lie on the line x = y, and a goal in the middle breaks nothing.
    assert np.nanmean(sweep.moves == sweep.moves.T) > 0.75
    other = sweep_goals(disk(), DISK_START, DISK_GOALS[1], samples=13)
    assert np.nanmax(other.moves) > np.nanmax(sweep.moves)


def test_interchangeable_particles_need_no_longer_plans() -> None:
    start, goal = SQUARE_CASES[2]
    one, either = (
        sweep_goals(
            open_workspace("square"), start, goal, varied=1, samples=9, interchangeable=both
        )
        for both in (False, True)
    )
    assert one.unsolved == either.unsolved == 0
    assert (either.lengths <= one.lengths + 1e-9).all()
    assert np.max(either.lengths) < 0.8 * np.max(one.lengths)


@pytest.mark.parametrize(
    "what",
    [
        lambda: disk_fractions([0.0]),
        lambda: disk_fractions([]),
        lambda: disk_fractions([0.1], directions=4),
        lambda: disk_fractions([0.1], moves=3),
        lambda: disk_reach(1.5, moves=2),
        lambda: swap_antipodes(apart=1.0),
        lambda: swap_antipodes(cycles=0),
        lambda: swap_antipodes(toucher="first"),  # type: ignore[arg-type]  # refused
        lambda: sweep_goals(disk(), DISK_START, (0, 0), samples=1),
        lambda: sweep_goals(disk(), DISK_START, (0, 0), varied=3),
        lambda: swap_antipodes(cycles=1).law(),
    ],
)
def test_wrong_input_is_refused(what: object) -> None:
    with pytest.raises(InvalidInputError, match="expected"):
        what()  # type: ignore[operator]  # a function
