"""What no reader may do: write outside its folder, reach for a network, start a program, import what a file names."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.hostile.damages import STRANGER

_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_FORBIDDEN = (
    "socket.connect",
    "socket.bind",
    "socket.sendto",
    "socket.getaddrinfo",
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.posix_spawn",
    "os.fork",
)
_CHANGES = ("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.truncate", "os.chmod", "os.symlink", "os.link")
_allowed: list[Path] = []
_seen: list[str] = []


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    if not _allowed:
        return
    if event in _FORBIDDEN:
        _seen.append(f"{event}{arguments[:2]}")
    elif event == "import" and str(arguments[0]).startswith(STRANGER):
        _seen.append(f"import {arguments[0]}")
    elif event in _CHANGES or (event == "open" and isinstance(arguments[2], int) and arguments[2] & _WRITES):
        path = arguments[0]
        if isinstance(path, str | bytes | os.PathLike) and not _is_allowed(os.fsdecode(path)):
            _seen.append(f"{event} {os.fsdecode(path)}")


def _is_allowed(path: str) -> bool:
    """Tell whether a path lies in the folder of the file that is read, or is where compiled code is kept."""
    whole = os.path.abspath(path)
    return whole == os.devnull or "__pycache__" in whole or any(whole.startswith(str(folder)) for folder in _allowed)


sys.addaudithook(_watch)


@contextlib.contextmanager
def watched(*folders: Path) -> Iterator[list[str]]:
    """Give a list of what was done that no reader may do while the block runs; files may be written in the folders."""
    _seen.clear()
    _allowed[:] = folders
    try:
        yield _seen
    finally:
        _allowed.clear()
