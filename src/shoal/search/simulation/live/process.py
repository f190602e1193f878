"""Processes of a live search, one for each robot."""

from __future__ import annotations

import gc
import json
import os
import pickle
import selectors
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.errors import ShoalError
from shoal.search.allocation.allocate import partition
from shoal.search.problem.network import true_rate
from shoal.search.protocol.messages import Beacon, Heartbeat, decode_beacon, encode_beacon
from shoal.search.simulation.live.agent import Agent
from shoal.search.simulation.live.radio import LiveTask, LoopbackRadio
from shoal.search.simulation.live.vehicle import PointVehicle, ScenarioSensor

Report = dict[str, Any]
_STARTER = 0  # standard input
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
    """The processes of all live robots. When the ``with`` statement of a pool ends, all processes
    of the pool have ended.

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def _start(self, stack: ExitStack) -> None:
        """Start the first process, which forks the robots' processes."""
        data = pickle.dumps(self._task)
        ground = tempfile.TemporaryFile()  # noqa: SIM115 - closed by the stack
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
        """Kill the process of a robot. Return False if the process had already ended, or was not
        yet ready.
        """
        member = self.members[number]
        if member.ended or not member.process:
            return False
        with suppress(ProcessLookupError):
            os.kill(member.process, signal.SIGKILL)
        return True

    def collect(self, seconds: float, take: Callable[[Member, Report], None]) -> None:
        """Wait at most ``seconds`` seconds for reports, and pass each report to the function
        ``take``.

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
            If the process of a robot ends before it is ready, or is not ready after ``seconds``
            seconds.
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
                    raise ShoalError(
                        f"robot {member.number}: its process ended before it was ready: {reason}"
                    )
            if time.monotonic() > limit and not missing[0].process:
                raise ShoalError(
                    f"robot {missing[0].number}: its process was not ready after {seconds:g} s"
                )

    def _last_words(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "no reason given"

    def begin(self, epoch: float) -> None:
        """Send every robot the start time of the search and the ports of all robots."""
        ports = [member.port for member in self.members.values()]
        word = json.dumps({"epoch": epoch, "ports": ports}).encode() + b"\n"
        for member in self.members.values():
            # the process has died; reading its reports detects this
            with suppress(BrokenPipeError):
                os.write(member.orders, word)


def main(file: int, size: int, pipes: list[tuple[int, int]]) -> int:
    """Fork the robots' processes, and wait until the supervisor has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # reserved for the supervisor
    task: LiveTask = pickle.loads(os.pread(file, size, 0))
    _warm(task)
    # objects that exist before the fork share their memory until a process changes them
    gc.freeze()
    robots = []
    try:
        for number, (orders, reports) in enumerate(pipes, 1):
            robot = os.fork()
            if robot == 0:
                for pipe in pipes[number:]:
                    os.close(pipe[0])
                    os.close(pipe[1])
                os._exit(_live(task, number, file, orders, reports))
            robots.append(robot)
            os.close(orders)
            os.close(reports)
        while os.read(_STARTER, 1):
            pass
    finally:
        for (
            robot
        ) in robots:  # no process has been waited for, so each number still identifies its process
            os.kill(robot, signal.SIGKILL)
        for robot in robots:
            os.waitpid(robot, 0)
    return 0


def _warm(task: LiveTask) -> None:
    """Do slow initial work once, in the first process, so that the robots' processes need not
    repeat it.
    """
    brief = task.scenario.brief
    partition(brief.tour_cost, brief.allocator, ((1, task.scenario.starts[0], 1.0, 1),))
    decode_beacon(1, encode_beacon(Beacon(1, (Heartbeat(1, 0, 0, 1.0, "listening"),)))[0])


def _live(task: LiveTask, number: int, file: int, orders: int, reports: int) -> int:
    """Run one robot until all cells are searched, and return the exit code of its process."""

    def tell(report: dict[str, Any]) -> None:
        os.write(reports, json.dumps(report, separators=(",", ":")).encode() + b"\n")

    try:
        radio = LoopbackRadio(task.channel, task.port)
        robot, scenario = task.robot(number), task.scenario
        tell({"kind": "ready", "port": radio.port, "process": os.getpid()})
        word = _first_line(orders)
        if word is None:
            return 1
        radio.tell(word["ports"])
        epoch = word["epoch"]
        place = tuple(float(x) for x in robot.brief.tour_cost.points[robot.start])
        pilot = Agent(
            task,
            robot,
            task.messenger(number, radio),
            PointVehicle(place, lambda time: true_rate(robot.rate, scenario.faults, number, time)),
            ScenarioSensor(scenario, number, file),
            clock=lambda: (time.monotonic() - epoch) * task.speed,
            tell=tell,
            lifeline=orders,
        )
        time.sleep(max(0.0, epoch - time.monotonic()))
        return 0 if pilot.run() else 1
    except BrokenPipeError:
        return 1
    except BaseException as error:  # a forked process must not return to its parent's code
        traceback.print_exc()
        tell({"kind": "failed", "reason": "".join(traceback.format_exception_only(error)).strip()})
        return 1


def _first_line(orders: int) -> Any:
    """Return the first line from the supervisor, or None if the supervisor has ended."""
    line = b""
    while not line.endswith(b"\n"):
        more = os.read(orders, 65536)
        if not more:
            return None
        line += more
    return json.loads(line)


def _pair(word: str) -> tuple[int, int]:
    first, second = word.split(":")
    return int(first), int(second)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), [_pair(word) for word in sys.argv[3:]]))
