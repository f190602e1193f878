"""shoal line, shoal schedule, and --scan-every: fields, figures, refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from math import log

import numpy as np
import pytest
from tests.swarm_runs import run as play

from shoal import open_map
from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, GridWorld, SwarmEpisode
from shoal.swarm.grid.scans import ScanRule, states_of_run
from shoal.swarm.kernels import episodes as kernels
from shoal.swarm.theory.one_dimension import Line, boundary_moves, coverage_moves, sample
from shoal.swarm.theory.scan_schedules import (
    Custom,
    EqualSteps,
    Hyperexponential,
    Powers,
    least_simultaneous_ratio,
    optimal_schedule,
    worst_of_both,
)
from shoal.views import film
from shoal.views.drawing.encoding import LONGEST
from shoal.views.swarm.films import scan_strip


def printed(capsys, *words):
    assert run([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_json_of_line(capsys):
    result = printed(
        capsys,
        "line",
        "--cells",
        "1000",
        "--particles",
        "10",
        "--monte-carlo",
        "20000",
        "--seed",
        "3",
    )
    assert result["cells"] == 1000
    assert result["particles"] == 10
    assert result["trials"] == 20000
    exact = Line(1000, 10)
    for name in ("boundary", "coverage", "largest_gap"):
        row = result[name]
        assert row["exact"] == pytest.approx(float(getattr(exact, name).exact))
        assert row["printed"] == pytest.approx(float(getattr(exact, name).printed))
        assert abs(row["monte_carlo"] - row["exact"]) < 5 * row["standard_error"]
    assert printed(capsys, "line", "--cells", "50", "-n", "5")["coverage"]["monte_carlo"] is None


def test_what_is_printed_names_its_equation(capsys):
    """Eq. 2 of paper D gives 15 for one particle in nine cells, eq. 1 of both papers 14."""
    row = printed(capsys, "line", "--cells", "9", "-n", "1")["boundary"]
    assert (row["exact"], row["exact_in"]) == (14, "papers M and D, eq. 1")
    assert (row["printed"], row["printed_in"]) == (15, "paper D, eq. 2")
    assert (
        printed(capsys, "line", "--cells", "9", "-n", "2")["boundary"]["exact_in"]
        == "paper M, eq. 2"
    )
    assert run(["line", "--cells", "9", "-n", "1"]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "14.0000 exact (papers M and D, eq. 1), 15.0000 by paper D, eq. 2 (+1.0000)" in told
    assert "as printed" not in told


def test_long_lines_have_monte_carlo_only(capsys):
    result = printed(capsys, "line", "--cells", "20000", "-n", "30", "--monte-carlo", "500")
    assert result["coverage"]["exact"] is None
    assert result["boundary"]["exact"] == pytest.approx(3 * 20001 / 31)
    assert result["coverage"]["monte_carlo"] > result["boundary"]["monte_carlo"]
    huge = printed(capsys, "line", "--cells", "1000000000", "-n", "400000000")
    assert huge["boundary"]["exact"] == pytest.approx(7.5)
    for cells, particles in ((500, 3), (500, 498), (3000, 1500)):
        assert Line(cells, particles).boundary_float == float(Line(cells, particles).boundary.exact)


def test_line_draws(tmp_path, capsys):
    out = tmp_path / "line"
    assert (
        run(["line", "--cells", "60", "-n", "5", "--monte-carlo", "2000", "--out", str(out)]) == 0
    )
    assert {path.name for path in out.iterdir()} == {"gaps.png", "moves.png", "summary.json"}
    shown = capsys.readouterr().out
    assert "by Monte Carlo" in " ".join(shown.split())
    assert run(["line", "--cells", "60", "-n", "60", "--out", str(tmp_path / "full")]) == 0
    assert {path.name for path in (tmp_path / "full").iterdir()} == {"gaps.png", "summary.json"}


def test_json_of_schedule(capsys):
    result = printed(
        capsys, "schedule", "--scan-cost", "10", "--move-cost", "1", "--max-distance", "500"
    )
    assert result["optimal"]["positions"][:2] == [15, 30]
    assert result["optimal"]["positions"][-1] == 501
    assert result["optimal"]["worst_ratio"] == pytest.approx(5 / 3)
    assert [one["name"] for one in result["schedules"]] == [
        "every step",
        "powers of 2",
        "powers of 4",
        "i^i",
        "one jump",
    ]
    for one in result["schedules"]:
        assert one["worst_ratio"] >= result["optimal"]["worst_ratio"]


def test_schedule_of_any_distance(tmp_path, capsys):
    result = printed(
        capsys,
        "schedule",
        "--scan-cost",
        "1",
        "--move-cost",
        "2",
        "--max-distance",
        "1e100",
        "--out",
        str(tmp_path / "out"),
    )
    assert result["max_distance"] == 10**100
    hyper = result["schedules"][3]
    assert hyper["moves"] == 57**57
    assert hyper["scans"] == 58
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"ratios.png", "summary.json"}
    for distance in ("0", "1", "2"):
        assert (
            run(
                [
                    "schedule",
                    "--scan-cost",
                    "3",
                    "--move-cost",
                    "1/3",
                    "--max-distance",
                    distance,
                    "--out",
                    str(tmp_path / "out"),
                ]
            )
            == 0
        )
    assert (
        run(["schedule", "--scan-cost", "1", "--move-cost", "1", "--max-distance", "10^400"]) == 0
    )


def test_map_counts_scans_and_cost(tmp_path, capsys):
    words = (
        "map",
        "cave:30x20",
        "-n",
        "20",
        "--trials",
        "2",
        "--scan-cost",
        "7",
        "--move-cost",
        "0.5",
    )
    adaptive = printed(capsys, *words, "--scan-every", "adaptive", "--out", str(tmp_path))
    every = printed(capsys, *words)
    for result in (adaptive, every):
        costs = [
            7 * scans + 0.5 * moves
            for scans, moves in zip(result["scans"], result["moves"], strict=True)
        ]
        assert result["cost"] == pytest.approx(costs)
        assert result["mean_cost"] == pytest.approx(sum(costs) / 2)
    assert every["scans"] == [moves + 1 for moves in every["moves"]]
    assert adaptive["mean_cost"] < every["mean_cost"] / 2
    episode = SwarmEpisode.load(tmp_path / "episodes" / "00000.npz")
    assert (episode.problem.scanning.every, episode.scans) == ("adaptive", adaptive["scans"][0])


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("line --cells 0 -n 1", "cells: expected a whole number from 1 to 9007199254740992, got 0"),
        ("line --cells 4 -n 9", "particles: expected a whole number from 1 to 4"),
        (
            "line --cells 4 -n 2 --monte-carlo 0",
            "trials: expected a whole number from 1 to 100000000, got 0",
        ),
        (
            "line --cells 4 -n 2 --monte-carlo 5 --seed -1",
            "seed: expected a whole number, 0 or more, got -1",
        ),
        (
            "line --cells 4 -n 2 --monte-carlo 5 --workers 0",
            "workers: expected a whole number, 1 or more, got 0",
        ),
        (
            "schedule --scan-cost x --move-cost 1",
            "scan cost: expected a number of at most 300 digits, got 'x'",
        ),
        ("schedule --scan-cost 1 --move-cost -2", "move cost: expected 0 or more, got -2"),
        ("schedule --scan-cost nan --move-cost 1", "got 'nan'"),
        ("schedule --scan-cost 0 --move-cost 0", "got 0 for both"),
        ("schedule --scan-cost 1e999999999 --move-cost 1", "at most 300 digits, got '1e999999999'"),
        ("schedule --scan-cost 1 --move-cost 1/0", "move cost: expected a number"),
        (
            "schedule --scan-cost 1 --move-cost 1 --max-distance -1",
            "--max-distance: expected a whole number",
        ),
        (
            "schedule --scan-cost 1 --move-cost 1 --max-distance 1.5",
            "--max-distance: expected a whole number",
        ),
        ("schedule --scan-cost 1 --move-cost 1 --max-distance 9e9999", "at most 1000 digits"),
        ("schedule --scan-cost 1 --move-cost 1 --max-distance 99^9999", "at most 1000 digits"),
        (
            "map line:5 -n 2 --scan-every 0",
            "scan_every: expected a whole number from 1 to 1000000000, got 0",
        ),
        ("map line:5 -n 2 --scan-every often", "got 'often'"),
        (
            "map line:5 -n 2 --scan-cost -1",
            "scan_cost: expected a number from 0 to 1e+100, got -1.0",
        ),
        (
            "map line:5 -n 2 --move-cost inf",
            "move_cost: expected a number from 0 to 1e+100, got inf",
        ),
        ("map line:5 -n 2 --move-cost 0 --scan-cost 0", "got 0 for both"),
        ("map line:5 -n 2 --scan-every 2 --rule tilt", "expected 1 under rule tilt"),
        ("map line:5 -n 2 --scan-every 2 --policy sweep", "expected 1 for policy sweep"),
        (
            "map line:5 -n 2 --scan-every adaptive --policy random-moves",
            "expected a number, or the policy closest-frontier for adaptive",
        ),
    ],
)
def test_refusals(words, wanted, tmp_path, capsys):
    out = tmp_path / "out"
    assert run([*words.split(), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    assert wanted in captured.err
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("call", "wanted"),
    [
        (
            lambda: boundary_moves([3, 3], cells=5),
            "each larger than the one before, got 3 and then 3",
        ),
        (lambda: coverage_moves([[1, 2], [4, 2]], cells=5), "got 4 and then 2"),
        (lambda: coverage_moves([0, 2], cells=5), "expected 1 to 5, got 0 to 2"),
        (lambda: coverage_moves([0.5], cells=5), "expected whole numbers"),
        (lambda: Line(5, True), "particles: expected a whole number from 1 to 5, got True"),
        (lambda: sample(Line(2**31, 3), 1), "line: expected at most 2147483647 cells"),
        (lambda: sample(Line(5, 3), 10**12), "trials: expected a whole number from 1 to 100000000"),
        (lambda: sample(Line(10**9, 5 * 10**8), 1), "line: expected at most 10000000 particles"),
        (lambda: Powers(1), "base: expected a whole number, 2 or more, got 1"),
        (lambda: EqualSteps(0), "1 or more, got 0"),
        (lambda: Custom([]), "expected one position at least, got none"),
        (lambda: Custom([3, 3]), "position 2, after 3: expected a whole number, 4 or more, got 3"),
        (lambda: Custom([3]).cost(3), "expected a distance below its last position, 3, got 3"),
        (
            lambda: Custom([3]).worst(scan_cost=1, move_cost=1, max_distance=3),
            "below its last position, 3, got 3",
        ),
        (lambda: Powers(2).cost(-1), "distance: expected a whole number, 0 or more, got -1"),
        (
            lambda: optimal_schedule(scan_cost=1, move_cost=1, max_distance=9).cost(10),
            "expected a distance up to 9, got 10",
        ),
        (lambda: ScanRule("often"), "got 'often'"),
    ],
)
def test_refusals_of_the_library(call, wanted):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert wanted in str(caught.value)


def test_numbers_of_all_kinds_are_taken():
    rule = ScanRule("equal", np.int64(3), Fraction(1, 4), Decimal("0.5"))
    assert (rule.step, rule.scan_cost, rule.move_cost) == (3, 0.25, 0.5)
    assert Powers(np.int64(3)).cost(np.int32(5)) == Powers(3).cost(5)
    assert optimal_schedule(
        scan_cost=Decimal(10), move_cost=np.float64(1), max_distance=np.int64(50)
    ).guarantee.ratio == Fraction(97, 59)


def test_a_scan_that_no_run_explains_is_refused():
    world = GridWorld(GridWorkspace(np.ones((2, 6), dtype=bool)))
    before = world.initial([(0, 1), (1, 2)])
    for cells, wanted in (
        ([(0, 2), (0, 4)], "expected every particle in its line"),
        ([(0, 2)], "expected every particle in its line"),
        ([(0, 5), (1, 3)], "got a particle from (0, 1) at (0, 5)"),
        ([(0, 0), (1, 3)], "got a particle from (0, 1) at (0, 0)"),
    ):
        with pytest.raises(InvalidInputError) as caught:
            states_of_run(before, world.initial(cells), "r", 3)
        assert wanted in str(caught.value)


def test_i_to_the_i_is_exact_for_any_distance():
    for exponent, moves, scans in ((3, 5**5, 6), (6, 8**8, 9), (12, 12**12, 13), (100, 57**57, 58)):
        cost = Hyperexponential().cost(10**exponent)
        assert (cost.moves, cost.scans) == (moves, scans)
        assert cost.move_ratio == Fraction(moves, 10**exponent + 1)
        assert cost.scan_ratio == Fraction(scans, 2)


def test_theorem_1_in_numbers():
    """Both what i^i does and what is possible at best stay within constant factors of log D / log
    log D.
    """
    for exponent in (3, 6, 12, 25, 50, 100):
        rate, best = (
            log(10**exponent) / log(log(10**exponent)),
            least_simultaneous_ratio(10**exponent).ratio,
        )
        mine = worst_of_both(Hyperexponential(), 10**exponent)
        assert best <= mine <= 5 * best
        assert 0.5 * rate < best < 1.1 * rate


def test_intervals_of_kernels_are_those_of_the_rules():
    for every in ("1", "5", "doubling", "hyper"):
        rule = ScanRule.parse(every)
        kind = {"equal": kernels.EQUAL, "doubling": kernels.DOUBLING, "hyper": kernels.HYPER}[
            rule.kind
        ]
        lengths = [rule.interval(streak) for streak in range(60)]
        assert lengths == [kernels.interval(kind, rule.step, streak) for streak in range(60)]
        positions = np.cumsum(lengths[:8]).tolist()
        schedule = {"doubling": Powers(2), "hyper": Hyperexponential()}.get(
            every, EqualSteps(rule.step)
        )
        assert positions == [
            position for position, _ in zip(schedule.positions(), range(8), strict=False)
        ]


@pytest.mark.parametrize("every", ["1", "2", "doubling", "hyper", "adaptive"])
def test_a_scan_that_is_missing_is_noticed(every):
    episode = play(open_map("cave:30x20"), particles=9, scan_every=every)
    assert episode.verify()
    for move in np.flatnonzero(episode.trace.scanned)[::7].tolist():
        scanned = episode.trace.scanned.copy()
        scanned[move] = False
        same_way = move + 1 < episode.moves and episode.commands[move] == episode.commands[move + 1]
        verified = replace(episode, trace=episode.trace._replace(scanned=scanned)).verify()
        assert not verified or (same_way and every not in ("1", "2"))
    unseen = episode.trace._replace(scanned=np.zeros(episode.moves, dtype=bool))
    assert not replace(episode, trace=unseen).verify()


def test_long_runs_are_no_reason_to_give_up():
    """A run that is longer than the patience with idle commands ends in idle ones."""
    for task in ("mapping", "coverage"):
        episode = play(
            GridWorkspace(np.ones((5, 30), dtype=bool)), task=task, particles=1, scan_every=1500
        )
        assert episode.status == "complete"
        assert episode.verify()
    assert play(open_map("line:600"), particles=1, scan_every="hyper").status == "complete"


@pytest.mark.parametrize("stepwise", [False, True])
@pytest.mark.parametrize("task", ["mapping", "coverage"])
def test_a_run_that_the_limit_cuts_is_looked_at(task, stepwise):
    episode = play(
        GridWorkspace([[1] * 9]),
        task=task,
        particles=1,
        scan_every=7,
        max_moves=17,
        stepwise=stepwise,
        seed=2,
    )
    assert episode.moves <= 17
    assert episode.trace.scanned[-1]
    assert episode.verify()
    assert list(episode.frames())[-1][1] == episode.final()[1]


def test_runs_go_on_into_the_unknown_but_not_past_a_turn():
    corridor = play(GridWorkspace([[1] * 12]), start=[(0, 0)], scan_every=4)
    # the wall is beside it, and yet the run is sent whole
    assert corridor.commands.startswith("llll")
    assert not corridor.trace.scanned[:3].any()
    assert corridor.trace.scanned[3]
    cave = play(open_map("cave:30x20"), particles=9, scan_every=5)
    pairs = zip(cave.commands, cave.commands[1:], cave.trace.scanned.tolist(), strict=False)
    assert all(scanned or command == following for command, following, scanned in pairs)
    assert len(cave.commands) > 2 * cave.scans


def test_films_show_scans(tmp_path, monkeypatch):
    for suffix in LONGEST:
        monkeypatch.setitem(LONGEST, suffix, 10)
    episode = play(GridWorkspace(np.ones((6, 20), dtype=bool)), particles=3, scan_every="adaptive")
    assert not episode.trace.scanned.all()
    film(episode, tmp_path / "film.gif")
    film(episode, tmp_path / "film.mp4")
    strip = scan_strip(episode.trace.scanned, 0, 42)
    assert (strip[1, 20] == 255).all()  # before the start
    assert not (strip[1, 21] == 255).any()  # the scan at the start
    assert [bool((strip[1, 22 + i] < 50).all()) for i in range(15)] == episode.trace.scanned[
        :15
    ].tolist()
