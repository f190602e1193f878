"""The process pool starts the processes of all live robots, and makes sure that all these processes end."""

from __future__ import annotations

import json
import os
import pickle
import selectors
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.errors import ShoalError
from shoal.search.simulation.live.task import LiveTask

Report = dict[str, Any]
# a process with threads cannot be forked safely
_QUIET = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


@dataclass
class Member:
    """The process of one robot, and the state of this process.

    Parameters
    ----------
    number : int
        Number of the robot.
    orders, reports : int
        File descriptors of the process's input and output.
    process : int
        Process number in the operating system, or 0 before the process is ready.
    port : int
        Port on which the robot receives messages with unicast.
    counts : sequence of int
        Numbers of messages that the robot has sent, received, lost and dropped.
    ended : bool
        Whether the process has ended.
    rest : bytes
        Incomplete last line of the reports that have arrived from the process.
    """

    number: int
    orders: int
    reports: int
    process: int = 0
    port: int = 0
    counts: Sequence[int] = (0, 0, 0, 0)
    ended: bool = False
    rest: bytes = b""


class ProcessPool:
    """The processes of all live robots. When the ``with`` statement of a pool ends, all processes of the pool have ended.

    Parameters
    ----------
    task : LiveTask
    """

    def __init__(self, task: LiveTask) -> None:
        self.members: dict[int, Member] = {}
        self._task = task
        self._stack = ExitStack()

    def __enter__(self) -> ProcessPool:
        with ExitStack() as stack:
            self._errors = stack.enter_context(tempfile.TemporaryFile())
            self._selector = stack.enter_context(selectors.DefaultSelector())
            self._start(stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._stack.close()

    def _start(self, stack: ExitStack) -> None:
        """Start the first process, which forks the robots' processes."""
        data = pickle.dumps(self._task)
        ground = tempfile.TemporaryFile()  # noqa: SIM115 - the stack closes it; without a name, it cannot be left behind
        stack.enter_context(ground)
        ground.write(data)
        ground.flush()
        theirs, words = [ground.fileno()], [str(ground.fileno()), str(len(data))]
        with ExitStack() as passed:
            for number in range(1, len(self._task.scenario.starts) + 1):
                (their_orders, orders), (reports, their_reports) = os.pipe(), os.pipe()
                stack.callback(os.close, orders)
                stack.callback(os.close, reports)
                passed.callback(os.close, their_orders)
                passed.callback(os.close, their_reports)
                theirs += [their_orders, their_reports]
                words.append(f"{their_orders}:{their_reports}")
                self.members[number] = Member(number, orders, reports)
                self._selector.register(reports, selectors.EVENT_READ, self.members[number])
            paths = [str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")]
            self._process = subprocess.Popen(
                [sys.executable, "-m", "shoal.search.simulation.live.process", *words],
                stdin=subprocess.PIPE,
                stdout=self._errors,
                stderr=self._errors,
                bufsize=0,
                pass_fds=theirs,
                process_group=0,  # Ctrl-C reaches the supervisor, which then ends the processes
                env={**os.environ, **_QUIET, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
            )
            stack.callback(self._end)

    def _end(self) -> None:
        """Let the first process end all other processes and then itself."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    @property
    def running(self) -> bool:
        """Whether reports from at least one robot may still arrive."""
        return bool(self._selector.get_map())

    def kill(self, number: int) -> bool:
        """Kill the process of a robot. Return False if the process had already ended, or was not yet ready."""
        member = self.members[number]
        if member.ended or not member.process:
            return False
        with suppress(ProcessLookupError):
            os.kill(member.process, signal.SIGKILL)
        return True

    def collect(self, seconds: float, take: Callable[[Member, Report], None]) -> None:
        """Wait at most ``seconds`` seconds for reports, and pass each report to the function ``take``.

        The last report of every process has the kind "ended".
        """
        for key, _ in self._selector.select(max(seconds, 0.0)):
            member: Member = key.data
            data = os.read(key.fd, 1 << 16)
            if not data:
                member.ended = True
                self._selector.unregister(key.fd)
                take(member, {"kind": "ended"})
                continue
            *lines, member.rest = (member.rest + data).split(b"\n")
            for line in lines:
                report = json.loads(line)
                member.counts = report.get("counts", member.counts)
                take(member, report)

    def wait_ready(self, seconds: float) -> None:
        """Wait until the processes of all robots are ready.

        Raises
        ------
        ShoalError
            If the process of a robot ends before it is ready, or is not ready after ``seconds`` seconds.
        """
        reasons: dict[int, str] = {}

        def take(member: Member, report: Report) -> None:
            if report["kind"] == "ended":
                return
            member.port, member.process = int(report.get("port", 0)), int(report.get("process", 0))
            if "reason" in report:
                reasons[member.number] = report["reason"]

        limit = time.monotonic() + seconds
        while missing := [member for member in self.members.values() if not member.process]:
            self.collect(limit - time.monotonic(), take)
            for member in missing:
                if member.ended:
                    reason = reasons.get(member.number) or self._last_words()
                    raise ShoalError(f"robot {member.number}: its process ended before it was ready: {reason}")
            if time.monotonic() > limit and not missing[0].process:
                raise ShoalError(f"robot {missing[0].number}: its process was not ready after {seconds:g} s")

    def _last_words(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "no reason given"

    def begin(self, epoch: float) -> None:
        """Send every robot the start time of the search and the ports of all robots."""
        ports = [member.port for member in self.members.values()]
        word = json.dumps({"epoch": epoch, "ports": ports}).encode() + b"\n"
        for member in self.members.values():
            with suppress(BrokenPipeError):  # the process has died; reading its reports detects this
                os.write(member.orders, word)
