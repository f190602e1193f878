"""Shoal-Bench: suites of problems that never change, and the scores of policies on the suites."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import as_path, check_function, check_kind, check_list, shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.lab.batches import SweepStatus
from shoal.lab.coordinator import OnProgress, run_sweep
from shoal.lab.problems import trial_problem_type
from shoal.lab.statistics import Estimate, Measured, estimate, estimate_ratio, measured
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep, axis_values, digest_of, trial_seed
from shoal.swarm.grid.board import trial_rng


@dataclass(frozen=True)
class Suite:
    """A table of problems, on which policies are compared. A published suite never changes.

    Parameters
    ----------
    name : str
        Name of the suite with its version, such as "mapping-easy-v1".
    problem : dict
        The fields that all problems of the suite share, such as the budget of moves.
    policy : str
        The field that names the policy: "policy", "planner" or "allocation".
    place : str
        The field in which the problems differ: "map", "workspace" or "region".
    train, test : tuple
        Values of the field ``place``. Methods may learn from ``train`` only. ``train`` is empty in
        a suite of real maps.
    trials : int
        Number of random starts at each place.
    measure : str
        Name of the measure that is compared, such as "moves".
    budget : float
        What an episode that did not complete its task counts as, in the unit of the measure. A
        higher value of a completed episode counts as the budget, too.
    reference : str
        Name of the policy to which the measure is compared.
    reference_values : tuple
        The measure of the reference policy for each place (first ``train``, then ``test``) and
        each trial, as a fixed number.
    baselines : tuple of str
        The policies that are run by default.
    digest : str
        Digest of the fields above, of the content of all places, and of all random starts.
    """

    name: str
    problem: Mapping[str, Any]
    policy: str
    place: str
    train: tuple[Any, ...]
    test: tuple[Any, ...]
    trials: int
    measure: str
    budget: float
    reference: str
    reference_values: tuple[tuple[float, ...], ...]
    baselines: tuple[str, ...]
    digest: str

    @property
    def places(self) -> tuple[Any, ...]:
        """The places of both splits."""
        return self.train + self.test

    def sweep(self, policies: Sequence[str]) -> Sweep:
        """Return the sweep that runs policies on all problems of the suite.

        The seed of a trial does not depend on the policy. All policies therefore have equal starts.
        """
        return Sweep(
            name=self.name,
            problem=self.problem,
            axes={self.policy: [*policies], self.place: [*self.places]},
            trials=self.trials,
            seed=0,
            paired=(self.policy,),
        )

    def accepts(self, policy: str) -> bool:
        """Return whether the problems of the suite know a policy by its name."""
        names = trial_problem_type(self.problem["kind"]).declarations()[self.policy].names
        return policy.partition(":")[0] in (names or ())

    def content_digest(self) -> str:
        """Return the digest of what the suite consists of now: its definition, its places and its
        random starts.

        The digest differs from ``digest`` if a generator of maps or of starts has changed.
        """
        definition = {
            name: value
            for name, value in asdict(self).items()
            if name not in {"digest", "baselines", "reference_values"}
        }
        seen = [json.dumps(definition, sort_keys=True)]
        for point in self.sweep([self.reference]).points:
            problem = point.problem.opened()
            seen.append(digest_of(problem.place_digest()))
            for trial in range(self.trials):
                starts = _STARTS[problem.part](problem, trial_seed(0, point.seeds, trial))
                seen += [digest_of(repr(start.tolist())) for start in starts]
        return digest_of("\n".join(seen))

    def check_unchanged(self) -> None:
        """Refuse to run a suite whose problems are no longer those of its version.

        Raises
        ------
        InvalidInputError
            Raised if this version of Shoal, or of a library, draws other maps or starts than the
            version that made the suite.
        """
        found = self.content_digest()
        if found != self.digest:
            raise InvalidInputError(
                f"suite {self.name}: expected maps and starts with the digest {self.digest}, got"
                f" {found}, so that scores would not be comparable; another version of Shoal or of"
                " NumPy draws other maps or starts"
            )


def _swarm_starts(problem: Any, seed: int) -> Iterator[NDArray[Any]]:
    return (
        np.asarray(cells)
        for cells in problem.setup.draw_start(trial_rng(seed, 0))
        if cells is not None
    )


def _search_starts(problem: Any, seed: int) -> Iterator[NDArray[Any]]:
    from shoal.search.planning.plan import start_points

    side = float(np.min(problem.chosen_footprint))
    grid = _cells_of(problem.place, side, problem.chosen_angle or 0.0)
    return iter((np.round(start_points(problem, grid, np.random.default_rng(seed)), 6),))


@lru_cache(maxsize=1)
def _cells_of(region: Any, side: float, angle: float) -> Any:
    """Return the cells of a region, which all starts of a place share."""
    from shoal.search.cells.grid import cells_of

    return cells_of(region, side, angle=angle)


def _steering_starts(problem: Any, seed: int) -> Iterator[NDArray[Any]]:
    return (np.round(points, 9) for points in problem.endpoints(seed))


_STARTS: dict[str, Callable[[Any, int], Iterator[NDArray[Any]]]] = {
    "swarm": _swarm_starts,
    "steering": _steering_starts,
    "search": _search_starts,
}
"""By part, the random numbers with which an episode of a problem and a seed begins. Points are
rounded, because sums of rounded numbers may differ between processors in the last digit.
"""


@cache
def suites() -> Mapping[str, Suite]:
    """Return all suites by name, as stored in ``suites.json``.

    Examples
    --------
    >>> suite = suites()["mapping-easy-v1"]
    >>> len(suite.train), len(suite.test), suite.trials, suite.measure
    (10, 10, 5, 'moves')
    """
    return {
        entry["name"]: suite_of(entry)
        for entry in json.loads(files("shoal.lab").joinpath("suites.json").read_text("utf-8"))
    }


def suite_of(data: Mapping[str, Any]) -> Suite:
    """Return the suite that JSON data describe."""
    fields = dict(data)
    for name in ("train", "test", "baselines"):
        fields[name] = tuple(fields[name])
    fields["reference_values"] = tuple(map(tuple, fields["reference_values"]))
    return Suite(**fields)


def find_suite(name: str) -> Suite:
    """Return the suite with a name. A name without a version, such as "mapping-easy", means the
    newest version.

    Raises
    ------
    UnknownNameError

    Examples
    --------
    >>> find_suite("mapping-easy").name
    'mapping-easy-v1'
    """
    known = suites()
    versions = [one for one in known if one == name or one.rpartition("-v")[0] == name]
    if not versions:
        names = list(dict.fromkeys(one.rpartition("-v")[0] for one in known))
        raise UnknownNameError(
            f"suite: expected one of {', '.join(names)}, got {shortened(name)}"
            f"{suggestion(name, names)}"
        )
    return known[max(versions, key=lambda one: int(one.rpartition("-v")[2]))]


def run_suite(
    suite: Suite,
    policies: Iterable[str],
    store: str | os.PathLike[str],
    *,
    workers: int | None = None,
    on_progress: OnProgress | None = None,
) -> SweepStatus:
    """Run policies on all problems of a suite, and write the results to a store of sweeps.

    The store keeps the results of other policies, and none of their trials run. A run that was
    stopped continues with the missing
    trials.

    Parameters
    ----------
    suite : Suite
    policies : iterable of str
        Names of policies. Without a name, what is missing of the policies in the store runs.
    store : path
        Path of the store file, which is created if it does not exist.
    workers, on_progress
        As in `shoal.lab.run_sweep`.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if a policy cannot run, or if the suite has changed.
    OutputError

    Examples
    --------
    >>> import tempfile
    >>> suite = find_suite("mapping-easy")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/bench.sqlite"
    ...     status = run_suite(suite, ["closest-frontier"], path, workers=0)
    ...     with Store(path) as store:
    ...         [score] = scores(store, suite)
    >>> status.done, score.test.mean, score.completed
    (100, 1.0, 100)
    """
    check_function(on_progress, what="on_progress")
    check_kind(suite, Suite, what="suite").check_unchanged()
    path = as_path(store, what="store")
    stored: tuple[str, ...] = ()
    if path.exists():
        with Store(path) as opened:
            if suite.name in opened.names:
                stored = policies_of(opened, suite)
    wanted = tuple(dict.fromkeys(check_list(policies, str, what="policies")))
    sweep = suite.sweep([*dict.fromkeys((*stored, *wanted))])
    return run_sweep(
        sweep,
        path,
        workers=workers,
        extend=True,
        only={suite.policy: wanted} if wanted else None,
        on_progress=on_progress,
    )


def policies_of(store: Store, suite: Suite) -> tuple[str, ...]:
    """Return the policies whose results on a suite are in a store.

    Raises
    ------
    InvalidInputError
        Raised if the store has a sweep with the name of the suite that is not the suite.
    """
    sweep = store.stored(suite.name)
    found = tuple(axis_values(suite.policy, sweep.spec["axes"].get(suite.policy, [None])))
    expected = suite.sweep([suite.reference]).describe()
    expected["axes"][suite.policy] = [*found]
    if sweep.spec != json.loads(json.dumps(expected)):
        raise InvalidInputError(
            f"{store.path}: expected that the sweep {suite.name} is the suite with this name, got"
            " another sweep; take another store"
        )
    return found


@dataclass(frozen=True)
class Score:
    """The score of a policy on a suite. A score is a mean over places: at each place, the sum of
    the measure over all trials, divided by the sum of the reference.

    Parameters
    ----------
    suite, policy : str
    test, train : Estimate or None
        The score on each split, with a bootstrap interval over the places of the split. None stands
        for a split without places, and for a policy whose trials are not all there.
    gap : Estimate or None
        The generalisation gap: the score on the split ``test`` divided by the score on the split
        ``train``, with a bootstrap interval. A gap above 1 means that the policy does worse on maps
        from which it could not learn.
    completed, trials : int
        Number of the trials that completed their task, and number of all trials of the policy.
    missing : int
        Number of trials without a result.
    """

    suite: str
    policy: str
    test: Estimate | None
    train: Estimate | None
    gap: Estimate | None
    completed: int
    trials: int
    missing: int


def scores(store: Store, suite: Suite, *, level: float = 0.95) -> list[Score]:
    """Return the score of each policy on a suite, in the order in which the policies were run.

    Parameters
    ----------
    store : Store
    suite : Suite
    level : float
        Confidence level of the intervals.
    """
    check_kind(store, Store, what="store")
    check_kind(suite, Suite, what="suite")
    policies = policies_of(store, suite)
    points = list(measured(store, suite.name, suite.measure))
    n_places = len(suite.places)
    return [
        _score(suite, policy, points[k * n_places : (k + 1) * n_places], level)
        for k, policy in enumerate(policies)
    ]


def _score(suite: Suite, policy: str, points: Sequence[Measured], level: float) -> Score:
    trials = len(points) * suite.trials
    there = sum(len(point.trials) for point in points)
    completed = there - sum(int(point.unfinished.sum()) for point in points)
    test = train = gap = None
    if there == trials:
        ratios = [
            float(_counted(suite, point).sum()) / sum(reference)
            for point, reference in zip(points, suite.reference_values, strict=True)
        ]
        learnt, unseen = ratios[: len(suite.train)], ratios[len(suite.train) :]
        test = estimate(unseen, level=level, method="bootstrap")
        if learnt:
            train = estimate(learnt, level=level, method="bootstrap")
            gap = estimate_ratio(unseen, learnt, level=level)
    return Score(suite.name, policy, test, train, gap, completed, trials, trials - there)


def _counted(suite: Suite, point: Measured) -> NDArray[np.float64]:
    """Return what each trial counts as: the measure, or the budget."""
    return np.where(point.unfinished, suite.budget, np.minimum(point.values, suite.budget))
