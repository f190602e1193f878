"""What processes of the studio do in tests."""

from __future__ import annotations

import os
import resource
import signal
import sys
import time


def eat_memory(connection):
    """Ask for more than there may be."""
    try:
        bytearray(4 * 2**30)
    except MemoryError:
        connection.send("refused")


def crash(connection):
    """End without a word."""
    os.kill(os.getpid(), signal.SIGKILL)


def wait_with_child(connection):
    """Start a process of its own, and wait."""
    child = os.fork()
    if child == 0:
        time.sleep(60)
        os._exit(0)
    connection.send(child)
    time.sleep(60)


def play_on_a_full_disk(connection, root, spec):
    """Play an episode where no file may have more than a hundred bytes."""
    from shoal.studio.work import work  # not for the others, which need it not

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    sys.dont_write_bytecode = True  # Python would keep compiled modules that are cut off
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
    work(connection, root, "shoal.studio.work:play", spec, 1)
