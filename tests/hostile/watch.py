"""What no reader may do: write outside its folder, reach for a network, start a program, import
what a file names.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import resource
import signal
import struct
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
_CHANGES = (
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.mkdir",
    "os.truncate",
    "os.chmod",
    "os.symlink",
    "os.link",
)
_IN_FOLDERS = ("os.remove", "os.rmdir", "os.mkdir")  # which may be told by a descriptor
_allowed: list[Path] = []
_seen: list[str] = []


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    if not _allowed:
        return
    if event in _FORBIDDEN:
        _seen.append(f"{event}{arguments[:2]}")
    elif event == "import" and str(arguments[0]).startswith(STRANGER):
        _seen.append(f"import {arguments[0]}")
    elif event in _CHANGES or (
        event == "open" and isinstance(arguments[2], int) and arguments[2] & _WRITES
    ):
        path, folder = arguments[0], arguments[-1] if event in _IN_FOLDERS else -1
        if folder >= 0:
            path = os.path.join(os.readlink(f"/proc/self/fd/{folder}"), os.fsdecode(path))
        if isinstance(path, str | bytes | os.PathLike) and not _is_allowed(os.fsdecode(path)):
            _seen.append(f"{event} {os.fsdecode(path)}")


def _is_allowed(path: str) -> bool:
    """Tell whether a path lies in the folder of the file that is read, or is where compiled code is
    kept.
    """
    whole = os.path.abspath(path)
    return (
        whole == os.devnull
        or "__pycache__" in whole
        or any(whole.startswith(str(folder)) for folder in _allowed)
    )


sys.addaudithook(_watch)


@contextlib.contextmanager
def watched(*folders: Path) -> Iterator[list[str]]:
    """Give a list of what was done that no reader may do while the block runs; files may be written
    in the folders.
    """
    _seen.clear()
    _allowed[:] = folders
    try:
        yield _seen
    finally:
        _allowed.clear()


# What also holds for code that is not Python's

MOST_MEMORY = 2**30
"""Bytes that reading may take above what the process has when it begins."""

_CALLS = {"x86_64": (41, 59, 322), "aarch64": (198, 221, 281)}  # socket, execve, execveat
_LOAD, _IF_EQUAL, _RETURN = 0x20, 0x15, 0x06  # classic BPF
_ALLOW, _KILL_PROCESS = 0x7FFF0000, 0x80000000
_NO_NEW_PRIVILEGES, _SECCOMP, _FILTER = 38, 22, 2  # prctl


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_void_p))


def confine(seconds: float) -> None:
    """Let the kernel end this process if it makes a socket or starts a program, or takes too long;
    and limit its memory.

    Sockets and programs end it by SIGSYS, on machines whose numbers of system calls are known here.
    `more_time` counts anew.
    """
    with open("/proc/self/status", encoding="ascii") as status:
        has = next(int(line.split()[1]) * 1024 for line in status if line.startswith("VmData"))
    resource.setrlimit(resource.RLIMIT_DATA, (has + MOST_MEMORY, has + MOST_MEMORY))
    more_time(seconds)
    calls = _CALLS.get(platform.machine(), ())
    rules = [
        (_LOAD, 0, 0, 0),
        *((_IF_EQUAL, len(calls) - k, 0, call) for k, call in enumerate(calls)),
    ]
    rules += [(_RETURN, 0, 0, _ALLOW), (_RETURN, 0, 0, _KILL_PROCESS)]
    code = ctypes.create_string_buffer(b"".join(struct.pack("<HBBI", *rule) for rule in rules))
    program = _Program(len(rules), ctypes.addressof(code))
    kernel = ctypes.CDLL(None, use_errno=True)
    if kernel.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0) or kernel.prctl(
        _SECCOMP, _FILTER, ctypes.byref(program)
    ):
        raise OSError(ctypes.get_errno(), "the kernel takes no filter of system calls")


def more_time(seconds: float) -> None:
    """End this process by SIGPROF after some seconds of the processor."""
    signal.setitimer(signal.ITIMER_PROF, seconds)
