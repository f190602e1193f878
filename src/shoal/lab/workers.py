"""Workers: processes of this computer or of a Dask cluster, which run batches of trials."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import contextmanager
from dataclasses import field
from multiprocessing.connection import wait
from typing import Any, Self

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.core.registry import digest_of_module, named_modules, users_modules
from shoal.core.version import count_processors
from shoal.lab.batches import check_versions, worker_name, worker_versions
from shoal.lab.trials import begin_worker, give_up

LOOK = 5.0
"""Seconds between two looks at the workers."""

_STARTS = 4  # attempts to start workers


class WorkerPool:
    """The workers of a sweep, by default one machine, whose workers are alike: a batch that fails on
    one fails on all.

    If the death of a worker breaks the pool's executor, the pool makes a new executor.
    """

    workers: int
    """Current number of workers in the pool."""

    def submit(
        self, function: Callable[..., Any], *arguments: Any, apart_from: str = ""
    ) -> Future[Any]:
        """Call a function in a worker of the pool, and return its future result. If possible, avoid
        the worker ``apart_from``.
        """
        raise NotImplementedError

    def has_others(self, worker: str) -> bool:
        """Return whether the pool has other workers that may succeed in a trial that fails in
        ``worker``.
        """
        return False

    def set_aside(self, worker: str) -> None:
        """Send no more batches to a worker."""

    def lost(self, error: BaseException) -> bool:
        """Return whether an error shows that a worker died. If the death has broken the executor,
        prepare a new executor.
        """
        return False

    def look(self) -> None:
        """End the executor if a worker has died without its notice; its futures then get errors
        that `lost` knows.
        """

    def close(self, *, at_once: bool) -> None:
        """Release all workers of the pool, with ``at_once`` in the middle of their batches."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(at_once=kind is not None)


class InProcess(WorkerPool):
    """A pool without workers: all trials run in the current process, one after another."""

    workers = 1

    def submit(
        self, function: Callable[..., Any], *arguments: Any, apart_from: str = ""
    ) -> Future[Any]:
        """Call the function immediately in the current process, and return its result as a finished
        future.
        """
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


@dataclass
class Processes(WorkerPool):
    """Worker processes on the local machine. The worker processes end when the coordinator of the
    sweep ends or crashes.

    Parameters
    ----------
    workers : int
    """

    workers: int
    _pool: ProcessPoolExecutor | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        try:
            check_versions(self._first_answer(), worker="of this machine")
        except BaseException:
            self.close(at_once=True)
            raise

    def _first_answer(self) -> Any:
        """Return the versions of a worker. A worker that is killed while it starts is replaced."""
        for _ in range(_STARTS):
            answer = self.submit(worker_versions)
            while not wait_for([answer], timeout=LOOK).done:
                self.look()
            error = answer.exception()
            if error is None or not self.lost(error):
                return answer.result()
        raise InvalidInputError(
            f"workers: expected processes that can start, got {_STARTS} that ended at once (in a"
            " script, call run_sweep under if __name__ == '__main__', because each worker imports"
            " the script; workers=0 needs no processes)"
        )

    def submit(
        self, function: Callable[..., Any], *arguments: Any, apart_from: str = ""
    ) -> Future[Any]:
        """Call a function in a worker of the pool, and return its future result."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            try:
                self._pool = ProcessPoolExecutor(
                    self.workers,
                    mp_context=context,
                    initializer=_end_with_parent,
                    initargs=users_modules(),
                )
            except OSError as error:  # for example if /dev/shm is not writable
                raise InvalidInputError(
                    "workers: expected processes that share memory, got the error:"
                    f" {error.strerror or error} (0 workers need no processes)"
                ) from None
        try:
            with _interruptions_kept():
                return self._pool.submit(function, *arguments)
        except BrokenExecutor as error:
            # a worker died since the last call: reported like other deaths
            future: Future[Any] = Future()
            future.set_exception(error)
            return future

    def lost(self, error: BaseException) -> bool:
        """Return whether a worker died. The death of a worker breaks the executor, so that `submit`
        must make a new executor.
        """
        if not isinstance(error, BrokenExecutor):
            return False
        self.close(at_once=True)
        return True

    def look(self) -> None:
        """End the executor if one of its workers has died.

        A worker that is killed while it writes an answer leaves a part of it in the pipe, and the
        executor waits for the rest, in place of noticing the death.
        """
        processes = list((getattr(self._pool, "_processes", None) or {}).values())
        if self._pool is not None and wait([one.sentinel for one in processes], timeout=0):
            self._give_up(self._pool)

    @staticmethod
    def _give_up(pool: ProcessPoolExecutor) -> None:
        """End all workers immediately, and the executor's wait for their answers."""
        give_up(pool)
        answers = getattr(pool, "_result_queue", None)
        if answers is not None:
            answers._writer.close()  # with those of the workers, so that the reader sees an end

    def close(self, *, at_once: bool) -> None:
        """Wait until all workers have finished. If ``at_once`` is true, end all workers
        immediately.
        """
        pool, self._pool = self._pool, None
        if pool is not None:
            if at_once:
                self._give_up(pool)
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interruptions_kept() -> Iterator[None]:
    """Delay Ctrl-C inside the ``with`` block. Processes that start inside the ``with`` block never
    receive Ctrl-C.

    A terminal sends Ctrl-C to all processes of a command. A worker process that receives Ctrl-C
    during its start would print a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent(folders: list[str], modules: list[str]) -> None:
    """Initialize a worker process so that the worker ends after its coordinator has ended, instead
    of waiting for work forever.
    """
    begin_worker(folders, modules)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch_parent, args=(parent.sentinel,), daemon=True).start()


def _watch_parent(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


class Cluster(WorkerPool):
    """The workers of a Dask cluster.

    Parameters
    ----------
    address : str
        Address of the Dask scheduler, such as "tcp://HOST:PORT".

    Raises
    ------
    InvalidInputError
        Raised if no scheduler answers, if the cluster has no workers, or if the versions of
        software on a worker differ from the versions of the current process.
    MissingExtraError
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
            from distributed.scheduler import KilledWorker
        except ImportError as error:
            raise MissingExtraError(
                f"--dask needs Dask, which is not installed ({error}): pip install 'shoal[cluster]'"
            ) from error
        self._killed = KilledWorker
        try:
            self._client = Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            what = " ".join(str(error).split()) or type(error).__name__
            raise InvalidInputError(
                f"dask: expected a scheduler at {address}, got {what[:200]}"
            ) from None
        try:
            self._check_workers(address)
        except BaseException:
            self._client.close()
            raise
        self._executor = self._client.get_executor(pure=False, retries=0)

    def _check_workers(self, address: str) -> None:
        """Check that the versions of all workers equal the versions of the current process."""
        if not self.workers:
            raise InvalidInputError(
                f"dask: expected workers at {address}, got none (start some: dask worker {address})"
            )
        for worker, theirs in self._client.run(worker_versions, on_error="return").items():
            if not isinstance(theirs, dict):
                raise InvalidInputError(
                    f"worker {worker}: expected a worker that can import Shoal, got"
                    f" {' '.join(str(theirs).split())[:200]}"
                )
            check_versions(theirs, worker=worker)
        for name, file in named_modules().items():
            self._share(name, file)

    def _share(self, name: str, file: str) -> None:
        """Check that the source of a module is equal in all workers and in the current process.

        If a worker does not have the module, send the module to the worker.
        """
        ours = digest_of_module(name)
        for attempt in range(2):
            theirs = self._client.run(digest_of_module, name)
            wrong = [worker for worker, digest in theirs.items() if digest != ours]
            if not wrong:
                return
            if attempt == 0 and "." not in name:
                self._client.upload_file(file)
        got = "another version" if theirs[wrong[0]] else "none"
        raise InvalidInputError(
            f"worker {wrong[0]}: expected the same module {name} as in this process, got {got}; put"
            " the module on the PYTHONPATH of the workers"
        )

    @property
    def workers(self) -> int:  # type: ignore[override]
        """Current number of threads of all workers in the cluster."""
        return sum(self._client.nthreads().values())

    def submit(
        self, function: Callable[..., Any], *arguments: Any, apart_from: str = ""
    ) -> Future[Any]:
        """Call a function in a worker of the pool, and return its future result."""
        executor = self._executor
        if apart_from:
            others = self._addresses(apart_from, same=False)
            executor = self._client.get_executor(
                pure=False, retries=0, workers=others, allow_other_workers=True
            )
        future: Future[Any] = executor.submit(function, *arguments)
        return future

    def has_others(self, worker: str) -> bool:
        """Return whether the cluster currently has workers other than ``worker``."""
        return bool(self._addresses(worker, same=False))

    def set_aside(self, worker: str) -> None:
        """Retire a worker. Dask moves the pending batches of the retired worker to
        other workers.
        """
        if addresses := self._addresses(worker, same=True):
            self._client.retire_workers(addresses, close_workers=True)

    def _addresses(self, worker: str, *, same: bool) -> list[str]:
        """Return the addresses of the worker ``worker`` if ``same`` is true, and of all other
        workers if ``same`` is false.
        """
        names = self._client.run(worker_name, on_error="ignore")
        return [address for address, name in names.items() if (name == worker) == same]

    def lost(self, error: BaseException) -> bool:
        """Return whether Dask has given up a batch because workers died during several attempts to
        run the batch.
        """
        return isinstance(error, self._killed)

    def close(self, *, at_once: bool) -> None:
        """Disconnect from the Dask cluster. The Dask cluster itself keeps running."""
        self._executor.shutdown(wait=not at_once)
        self._client.close()


def end_second_start() -> None:
    """End a worker in which a script without a main guard runs again, before it starts workers of
    its own. The process that has started the worker says so.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)


def check_workers(workers: int | None, dask: str | None) -> None:
    """Refuse a wrong number of workers, and one beside a Dask cluster."""
    if workers is None:
        return
    if dask is not None:
        raise InvalidInputError(
            "workers: expected no number of workers for a Dask cluster, which has its own workers,"
            f" got {workers}"
        )
    check_integer(workers, what="workers", least=0)


def make_worker_pool(workers: int | None, dask: str | None) -> WorkerPool:
    """Return a pool of workers for a sweep.

    Parameters
    ----------
    workers : int, optional
        Number of worker processes on the local machine. The default is one process per processor.
        If ``workers`` is 0, all trials run in the current process.
    dask : str, optional
        Address of a Dask scheduler. The scheduler's workers run all trials, in place of processes
        on the local machine.
    """
    check_workers(workers, dask)
    if dask is not None:
        return Cluster(dask)
    count = count_processors() if workers is None else workers
    return Processes(count) if count else InProcess()
