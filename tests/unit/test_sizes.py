"""Sizes that users bring: memory and work grow no faster than the data."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy import stats

import shoal
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.lab import Store, Sweep, merge_stores, run_sweep
from shoal.lab.batches import Answer, worker_versions
from shoal.lab.statistics import compare_along, estimate, measured, summarise
from shoal.lab.sweep import trial_seed
from shoal.swarm import SwarmEpisode

NUMBER = {"kind": "function", "function": "tests.unit.sweep_functions:number"}


def peak_of(call):
    """Return the most memory in MB that a call allocates through Python and NumPy."""
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(("count", "whole"), [(2, False), (30, True), (700, False)])
def test_the_bootstrap_is_that_of_scipy(count, whole):
    values = np.random.default_rng(count).exponential(5, count)
    values = np.ceil(values) if whole else values
    found = estimate(values, level=0.9, method="bootstrap", seed=3)
    rng = np.random.default_rng(3)
    ends = stats.bootstrap(
        (values,), np.mean, confidence_level=0.9, n_resamples=2000, rng=rng
    ).confidence_interval
    assert (found.low, found.high) == pytest.approx((ends.low, ends.high), rel=1e-12)


def test_the_bootstrap_of_many_trials_needs_little_memory():
    values = np.random.default_rng(0).exponential(5, 20_000)
    assert peak_of(lambda: estimate(values, method="bootstrap")) < 40


def stored(path, results, *, trials=None, measures=("value", "half", "word")):
    """Return a store of one point and these results, by trial number."""
    sweep = Sweep(name="s", problem=NUMBER, axes={"factor": [1]}, trials=trials or len(results))
    with Store(path, write=True) as store:
        store.add(sweep, {})
        ((gap, *_),) = [store.missing(sweep)]
        rows = [
            (gap.id, trial, trial_seed(sweep.seed, gap.point.seeds, trial), result)
            for trial, result in results.items()
        ]
        store.commit(sweep, Answer(rows, [], 0.5, [], worker_versions(), "test"))
    return path


def test_a_measure_is_read_with_all_digits_gaps_and_holes(tmp_path):
    exact = [0.1 + 0.2, 1e-300, 12345678901234567, 1 / 3, -2.5e17, True]
    texts = ["0.30000000000000004", "1e-300", "12345678901234567", repr(1 / 3), "-2.5e17", "true"]
    trials = [0, 1, 2, 9_999, 10_000, 25_000]
    results = {trial: f'[{text}, 0.5, "a]"]' for trial, text in zip(trials, texts, strict=True)} | {
        30_000: '[null, 1, ",null]"]'
    }
    with Store(stored(tmp_path / "s", results, trials=40_000)) as store:
        (point,) = measured(store, "s", "value")
        assert point.trials.tolist() == trials
        assert point.values.tolist() == [float(value) for value in exact]
        (row,) = summarise(store, "s", "value")
        assert (row.counted, row.missing) == (6, 40_000 - 6)
        rows = {trial: value for _, trial, _, value, *_ in store.rows("s")}
        assert [rows[trial] for trial in trials] == exact


@pytest.mark.parametrize("value", ["[2]", "[2, null]", '"2"', "[[2], null]", '{"a": 2}'])
def test_what_is_no_number_is_never_taken_for_one(value, tmp_path):
    path = stored(tmp_path / "s", {0: "[1, 0.5, 3]", 1: f"[{value}, 0.5, 3]"})
    with Store(path) as store, pytest.raises(InvalidInputError):
        summarise(store, "s", "value")


def test_comparisons_pair_equal_trials_of_an_unequal_choice(tmp_path):
    sweep = Sweep(
        name="s", problem=NUMBER, axes={"factor": [1, 3]}, trials=9, seed=1, paired=("factor",)
    )
    run_sweep(sweep, tmp_path / "s", workers=0)
    with Store(tmp_path / "s", write=True) as store, store.writing() as write:
        write(
            "DELETE FROM trials WHERE trial IN (2, 5) AND point = (SELECT min(id) FROM points)", []
        )
        write("DELETE FROM trials WHERE trial = 8 AND point = (SELECT max(id) FROM points)", [])
    with Store(tmp_path / "s") as store:
        ((_, first, second, found),) = compare_along(store, "s", "value", "factor")
        assert (first, second, found.difference.count) == (1, 3, 6)
        assert found.ratio == pytest.approx(3)


def test_a_merge_compares_all_sweeps_before_it_copies_a_row(tmp_path, monkeypatch):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        sweep = Sweep(name="s", problem=NUMBER, axes={"factor": [1]}, trials=2, seed=seed)
        run_sweep(sweep, tmp_path / name, workers=0)
    monkeypatch.setattr("shoal.lab.exchange._take", lambda *_: pytest.fail("copied first"))
    with pytest.raises(InvalidInputError, match=r"c: sweep s: expected the same .* changes: seed"):
        merge_stores([tmp_path / name for name in "abc"], tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


def test_a_replay_refuses_a_page_that_is_too_large_before_it_replays(tmp_path, monkeypatch, capsys):
    path = tmp_path / "e.npz"
    shoal.run("line:9", particles=2, max_moves=20).save(path)
    monkeypatch.setattr("shoal.views.swarm.page.LARGEST", 10)
    monkeypatch.setattr(SwarmEpisode, "verify", lambda _: pytest.fail("replayed first"))
    assert command(["replay", str(path), "--film", str(tmp_path / "a.html")]) == 2
    assert "the HTML player: expected a number of particles times" in capsys.readouterr().err
    assert not (tmp_path / "a.html").exists()
