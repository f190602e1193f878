"""The figures of paper W are drawn: what they say, and that nothing is missing from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.goal_sweeps import sweep_goals

from shoal.core.errors import InvalidInputError
from shoal.papers.steering.figures import (
    antipode_errors,
    disk_fractions,
    disk_sets,
    fraction_curves,
    goal_maps,
    polygon_fractions,
    reachable_sets,
    swap_antipodes,
)
from shoal.papers.steering.shortest_paths import DISK_GOALS, DISK_START, SQUARE_CASES, GoalSweep
from shoal.steering import disk, open_workspace, regular_polygon
from shoal.views.drawing.charts import save_figure


@pytest.fixture(scope="module")
def sweep() -> GoalSweep:
    return sweep_goals(disk(), DISK_START, DISK_GOALS[0], samples=7)


def test_reachable_sets_say_which_share_is_reached(tmp_path: Path) -> None:
    fillings = [
        polygon_fractions(regular_polygon(n), (0.2, 0.1), moves=6, contacts=9) for n in (3, 4, 6)
    ]
    figure = reachable_sets(fillings)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:2] == ["3 sides", f"{100 * fillings[0].fractions[0]:.1f}, 100 %"]
    assert titles[4] == "6 sides"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "2 moves",
        "4 moves",
        "6 moves",
        "Δ at the start",
    ]
    save_figure(figure, tmp_path / "sets.png")
    assert len(reachable_sets(fillings[:1]).axes) == 2
    with pytest.raises(InvalidInputError, match="at least one polygon"):
        reachable_sets([])


def test_sets_of_the_disk_have_a_panel_for_each_distance(tmp_path: Path) -> None:
    figure = disk_sets([0.1, 0.5, 0.9], moves=4)
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        f"{d:g} diameters apart" for d in (0.1, 0.5, 0.9)
    ]
    save_figure(figure, tmp_path / "disk.png")
    with pytest.raises(InvalidInputError, match="distance"):
        disk_sets([1.5])


def test_fraction_curves_show_what_is_printed_in_the_paper(tmp_path: Path) -> None:
    data = disk_fractions([0.05, 0.1, 0.5, 1.0], moves=4, directions=60)
    figure = fraction_curves(data)
    axes = figure.axes[0]
    assert axes.get_xlabel() == "distance at the start, diameters"
    lines = {str(line.get_label()): line for line in axes.lines}
    np.testing.assert_allclose(lines["4 moves"].get_ydata(), 100 * data.fractions[:, 1])
    np.testing.assert_allclose(sorted(np.asarray(lines["printed"].get_ydata())), [6.3, 30, 37.3])
    save_figure(figure, tmp_path / "fractions.png")


def test_goal_maps_have_a_bar_for_each_column_or_row(sweep: GoalSweep, tmp_path: Path) -> None:
    figure = goal_maps([[(sweep, "moves"), (sweep, "length")]] * 2)
    bars = [axes.get_ylabel() for axes in figure.axes[4:]]
    assert bars == ["moves", "length of the plan"]
    assert figure.axes[1].get_title(loc="left") == f"length ≤ {np.nanmax(sweep.lengths):.3g}"
    save_figure(figure, tmp_path / "disk.png")
    start, goal = SQUARE_CASES[0]
    both = sweep_goals(
        open_workspace("square"), start, goal, varied=1, samples=4, interchangeable=True
    )
    figure = goal_maps([[(both, "length")], [(both, "moves")]])
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "y of that goal",
        "y of that goal",
        "length of the plan",
        "moves",
    ]
    assert figure.axes[1].get_xlabel() == "x of the goal of particle 1"
    assert "interchangeable" in figure.axes[0].get_title(loc="left")
    save_figure(figure, tmp_path / "square.png")


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_goal_maps_of_nothing_or_of_anything_else_are_refused(sweep: GoalSweep, rows: int) -> None:
    wrong = ([], [[(sweep, "moves")], []], [[(sweep, "cost")]])[rows]
    with pytest.raises(InvalidInputError, match="goal maps: expected"):
        goal_maps(wrong)


def test_antipode_errors_show_the_printed_law_and_ours(tmp_path: Path) -> None:
    # literals
    second, nearer = (swap_antipodes(toucher=who, cycles=20) for who in ("second", "nearer"))  # type: ignore[arg-type]
    figure = antipode_errors(second, nearer, (swap_antipodes(cycles=20, turn=1.0), "turned"))
    axes = figure.axes[0]
    labels = [str(line.get_label()) for line in axes.lines]
    assert labels[0].startswith("particle 2 always touches")
    assert {"the nearer particle touches", "turned", "printed: 8.66 / length³"} <= set(labels)
    assert axes.get_yscale() == "log"
    assert axes.get_xlabel() == "length of the plan, diameters"
    save_figure(figure, tmp_path / "errors.png")
