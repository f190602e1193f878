"""Damage valid files of every format and read them: ``python -m tests.hostile 100000``.

A batch is read in a process of its own, which the kernel ends at a socket, at a program that is
started, and after 10 seconds for one file; it has 1 GiB of memory. Its working folder and its home
are empty, and must be so at the end.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import os
import random
import resource
import sys
import tempfile
import warnings
from pathlib import Path

from tests.hostile.damages import damaged
from tests.hostile.samples import SECONDS, Reader, faults, lay_out, samples
from tests.hostile.watch import MOST_MEMORY, confine, more_time, watched

BATCH = 250
Sample = tuple[Reader, list[dict[str, bytes]]]


def play(format_: str, sample: Sample, seed: int, folder: Path) -> list[str]:
    """Read one damaged file; return what is wrong with how it was taken."""
    read, valid = sample
    chance = random.Random(f"{format_} {seed}")
    files = dict(chance.choice(valid))
    name = chance.choice([*files][:1] * 3 + [*files])
    files[name] = damaged(name, files[name], chance)
    path = lay_out(files, folder)
    with watched(folder, Path(tempfile.gettempdir())) as seen, warnings.catch_warnings():
        warnings.simplefilter("error")
        wrong = faults(read, path)
        return [*wrong, *seen]


def batch(format_: str, sample: Sample, seeds: range, report: int) -> None:
    """Read files of one format in this process, which ends then; what is wrong goes down a pipe,
    and before each file its seed.
    """
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    confine(SECONDS)
    for seed in seeds:
        os.write(report, f"#{seed}\n".encode())
        more_time(SECONDS)
        with tempfile.TemporaryDirectory() as folder:
            wrong = play(format_, sample, seed, Path(folder))
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
        if grown > MOST_MEMORY // 1024:
            wrong.append(f"{grown // 1024} MB of memory")
            before += grown
        wrong += [f"left in the working folder or at home: {left}" for left in os.listdir()]
        with contextlib.suppress(ChildProcessError):
            wrong.append(f"a child is left: {os.waitpid(-1, os.WNOHANG)}")
        for one in wrong:
            os.write(report, f"{format_} {seed}: {one}\n".encode(errors="backslashreplace"))


def main() -> int:
    """Return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.hostile", description=__doc__)
    parser.add_argument("count", type=int, help="files in all")
    parser.add_argument("--formats", default="", help="only those whose names begin so")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    options = parser.parse_args()
    found: collections.Counter[str] = collections.Counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        tempfile.TemporaryDirectory() as home,
        contextlib.chdir(home),
    ):
        os.environ["HOME"] = home
        every = {
            name: one
            for name, one in samples(Path(folder)).items()
            if name.startswith(options.formats)
        }
        each = -(-options.count // len(every))
        for name, sample in every.items():
            for first in range(options.first, options.first + each, BATCH):
                for text in _forked(
                    name, sample, range(first, min(first + BATCH, options.first + each))
                ):
                    found[name] += 1
                    print(text, flush=True)
    print(
        f"{each * len(every)} files of {len(every)} formats, {sum(found.values())} taken wrongly",
        dict(found),
    )
    return int(bool(found))


def _forked(name: str, sample: Sample, seeds: range) -> list[str]:
    """Return what a batch in a process of its own reports, its death included."""
    reading, writing = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        batch(name, sample, seeds, writing)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, encoding="utf-8", errors="replace") as pipe:
        said = pipe.read()
    ended = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    at = said.rpartition("#")[2].split("\n")[0]
    wrong = [text for text in said.split("#") if text.partition("\n")[2].strip()]
    return [f"#{text.strip()}" for text in wrong] + (
        [f"{name} {at}: the process ended with {ended}"] if ended else []
    )


if __name__ == "__main__":
    sys.exit(main())
