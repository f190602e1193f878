"""The server of the studio, which serves a folder at the address 127.0.0.1 until the
user stops it.
"""

from __future__ import annotations

import gc
import os
import socket
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import uvicorn

import shoal.steering.run
import shoal.studio.answers
import shoal.studio.work
from shoal.core.errors import InvalidInputError, OutputError
from shoal.lab.store import locked
from shoal.steering.problem import SteeringProblem
from shoal.studio.application import Studio, application_of
from shoal.studio.guard import Guard, LimitedConnection
from shoal.studio.jobs import FILE
from shoal.studio.work import play_live
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import load_kernels

PORT = 8790
"""Default port of the studio. If the default port is in use, the server chooses a free port."""


def listening(port: int | None) -> socket.socket:
    """Return a socket that listens at the address 127.0.0.1. Other machines cannot connect to the
    socket.

    Raises
    ------
    OutputError
        Raised if the requested port is in use.
    """
    for wanted in (PORT, 0) if port is None else (port,):
        # With the protocol named asyncio lets its connections send at once; else the second part of
        # each answer waits 40 ms.
        opened = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind(("127.0.0.1", wanted))
        except OSError as error:
            opened.close()
            why = error.strerror or str(error)
            continue
        opened.listen(128)
        return opened
    raise OutputError(f"cannot listen at port {wanted}: {why}")


def serve(
    root: str | os.PathLike[str],
    *,
    port: int | None = None,
    browser: bool = True,
    say: Callable[[str], None],
) -> None:
    """Serve a folder until the user presses Ctrl-C.

    Parameters
    ----------
    root : path
        Path of the folder, which is created if it does not exist. The studio's folder contains all
        data of the studio.
    port : int, optional
    browser : bool
        Whether to open the studio in a browser.
    say : callable
        Function that `serve` calls with the address of the studio.

    Raises
    ------
    InvalidInputError
        Raised if the path is not a folder, or if another studio uses the folder.
    OutputError
        Raised if the requested port is in use, or if the folder is not writable.
    """
    folder = Path(root).resolve()
    try:
        folder.mkdir(exist_ok=True)
        os.chdir(folder)
    except OSError as error:
        raise InvalidInputError(
            f"{root}: expected a folder, or the name of a new folder in an existing one, got the"
            f" error: {error.strerror}"
        ) from None
    with listening(port) as opened, _alone(folder):
        where = opened.getsockname()[1]
        guard = Guard(application_of(Studio(folder)), where)
        server = uvicorn.Server(
            uvicorn.Config(
                guard,
                http=LimitedConnection,
                ws="websockets-sansio",
                ws_max_size=2**16,
                log_level="error",
                access_log=False,
                timeout_keep_alive=30,
                timeout_graceful_shutdown=2,
                server_header=False,
                lifespan="on",
                proxy_headers=False,
            )
        )
        address = f"http://127.0.0.1:{where}/?token={guard.token}"
        say(f"the studio of {folder}: open {address}   (Ctrl-C ends it)")
        if browser:
            webbrowser.open(address)
        server.run(sockets=[opened])


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock the folder, because two servers for one folder would start each job twice."""
    with ExitStack() as held:
        try:
            held.enter_context(locked(folder / FILE, "studio"))
        except InvalidInputError:
            raise InvalidInputError(
                f"{folder}: expected a folder that no other studio serves, got one that is in use"
            ) from None
        yield


def _load() -> None:
    """Load the kernels that a run with the default policy needs, and the kernels for steering two
    particles.
    """
    for policy in ("best", "closest-frontier"):
        problem = SwarmProblem([[1, 1]], particles=1, policy=policy)
        load_kernels(problem)
    play_live(problem, 0, lambda _word, _what: None)
    for planner in ("greedy", "shortest"):
        start, goal = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
        shoal.steering.run.run(SteeringProblem("square", start, goal, planner=planner))
    gc.freeze()  # so that forks share the loaded objects


_load()
