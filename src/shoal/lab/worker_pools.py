"""Workers of a sweep: local processes or a Dask cluster, both as `concurrent.futures.Executor`. The pool survives dead workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import field
from multiprocessing.connection import wait
from typing import Any, Protocol

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.core.registry import digest_of_module, named_modules, users_modules
from shoal.lab.executors import begin_worker, default_workers, give_up
from shoal.lab.sweeps.batches import worker_name
from shoal.lab.versions import check_versions, worker_versions


class WorkerPool(Protocol):
    """Workers of a sweep: an executor, which is replaced if the death of a worker has broken it."""

    @property
    def workers(self) -> int:
        """Current number of workers."""

    def submit(self, function: Callable[..., Any], *arguments: Any, apart_from: str = "") -> Future[Any]:
        """Call a function in a worker, if possible not in the worker ``apart_from``."""

    def has_others(self, worker: str) -> bool:
        """Return whether other workers may be able to run a trial that fails in the given worker."""

    def set_aside(self, worker: str) -> None:
        """Send no more batches to a worker."""

    def lost(self, error: BaseException) -> bool:
        """Return whether an error shows that a worker died. Replace the executor if it is broken."""

    def close(self, *, at_once: bool) -> None:
        """Release the workers."""


class _OneMachine:
    """Workers on one machine. They all have the same environment, so no worker fails for reasons of its own."""

    def has_others(self, worker: str) -> bool:
        """Return False, because there are no other workers."""
        return False

    def set_aside(self, worker: str) -> None:
        """Do nothing."""


class InProcess(_OneMachine):
    """No workers: all trials run in this process, one after another."""

    workers = 1

    def submit(self, function: Callable[..., Any], *arguments: Any, apart_from: str = "") -> Future[Any]:
        """Call the function immediately."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def lost(self, error: BaseException) -> bool:
        """Return False, because no worker can die."""
        return False

    def close(self, *, at_once: bool) -> None:
        """Do nothing."""


@dataclass
class Processes(_OneMachine):
    """Worker processes on this machine. The worker processes end when the coordinator ends, even after a crash.

    Parameters
    ----------
    workers : int
    """

    workers: int
    _pool: ProcessPoolExecutor | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        try:
            check_versions(self.submit(worker_versions).result(), worker="of this machine")
        except BaseException:
            self.close(at_once=True)
            raise

    def submit(self, function: Callable[..., Any], *arguments: Any, apart_from: str = "") -> Future[Any]:
        """Call a function in a worker."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            try:
                self._pool = ProcessPoolExecutor(
                    self.workers, mp_context=context, initializer=_end_with_parent, initargs=users_modules()
                )
            except OSError as error:  # for example if /dev/shm is not writable
                raise InvalidInputError(
                    f"workers: expected processes that share memory, got the error: {error.strerror or error} (0 workers "
                    "need no processes)"
                ) from None
        try:
            with _interruptions_kept():
                return self._pool.submit(function, *arguments)
        except BrokenExecutor as error:  # a worker died since the last call: reported like other deaths
            future: Future[Any] = Future()
            future.set_exception(error)
            return future

    def lost(self, error: BaseException) -> bool:
        """Return whether a worker died. A worker's death breaks the executor, and the next call of `submit` creates a new one."""
        if not isinstance(error, BrokenExecutor):
            return False
        self.close(at_once=True)
        return True

    def close(self, *, at_once: bool) -> None:
        """Let the workers finish, or end them immediately."""
        pool, self._pool = self._pool, None
        if pool is not None:
            if at_once:
                give_up(pool)
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interruptions_kept() -> Iterator[None]:
    """Delay Ctrl-C inside the block. Processes started in the block never receive it.

    A terminal sends Ctrl-C to all processes. A worker that has not yet begun to ignore Ctrl-C would print a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_parent(folders: list[str], modules: list[str]) -> None:
    """Initialize a worker so that it ends when its coordinator has ended. Otherwise it would wait for work forever."""
    begin_worker(folders, modules)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_watch_parent, args=(parent.sentinel,), daemon=True).start()


def _watch_parent(sentinel: int) -> None:
    wait([sentinel])
    os._exit(1)


class Cluster:
    """The workers of a Dask cluster.

    Parameters
    ----------
    address : str
        Address of the scheduler, "tcp://HOST:PORT".

    Raises
    ------
    InvalidInputError
        If no scheduler answers, there are no workers, or a worker has other versions than this process.
    MissingExtraError
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
            from distributed.scheduler import KilledWorker
        except ImportError as error:
            raise MissingExtraError(f"--dask needs Dask, which is not installed ({error}): pip install 'shoal[cluster]'") from error
        self._killed = KilledWorker
        try:
            self._client = Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            what = " ".join(str(error).split()) or type(error).__name__
            raise InvalidInputError(f"dask: expected a scheduler at {address}, got {what[:200]}") from None
        try:
            self._check_workers(address)
        except BaseException:
            self._client.close()
            raise
        self._executor = self._client.get_executor(pure=False, retries=0)

    def _check_workers(self, address: str) -> None:
        """Before any work, check that the workers have the same versions as this process."""
        if not self.workers:
            raise InvalidInputError(f"dask: expected workers at {address}, got none (start some: dask worker {address})")
        for worker, theirs in self._client.run(worker_versions, on_error="return").items():
            if not isinstance(theirs, dict):
                raise InvalidInputError(
                    f"worker {worker}: expected a worker that can import Shoal, got {' '.join(str(theirs).split())[:200]}"
                )
            check_versions(theirs, worker=worker)
        for name, file in named_modules().items():
            self._share(name, file)

    def _share(self, name: str, file: str) -> None:
        """Check that all workers have the same source of a module as this process.

        If a worker lacks the module, send the module to it.
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
            f"worker {wrong[0]}: expected the same module {name} as in this process, got {got}; put the module on the "
            "PYTHONPATH of the workers"
        )

    @property
    def workers(self) -> int:
        """The number of threads that all workers have at present."""
        return sum(self._client.nthreads().values())

    def submit(self, function: Callable[..., Any], *arguments: Any, apart_from: str = "") -> Future[Any]:
        """Call a function in a worker."""
        executor = self._executor
        if apart_from:
            others = self._addresses(apart_from, same=False)
            executor = self._client.get_executor(pure=False, retries=0, workers=others, allow_other_workers=True)
        future: Future[Any] = executor.submit(function, *arguments)
        return future

    def has_others(self, worker: str) -> bool:
        """Return whether there are other workers now."""
        return bool(self._addresses(worker, same=False))

    def set_aside(self, worker: str) -> None:
        """Retire a worker. The pending batches of this worker go to other workers."""
        if addresses := self._addresses(worker, same=True):
            self._client.retire_workers(addresses, close_workers=True)

    def _addresses(self, worker: str, *, same: bool) -> list[str]:
        """Return the addresses of the worker of a name, or of all other workers."""
        names = self._client.run(worker_name, on_error="ignore")
        return [address for address, name in names.items() if (name == worker) == same]

    def lost(self, error: BaseException) -> bool:
        """Return whether Dask has given up a batch because its workers died. Before that, Dask itself retries the batch."""
        return isinstance(error, self._killed)

    def close(self, *, at_once: bool) -> None:
        """Disconnect from the cluster. The cluster keeps running."""
        self._executor.shutdown(wait=not at_once)
        self._client.close()


def make_worker_pool(workers: int | None, dask: str | None) -> WorkerPool:
    """Return the workers of a sweep.

    Parameters
    ----------
    workers : int, optional
        Number of processes on this machine. The default is one process per processor. With 0, all trials run in this process.
    dask : str, optional
        Address of a Dask scheduler, whose workers replace processes on this machine.

    Raises
    ------
    InvalidInputError, MissingExtraError
    """
    if dask is not None:
        if workers is not None:
            raise InvalidInputError(
                f"workers: expected no number of workers for a Dask cluster, which has its own workers, got {workers}"
            )
        return Cluster(dask)
    count = default_workers() if workers is None else check_integer(workers, what="workers", least=0)
    return Processes(count) if count else InProcess()
