"""The program in the processes of live robots: python -m shoal.search.simulation.live.process FILE SIZE IN:OUT ...

FILE is the descriptor of an open file. The first SIZE bytes of the file contain the task, and the same file holds the cell locks.
Each pair IN:OUT consists of the descriptors of two pipes, from the supervisor to one robot and from this robot to the supervisor.

The `process_pool` starts a first process, which imports all slow modules once and forks one process for each robot. Then, the first
process waits until its standard input closes, and ends the robots' processes that still run. The robots' processes share only the
open file. The process of a robot starts its search when it reads a line from IN, and writes one line of JSON for each event to OUT.
If the supervisor ends, IN closes, and the robot's process ends too.
"""

from __future__ import annotations

import gc
import json
import os
import pickle
import signal
import sys
import traceback
from typing import Any

from shoal.search.allocation.partition import partition
from shoal.search.protocol.messages import Beacon, Heartbeat, decode_beacon, encode_beacon
from shoal.search.simulation.live.agent import Agent
from shoal.search.simulation.live.task import LiveTask

_STARTER = 0  # standard input


def main(file: int, size: int, pipes: list[tuple[int, int]]) -> int:
    """Fork the robots' processes, and wait until the supervisor has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # reserved for the supervisor
    task: LiveTask = pickle.loads(os.pread(file, size, 0))
    _warm(task)
    gc.freeze()  # objects that exist before the fork share their memory until a process changes them
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
        for robot in robots:  # no process has been waited for, so each number still identifies its process
            os.kill(robot, signal.SIGKILL)
        for robot in robots:
            os.waitpid(robot, 0)
    return 0


def _warm(task: LiveTask) -> None:
    """Do slow initial work once, in the first process, so that the robots' processes need not repeat it."""
    brief = task.scenario.brief
    partition(brief.tour_cost, brief.allocator, ((1, task.scenario.starts[0], 1.0, 1),))
    decode_beacon(1, encode_beacon(Beacon(1, (Heartbeat(1, 0, 0, 1.0, "listening"),)))[0])


def _live(task: LiveTask, number: int, file: int, orders: int, reports: int) -> int:
    """Run one robot until all cells are searched, and return the exit code of its process."""

    def tell(report: dict[str, Any]) -> None:
        os.write(reports, json.dumps(report, separators=(",", ":")).encode() + b"\n")

    try:
        radio = task.radio(number)
        tell({"kind": "ready", "port": radio.port, "process": os.getpid()})
        word = _first_line(orders)
        if word is None:
            return 1
        radio.tell(word["ports"])
        pilot = Agent(task, task.robot(number), radio, ground=file, lifeline=orders, epoch=word["epoch"], tell=tell)
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
    one, other = word.split(":")
    return int(one), int(other)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), [_pair(word) for word in sys.argv[3:]]))
