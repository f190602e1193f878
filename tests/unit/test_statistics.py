"""Means with intervals: against SciPy, against what they promise, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.lab import Store, Sweep, run_sweep
from shoal.lab.statistics import compare, compare_along, estimate, number_text, summarise

NUMBER = {"kind": "function", "function": "tests.unit.sweep_functions:number"}


def test_student_interval_is_that_of_scipy():
    values = np.random.default_rng(1).normal(5, 2, 17)
    found = estimate(values, level=0.9, method="t")
    low, high = stats.t.interval(0.9, 16, loc=values.mean(), scale=stats.sem(values))
    assert (found.low, found.high) == pytest.approx((low, high))
    assert (found.mean, found.std, found.count) == (values.mean(), values.std(ddof=1), 17)


def test_counts_get_intervals_on_a_logarithmic_scale_which_hold_a_skewed_mean_more_often():
    few = [3, 900, 12, 5]
    assert estimate(few, method="t").low < 0 < estimate(few).low
    assert (estimate(few).method, estimate([-1, 2, 3]).method) == ("log", "t")
    rng, held = np.random.default_rng(5), {"t": 0, "log": 0}
    for _ in range(1000):
        values = rng.lognormal(0, 1, 8)
        for method in held:
            found = estimate(values, method=method)
            held[method] += found.low <= np.exp(0.5) <= found.high
    assert held["log"] > held["t"] + 20


@pytest.mark.parametrize("method", ["t", "bootstrap"])
def test_intervals_hold_the_mean_as_often_as_they_say(method):
    rng, times = np.random.default_rng(3), 150 if method == "bootstrap" else 2000
    held = (
        sum(
            (e := estimate(rng.normal(0, 1, 30), method=method)).low <= 0 <= e.high
            for _ in range(times)
        )
        / times
    )
    assert abs(held - 0.95) < 4.5 * (0.95 * 0.05 / times) ** 0.5 + 0.01


def test_intervals_are_told_with_four_digits():
    assert str(estimate([446.8331, 515.04, 460.177], method="t")) == "474 [384.2, 563.8]"
    assert [number_text(value) for value in (0, 0.123456, 9.99996, 123456.7, -2.5e-7, np.inf)] == [
        "0",
        "0.1235",
        "10",
        "123457",
        "-2.5e-07",
        "inf",
    ]


def test_single_and_equal_values():
    one, equal = estimate([3]), estimate([2, 2, 2])
    assert np.isnan([one.low, one.high, one.std]).all()
    assert str(one) == "3 (one trial: no interval)"
    assert (equal.low, equal.high, equal.std) == (2, 2, 0)


def test_pairs():
    a = np.array([10.0, 20, 30, 40, 50])
    found = compare(a, a - [1, 2, 3, 4, 5])
    assert found.difference.mean == -3
    assert found.effect == pytest.approx(-3 / np.std([1, 2, 3, 4, 5], ddof=1))
    assert (found.smaller, found.ratio) == (1.0, 0.9)
    assert found.p_value == pytest.approx(stats.wilcoxon([-1, -2, -3, -4, -5]).pvalue)
    assert compare(a, a).p_value == 1
    assert compare(a, a).effect == 0
    assert compare(a, a + 1).effect == np.inf
    # Paired values tell what unpaired ones hide.
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 100, 50)
    paired = compare(noise, noise + 1 + rng.normal(0, 0.1, 50)).difference
    assert paired.low > 0.9
    assert paired.high < 1.1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: estimate([]), "one finite number or more"),
        (lambda: estimate([1, np.nan]), "one finite number or more"),
        (lambda: estimate(["x"]), "expected numbers"),
        (lambda: estimate([1, 2], level=1), "above 0 and below 1, got 1"),
        (lambda: estimate([1, 2], method="guess"), "one of auto, t, log, bootstrap, got 'guess'"),
        (lambda: estimate([-1, 2], method="log"), "values of 0 or more, got -1"),
        (lambda: compare([1, 2], [1]), "equal length with 2 values or more, got 2 and 1 values"),
        (lambda: compare([1], [1]), "equal length with 2 values or more, got 1 and 1 values"),
    ],
)
def test_bad_input(call, words):
    with pytest.raises(InvalidInputError, match=words):
        call()


def test_sweeps_are_summarised_and_compared_along_paired_axes(tmp_path):
    axes = {"factor": [1, 3], "pause": [0.0, 1e-6]}
    sweep = Sweep(name="s", problem=NUMBER, axes=axes, trials=9, seed=1, paired=("factor",))
    run_sweep(sweep, tmp_path / "s", workers=0)
    with Store(tmp_path / "s") as store:
        rows = summarise(store, "s", "value")
        assert [row.values for row in rows] == [dict(point.values) for point in sweep.points]
        values = {}
        for factor, pause, _, _, value, *_ in store.rows("s"):
            values.setdefault((factor, pause), []).append(value)
        assert [row.estimate.mean for row in rows] == [
            np.mean(values[tuple(row.values.values())]) for row in rows
        ]
        assert all(row.missing == 0 for row in rows)
        pairs = compare_along(store, "s", "value", "factor")
        assert [(others, first, second) for others, first, second, _ in pairs] == [
            ({"pause": p}, 1, 3) for p in (0.0, 1e-6)
        ]
        assert all(found.ratio == pytest.approx(3) for *_, found in pairs)
        with pytest.raises(InvalidInputError, match=r"expected a paired axis \(factor\)"):
            compare_along(store, "s", "value", "pause")
        with pytest.raises(
            InvalidInputError, match="measure: expected one of value, half, word, got 'moves'"
        ):
            summarise(store, "s", "moves")
        with pytest.raises(InvalidInputError, match="expected a measure with numbers, got 'word'"):
            summarise(store, "s", "word")
        with pytest.raises(UnknownNameError, match="no sweep 't'"):
            summarise(store, "t", "value")


def test_trials_that_did_not_finish_are_counted_and_never_averaged_as_if_they_had(tmp_path):
    problem = {"kind": "swarm", "map": "line:40", "particles": 1}
    axes = {"policy": ["closest-frontier", "random-moves"], "max_moves": [5, 5000]}
    sweep = Sweep(name="s", problem=problem, axes=axes, trials=6, paired=("policy",))
    run_sweep(sweep, tmp_path / "s", workers=0)
    with Store(tmp_path / "s") as store:
        rows = {
            (row.values["policy"], row.values["max_moves"]): row
            for row in summarise(store, "s", "moves")
        }
        all_of = {key: [] for key in rows}
        for policy, most, _, _, status, moves, *_ in store.rows("s"):
            all_of[policy, most].append((status, moves))
        for key, row in rows.items():
            done = [moves for status, moves in all_of[key] if status == "complete"]
            assert (row.counted, row.completed) == (6, len(done))
            if len(done) == 6:
                assert (row.bound, row.estimate.mean) == (None, np.mean(done))
                assert "completed" not in str(row)
            elif not done:
                assert row.estimate is None
                assert str(row) == f"more than {key[1]}: 0 of 6 trials completed"
            else:
                assert row.estimate.mean == np.mean(
                    [min(moves, key[1]) for _, moves in all_of[key]]
                )
                assert str(row).startswith(f"restricted mean to {key[1]}: ")
                assert str(row).endswith(f"({len(done)} of 6 trials completed)")
        assert {len([m for s, m in all_of[key] if s == "complete"]) for key in rows} >= {0, 6}
        assert any(0 < row.completed < 6 for row in rows.values())
        compared = {
            others["max_moves"]: found
            for others, _, _, found in compare_along(store, "s", "moves", "policy")
        }
        assert compared[5] is None
        assert compared[5000].unfinished > 0
        assert compared[5000].bound == 5000
        assert "restricted to 5000" in str(compared[5000])
        shares = summarise(store, "s", "distance")
        assert [row.completed for row in shares] == [row.completed for row in rows.values()]


def test_intervals_of_two_lines_do_not_hide_each_other():
    """The figure of a sweep: the intervals at one value of the axis stand side by side, and their
    mean stays in its place.
    """
    from shoal.lab.statistics import Estimate, Row
    from shoal.views.drawing.curves import means_figure

    for places in ([10, 100], [-1, 1]):
        means = [
            Row({"n": n, "policy": policy}, Estimate(3.0, 2.0, 4.0, 1.0, 9, 0.95, "t"), 0, 9)
            for policy in ("a", "b")
            for n in places
        ]
        axes = means_figure(means, title="mine", measure="moves").axes[0]
        first, second = (
            axes.transData.transform(np.column_stack([line[0].get_xdata(), line[0].get_ydata()]))[
                :, 0
            ]
            for line in axes.containers
        )
        middle = axes.transData.transform([(place, 3.0) for place in places])[:, 0]
        assert (second - first > 3).all()
        assert np.allclose((first + second) / 2, middle)
        assert axes.get_ylabel() == "mean moves, with 95 % confidence intervals"


def test_differences_by_the_method_log_are_ratios_on_a_log_scale():
    rng = np.random.default_rng(3)
    a = rng.lognormal(3, 1, size=400)
    found = compare(a, 2 * a * rng.lognormal(0, 0.05, size=400), method="log")
    assert found.ratio_low < 2 < found.ratio_high < 2.05
    # symmetric on a log scale
    assert found.ratio_low * found.ratio_high == pytest.approx(found.ratio**2)
    assert found.difference.method == "t"
    swapped = compare([9, 11, 12, 13], [10, 12, 14, 16], method="log")
    forth = compare([10, 12, 14, 16], [9, 11, 12, 13], method="log")
    assert (1 / swapped.ratio_high, 1 / swapped.ratio_low) == pytest.approx(
        (forth.ratio_low, forth.ratio_high)
    )
    assert compare([10, 12], [9, 11]).ratio_low is None
    with pytest.raises(InvalidInputError, match="method log: expected values of 0 or more, got -1"):
        compare([1, -1, 3], [1, 2, 3], method="log")
    assert np.isnan(compare([0, 0, 0], [1, 2, 3], method="log").ratio_low)


def test_intervals_of_ratios_hold_the_ratio_as_often_as_they_say():
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(400):
        shared = rng.lognormal(4, 0.5, size=15)
        a, b = (
            shared * rng.lognormal(0, 0.3, size=15),
            1.5 * shared * rng.lognormal(0, 0.3, size=15),
        )
        found = compare(a, b, method="log")
        held += found.ratio_low <= 1.5 <= found.ratio_high
    assert 0.9 < held / 400 < 0.99
