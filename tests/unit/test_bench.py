"""Shoal-Bench: that suites never change, and how scores count."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.datasets import record

from shoal.cli import run
from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.lab import Store, Sweep, run_sweep
from shoal.lab.bench import Suite, find_suite, run_suite, scores, suites
from shoal.lab.statistics import estimate_ratio
from shoal.lab.sweep import trial_seed
from shoal.parts import run as run_problem

DIGESTS = {
    "mapping-easy-v1": "1dab66cd45727fc0f0eb320e28536850",
    "mapping-medium-v1": "a1384094780c3ff90aa1f6b5fed1fcea",
    "mapping-hard-v1": "87b7107125fbaec3bb8bdd6865e909c4",
    "mapping-real-v1": "732bad0ef37abcb4f9e5c6312c31e3a3",
    "coverage-easy-v1": "2100763589eec0e1b318d6e6156a39d5",
    "coverage-medium-v1": "72960e865a85db44278b65dd1656f666",
    "coverage-hard-v1": "7f6245da92730afa148f8af0de19fbca",
    "coverage-real-v1": "19f0b751b0401495d79b44c86955c09f",
    "steering-easy-v1": "7ce9d09d42e9c95334ca67db3556c4d1",
    "steering-medium-v1": "dc7c57e5967738b0edeee0bae17f3d80",
    "steering-hard-v1": "d048500d6ca0d8650a8453091ee35080",
    "search-easy-v1": "f61d2a28b6ae794fd3151a3c564d7c8c",
    "search-medium-v1": "0a20aac62a4db49f88bc9313cd95bf42",
    "search-hard-v1": "6968128c0da72be08ab8d4c3069cdd27",
}
"""Of the published suites. Never edit a line: a changed suite is a new version, with a new line."""


def corridors(**changes) -> Suite:
    """A suite of corridors, on which every policy but random-moves needs few moves."""
    fields = {
        "name": "corridor-easy-v1",
        "problem": {"kind": "swarm", "task": "mapping", "particles": 2, "max_moves": 60},
        "policy": "policy",
        "place": "map",
        "train": ("line:10", "line:12"),
        "test": ("line:14", "line:16"),
        "trials": 2,
        "measure": "moves",
        "budget": 60,
        "reference": "closest-frontier",
        "reference_values": ((10.0, 30.0), (10.0, 10.0), (20.0, 20.0), (5.0, 15.0)),
        "baselines": ("closest-frontier",),
        "digest": "",
    } | changes
    suite = Suite(**fields)
    return replace(suite, digest=suite.content_digest())


@pytest.mark.parametrize("name", DIGESTS)
def test_published_suites_are_unchanged(name):
    assert suites()[name].digest == DIGESTS[name]
    suites()[name].check_unchanged()


def test_every_published_suite_has_a_digest_here():
    assert list(suites()) == list(DIGESTS)


@pytest.mark.parametrize(
    "name", ["mapping-easy", "coverage-real", "steering-easy", "steering-medium", "search-hard"]
)
def test_the_stored_reference_is_what_its_policy_does(name):
    # crashes and lost messages, which the digest does not contain, are in here
    suite = find_suite(name)
    point = suite.sweep([suite.reference]).points[-1]
    episode = run_problem(point.problem, seed=trial_seed(0, point.seeds, 1))
    value = float(episode.metrics[suite.measure])
    assert suite.reference_values[-1][1] == (value if episode.status.done else suite.budget)


def test_training_and_test_places_differ():
    for suite in suites().values():
        places = [json.dumps(place) for place in suite.places]
        assert len({*places}) == len(places) == len(suite.reference_values)
        assert {len(values) for values in suite.reference_values} == {suite.trials}


@pytest.mark.parametrize(
    "changes",
    [
        {"train": ("line:10", "line:13")},
        {"problem": {"kind": "swarm", "particles": 3, "max_moves": 60}},
        {"budget": 50},
        {"trials": 3},
    ],
)
def test_a_changed_suite_is_not_run(changes, tmp_path):
    changed = replace(corridors(), **changes)
    with pytest.raises(InvalidInputError, match="expected maps and starts with the digest"):
        run_suite(changed, ["closest-frontier"], tmp_path / "a.sqlite", workers=0)
    assert not list(tmp_path.iterdir())


def test_changed_random_starts_are_noticed(monkeypatch):
    suite = corridors()
    monkeypatch.setattr(
        "shoal.lab.bench.trial_rng", lambda seed, trial: np.random.default_rng(seed + 1)
    )
    with pytest.raises(InvalidInputError, match="other maps or starts"):
        suite.check_unchanged()


def test_scores_are_sums_over_the_reference(tmp_path):
    suite, path = corridors(), tmp_path / "a.sqlite"
    run_suite(suite, ["closest-frontier"], path, workers=0)
    run_suite(suite, ["random-moves"], path, workers=0)
    with Store(path) as store:
        found = scores(store, suite)
        rows = [*store.rows(suite.name)]
    assert [score.policy for score in found] == ["closest-frontier", "random-moves"]
    for score in found:
        ratios = []
        for place, reference in zip(suite.places, suite.reference_values, strict=True):
            of_place = [row for row in rows if row[:2] == (score.policy, place)]
            counted = [row[5] if row[4] == "complete" else 60 for row in of_place]
            ratios.append(sum(counted) / sum(reference))
        assert score.train.mean == pytest.approx(np.mean(ratios[:2]))
        assert score.test.mean == pytest.approx(np.mean(ratios[2:]))
        assert score.gap.mean == pytest.approx(np.mean(ratios[2:]) / np.mean(ratios[:2]))
        assert score.completed == sum(
            row[4] == "complete" for row in rows if row[0] == score.policy
        )
        assert (score.trials, score.missing) == (8, 0)


def test_an_episode_that_gives_up_counts_as_the_budget(tmp_path):
    suite, path = corridors(problem={"kind": "swarm", "particles": 2, "max_moves": 3}), "a.sqlite"
    run_suite(suite, ["random-moves"], tmp_path / path, workers=0)
    with Store(tmp_path / path) as store:
        [score] = scores(store, suite)
    assert score.completed == 0
    assert score.test.mean == (120 / 40 + 120 / 20) / 2


def test_a_score_with_missing_trials_is_not_shown(tmp_path):
    suite, path = corridors(), tmp_path / "a.sqlite"
    run_suite(suite, ["closest-frontier"], path, workers=0)
    with Store(path, write=True) as store, store.writing() as write:
        write("DELETE FROM trials WHERE trial = 1 AND point = 3", ())
    with Store(path) as store:
        [score] = scores(store, suite)
    assert (score.test, score.train, score.gap, score.missing) == (None, None, None, 1)
    assert run_suite(suite, [], path, workers=0).complete


def test_another_sweep_with_the_name_of_a_suite_is_refused(tmp_path):
    suite, path = corridors(), tmp_path / "a.sqlite"
    other = replace(suite, test=("line:18", "line:20")).sweep(["closest-frontier"])
    assert isinstance(other, Sweep)
    run_sweep(other, path, workers=0)
    with pytest.raises(InvalidInputError, match="is the suite with this name"):
        run_suite(suite, ["closest-frontier"], path, workers=0)


def test_the_newest_version_is_found(monkeypatch):
    known = {f"corridor-easy-v{k}": corridors(name=f"corridor-easy-v{k}") for k in (1, 2, 10)}
    monkeypatch.setattr("shoal.lab.bench.suites", lambda: known)
    assert find_suite("corridor-easy").name == "corridor-easy-v10"
    assert find_suite("corridor-easy-v2").name == "corridor-easy-v2"
    with pytest.raises(UnknownNameError, match="did you mean 'corridor-easy'"):
        find_suite("coridor-easy")


def test_ratios_of_independent_means():
    rng, held = np.random.default_rng(4), 0
    for _ in range(40):
        found = estimate_ratio(rng.normal(6, 1, 20), rng.normal(3, 1, 30))
        held += found.low <= 2 <= found.high
    assert 33 <= held <= 40
    assert str(estimate_ratio([2, 2], [1, 1])) == "2 [2, 2]"
    assert "no interval" in str(estimate_ratio([2], [1]))


def test_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("shoal.lab.bench.suites", lambda: {"corridor-easy-v1": corridors()})
    assert run(["bench", "run", "--workers", "0", "--out", "run.json", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "run.json").read_text())
    assert [score["policy"] for score in printed["scores"]] == ["closest-frontier"]
    assert run(["bench", "run", "sweep", "--workers=0", "--suite=corridor-easy"]) == 0
    assert run(["bench", "table", "--out", "table.json", "--level", "0.9"]) == 0
    out = capsys.readouterr().out
    assert "policy = sweep" in out or "sweep  " in out
    assert "8 of 8" in out
    table = json.loads((tmp_path / "table.json").read_text())
    assert [score["policy"] for score in table["scores"]] == ["closest-frontier", "sweep"]
    assert {score["test"]["level"] for score in table["scores"]} == {0.9}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "greedy"], "expected a policy that a suite knows by its name, got greedy"),
        (["run", "bset", "--suite", "corridor-easy"], "unknown policy 'bset'"),
        (["run", "best", "--suite", "corridor"], "suite: expected one of corridor-easy"),
        (["run", "--workers", "-1"], "workers: expected a whole number, 0 or more"),
        (["table", "none.sqlite"], "none.sqlite: expected a store, got no such file"),
        (["table", "none.sqlite", "--level", "1"], "level: expected a number"),
    ],
)
def test_bad_input(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("shoal.lab.bench.suites", lambda: {"corridor-easy-v1": corridors()})
    assert run(["bench", *words]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_datasets_of_the_training_places(tmp_path):
    minari = pytest.importorskip("minari")
    suite = corridors()
    folders = record(suite, "closest-frontier", tmp_path, episodes=2, seed=3)
    assert len(folders) == len(suite.train)
    dataset = minari.MinariDataset(folders[1])
    assert dataset.total_episodes == 2
    assert dataset.spec.dataset_id == "shoal/corridor-easy-closest-frontier-1-v1"
    problem = suite.sweep(["closest-frontier"]).points[1].problem
    for k in range(2):
        assert len(dataset[k]) == run_problem(problem, seed=3 + k).moves
    for changes, words in (
        ({"train": ()}, "training places"),
        ({"problem": {"kind": "search"}}, "allocations"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            record(replace(suite, **changes), "best", tmp_path, episodes=1, seed=0)
