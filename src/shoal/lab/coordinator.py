"""Run a sweep: distribute missing trials to workers, commit the results of trials, and recover from
the death of workers.
"""

from __future__ import annotations

import os
import time
import warnings
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from dataclasses import field, replace
from typing import Any

from shoal.core.checks import as_path, check_function, check_kind
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, UnknownNameError, describe_error
from shoal.core.notices import tell_once
from shoal.lab.batches import (
    Answer,
    Batch,
    Gap,
    MixedVersionsWarning,
    Piece,
    SweepProgress,
    SweepStatus,
    check_versions,
    describe_mixture,
    lost_batch,
    play_batch,
)
from shoal.lab.problems import check_trial
from shoal.lab.store import Store, locked
from shoal.lab.sweep import Point, Sweep, digest_of, distinct_places
from shoal.lab.workers import (
    LOOK,
    WorkerPool,
    check_workers,
    end_second_start,
    make_worker_pool,
)
from shoal.swarm.problem import SwarmProblem

BATCH_SECONDS = 0.5
_LARGEST = 20_000  # maximum number of trials per batch
_PIECES = 2_000  # maximum number of points per batch
_FIRST_ROUND = 4  # number of trials of each point in the first round
_DEATHS = 3  # number of workers that die with a batch before its trials are run alone


OnProgress = Callable[[SweepProgress], None]


def run_sweep(
    sweep: Sweep,
    store: str | os.PathLike[str],
    *,
    workers: int | None = None,
    dask: str | None = None,
    extend: bool = False,
    only: Mapping[str, Collection[Any]] | None = None,
    on_progress: OnProgress | None = None,
    batch_seconds: float = BATCH_SECONDS,
) -> SweepStatus:
    """Run all missing trials of a sweep, and write the results to a store.

    Parameters
    ----------
    sweep : Sweep
    store : path
        Path of the store file, which is created if it does not exist. The store may contain the
        results of several sweeps.
    workers : int, optional
        Number of worker processes on the local machine. The default is one process per processor.
        If ``workers`` is 0, all trials run in the current process.
    dask : str, optional
        Address of a Dask scheduler. The scheduler's workers run all trials, in place of processes
        on the local machine.
    extend : bool
        Whether the sweep may add trials or points to a stored sweep with an equal name.
    only : mapping, optional
        For some axes, the values whose points run: all other points stay as they are.
    on_progress : callable, optional
        Function that `run_sweep` calls with a `SweepProgress` after every batch of trials.
    batch_seconds : float
        Desired duration of a batch of trials, in seconds. Shoal commits the results of a batch
        together. Results do not depend on the duration of batches.

    Returns
    -------
    SweepStatus

    Raises
    ------
    InvalidInputError
        Raised if the store contains a different sweep with an equal name, or if another process
        runs the sweep. Also raised if a point (a combination of axis values) cannot run, or if a
        worker has other versions of software than the current process, or if no worker can start, as
        in a script that calls `run_sweep` without a main guard. An error inside a trial does
        not raise an exception: the store records the trial as failed.
    OutputError
        Raised if Shoal cannot write the store. After an error, the store keeps all committed
        results.
    MissingExtraError

    Warns
    -----
    MixedVersionsWarning
        Issued if other versions of Shoal, Python, NumPy or Numba wrote existing rows of the sweep.

    Examples
    --------
    >>> import tempfile
    >>> sweep = Sweep(name="corridor", problem={"kind": "swarm", "map": "line:50"}, axes={"particles": [5, 50]}, trials=3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     status = run_sweep(sweep, f"{folder}/results.sqlite", workers=0)
    >>> status.done, status.complete
    (6, True)
    """
    check_function(on_progress, what="on_progress")
    end_second_start()
    check_kind(sweep, Sweep, what="sweep")
    if only is not None:
        check_kind(only, Mapping, what="only")  # type: ignore[type-abstract]
    path = as_path(store, what="store")
    check_workers(workers, dask)
    inputs, files = prepare(sweep, only)
    _load_kernels(sweep)
    with Store(path, write=True) as opened:
        with locked(path, sweep.name):
            opened.add(sweep, inputs, extend=extend)
            gaps = [gap for gap in opened.missing(sweep) if _is_wanted(gap.point, only)]
            if gaps:
                _warn_of_others(opened, sweep.name)
                with make_worker_pool(workers, dask) as pool:
                    _Run(sweep, opened, files, pool, batch_seconds, on_progress).all(gaps)
            elif on_progress is not None:
                on_progress(SweepProgress(sweep.total, sweep.total, 0, 0, 0, 0.0))
        return opened.status(sweep.name)


def _warn_of_others(store: Store, name: str) -> None:
    mixed = describe_mixture(store.versions(name))
    if mixed:
        warnings.warn(
            f"{store.path}: sweep {name}: expected rows of this version, got {mixed}. All rows are"
            " kept, and this version runs the missing trials. If its results differ, the rows are"
            " not comparable. To get rows of one version, continue with the version that began, or"
            " use another name or store for the sweep",
            MixedVersionsWarning,
            stacklevel=3,
        )


def _is_wanted(point: Point, only: Mapping[str, Collection[Any]] | None) -> bool:
    return all(point.values[axis] in values for axis, values in (only or {}).items())


def prepare(
    sweep: Sweep, only: Mapping[str, Collection[Any]] | None = None
) -> tuple[dict[str, str], dict[str, Any]]:
    """Check that every point of a sweep, or each that is wanted, can run. Return a digest of each
    map, workspace, region and other file in the sweep, and those places that are read from files,
    opened: all trials run in what the files contain now.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if a point cannot run. The error message gives the axis values of the first point
        that cannot run.
    """
    inputs: dict[str, str] = {}
    files: dict[str, Any] = {}
    for point in distinct_places(sweep.points):
        name = point.problem.place_key()
        if name is not None:
            with _errors_at(sweep, point):
                problem = point.problem.opened()
                inputs[name] = digest_of(problem.place_digest())
                if problem.place_is_file():
                    files[name] = problem.place
    for point in sweep.points:
        if not _is_wanted(point, only):
            continue
        with _errors_at(sweep, point):
            problem = point.problem.opened()
            check_trial(problem)
            inputs |= {name: digest_of(one) for name, one in problem.other_files().items()}
    return inputs, files


@contextmanager
def _errors_at(sweep: Sweep, point: Point) -> Iterator[None]:
    """Turn errors inside the ``with`` block into an error that gives the axis values of a point
    that cannot run.
    """
    try:
        yield
    except Exception as error:  # third-party code may raise any exception
        where = ", ".join(f"{name} = {value}" for name, value in point.values.items())
        kind = UnknownNameError if isinstance(error, UnknownNameError) else InvalidInputError
        raise kind(
            f"sweep {sweep.name}{', at ' * bool(where)}{where}: {describe_error(error)}"
        ) from None


def _load_kernels(sweep: Sweep) -> None:
    """Compile or load the kernels of a sweep, so that the workers need not all compile the kernels
    at the same time.
    """
    for point in sweep.points:
        if isinstance(point.problem, SwarmProblem):
            from shoal.swarm.run import load_kernels

            load_kernels(point.problem)


@dataclass
class _Job:
    """A batch of trials that a worker is processing."""

    batch: Batch
    deaths: int = 0
    doubted: Answer | None = None  # workers on which all trials of the batch failed


@dataclass
class _Run:
    """One run of a sweep, with the measured durations of its trials."""

    sweep: Sweep
    store: Store
    files: Mapping[str, Any]  # opened places by their keys
    pool: WorkerPool
    batch_seconds: float
    on_progress: OnProgress | None
    paces: dict[int, float] = field(default_factory=dict)
    pace: float | None = None
    # workers on which batches fail that also fail on others
    sound: set[str] = field(default_factory=set)
    fresh: int = 0
    failures: int = 0
    deaths: int = 0
    done: int = 0
    began: float = field(default_factory=time.monotonic)

    def all(self, gaps: list[Gap]) -> None:
        """Run all missing trials of the sweep."""
        self.done = self.sweep.total - sum(gap.stop - gap.first for gap in gaps)
        self._tell()
        suspects = self._give_out(self._batches(_rounds(gaps)), at_once=2)
        # A batch whose workers died three times is run trial by trial, so that a death can be
        # assigned to a trial.
        for single in [single for job in suspects for single in _singles(job.batch)]:
            for again in self._give_out(iter([single]), at_once=0, most=1):
                self._take(lost_batch(again.batch, f"the worker died {_DEATHS + 1} times"))

    def _give_out(
        self, batches: Iterator[Batch], *, at_once: int, most: int = _DEATHS
    ) -> list[_Job]:
        """Run batches of trials, and return the batches during which workers died too often.

        At most ``at_once`` batches per worker run at the same time. If ``at_once`` is 0, only one
        batch runs at a time.
        """
        pending: dict[Future[Answer], _Job] = {}
        again: deque[_Job] = deque()
        suspects: list[_Job] = []
        exhausted = False
        while True:
            room = max(1, at_once * self.pool.workers) - len(pending)
            while room > 0 and not (exhausted and not again):
                job = again.popleft() if again else None
                if job is None:
                    batch = next(batches, None)
                    if batch is None:
                        exhausted = True
                        break
                    job = _Job(batch)
                pending[
                    self.pool.submit(
                        play_batch, job.batch, apart_from=job.doubted.worker if job.doubted else ""
                    )
                ] = job
                room -= 1
            if not pending:
                return suspects
            ready = wait(pending, timeout=LOOK, return_when=FIRST_COMPLETED).done
            if not ready:
                self.pool.look()
            if not ready and not self.pool.workers:
                tell_once(
                    f"shoal: sweep {self.sweep.name}: no workers are left; the sweep continues when"
                    " workers connect"
                )
            for job in self._collect(pending, ready):
                (suspects if job.deaths >= most else again).append(job)

    def _collect(
        self, pending: dict[Future[Answer], _Job], ready: Iterable[Future[Answer]]
    ) -> Iterator[_Job]:
        """Commit finished batches. Yield the batches that must run again, for example after the
        death of a worker.
        """
        broken = False
        for future in ready:
            job = pending.pop(future)
            error = future.exception()
            if error is None:
                answer = future.result()
                # workers of a cluster may join and leave
                check_versions(answer.versions, worker=answer.worker)
                if self._doubts(job, answer):
                    yield job
                else:
                    self._take(answer)
            elif broken or self.pool.lost(error):
                broken = True
                job.deaths += 1
                yield job
            else:
                raise error
        if broken:
            self.deaths += 1
            self._tell()

    def _doubts(self, job: _Job, answer: Answer) -> bool:
        """Return whether another worker should repeat a batch, because all trials of the batch
        failed on one worker.

        If all trials of a batch fail on one worker and some succeed on another worker, the first
        worker gets no more batches.
        """
        first, job.doubted = job.doubted, answer
        if first is None:
            return (
                not answer.rows
                and answer.worker not in self.sound
                and self.pool.has_others(answer.worker)
            )
        if not answer.rows:
            self.sound |= {first.worker, answer.worker}
        elif answer.worker != first.worker:
            self.pool.set_aside(first.worker)
            what = (
                f"trials that failed on worker {first.worker} succeeded on another worker"
                f" ({first.failures[0][3][:200]})"
            )
            tell_once(
                f"shoal: sweep {self.sweep.name}: {what}; the worker {first.worker} gets no more"
                " trials"
            )
        return False

    def _take(self, answer: Answer) -> None:
        self.store.commit(self.sweep, answer)
        for point, pace in answer.paces:
            self.paces[point] = self.pace = pace
        self.fresh += len(answer.rows)
        self.done += len(answer.rows)
        self.failures += len(answer.failures)
        self._tell()

    def _tell(self) -> None:
        if self.on_progress is not None:
            seconds = time.monotonic() - self.began
            self.on_progress(
                SweepProgress(
                    self.done, self.sweep.total, self.fresh, self.failures, self.deaths, seconds
                )
            )

    def _batches(self, gaps: Iterable[Gap]) -> Iterator[Batch]:
        """Divide missing trials into batches of about the desired duration, by means of the
        measured durations of trials.
        """
        pieces: list[Piece] = []
        expected, trials = 0.0, 0
        for gap in gaps:
            first = gap.first
            while first < gap.stop:
                pace = self.paces.get(gap.id, self.pace)
                fitting = (
                    1
                    if pace is None
                    else max(1, int((self.batch_seconds - expected) / max(pace, 1e-7)))
                )
                stop = min(gap.stop, first + min(fitting, _LARGEST - trials))
                pieces.append(self._piece(gap, first, stop))
                expected += (stop - first) * (self.batch_seconds if pace is None else pace)
                trials, first = trials + stop - first, stop
                if (
                    expected >= 0.8 * self.batch_seconds
                    or trials >= _LARGEST
                    or len(pieces) >= _PIECES
                ):
                    yield Batch(self.sweep.seed, tuple(pieces))
                    pieces, expected, trials = [], 0.0, 0
        if pieces:
            yield Batch(self.sweep.seed, tuple(pieces))

    def _piece(self, gap: Gap, first: int, stop: int) -> Piece:
        problem = gap.point.problem
        place = self.files.get(problem.place_key() or "")
        return Piece(gap.id, problem, gap.point.seeds, first, stop, place)


def _rounds(gaps: list[Gap]) -> Iterator[Gap]:
    """Yield the missing trials in rounds over all points of the sweep, so that each point gets
    early results.

    With each round, the number of yielded trials per point grows by the factor 4, until no trial of
    the point is missing.
    """
    begun, most = {gap.id: 0 for gap in gaps}, _FIRST_ROUND
    while gaps:
        rest: list[Gap] = []
        for gap in gaps:
            taken = min(gap.stop - gap.first, most - begun[gap.id])
            if taken > 0:
                begun[gap.id] += taken
                yield replace(gap, stop=gap.first + taken)
            if gap.first + taken < gap.stop:
                rest.append(replace(gap, first=gap.first + taken))
        gaps, most = rest, 4 * most


def _singles(batch: Batch) -> Iterator[Batch]:
    """Divide a batch into batches of a single trial."""
    for piece in batch.pieces:
        for trial in range(piece.first, piece.stop):
            yield Batch(
                batch.sweep_seed,
                (Piece(piece.point, piece.problem, piece.seeds, trial, trial + 1, piece.place),),
            )
