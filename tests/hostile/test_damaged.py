"""Damaged files of every format: a result or one sentence, no more. ``python -m tests.hostile
COUNT`` reads any number of them.
"""

from __future__ import annotations

import pkgutil
import re
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
from contextlib import closing
from pathlib import Path

import pytest
from tests.hostile.__main__ import play
from tests.hostile.corpus import CONTENTS, PLACES
from tests.hostile.samples import faults, lay_out, samples
from tests.hostile.watch import watched

from shoal.core.errors import InvalidInputError
from shoal.missions.formats import FORMATS as MISSIONS
from shoal.search.regions.formats import _LAYERED, _READERS
from shoal.steering.workspaces.formats import SUFFIXES
from shoal.swarm.maps.files import FORMATS as MAPS

ROOT = Path(__file__).parents[2]
FILES = 10  # of each format
# seeds that were taken wrongly once
FOUND = {"saved steering.json": 2108, "saved search.json": 105, "studio jobs": 500086}
LEAST = 20  # kinds of hostile files, for each reader
CONFINED = """
import os, socket, sys
from tests.hostile.watch import confine
confine(0.2)
{}
"""


@pytest.fixture(scope="module")
def every(tmp_path_factory):
    return samples(tmp_path_factory.mktemp("samples"))


def test_damaged_files(every, tmp_path):
    for name, sample in every.items():
        for seed in {*range(FILES), FOUND.get(name, 0)}:
            folder = tmp_path / f"{name} {seed}"
            folder.mkdir()
            assert not play(name, sample, seed, folder), (name, seed)


def test_whole_files_are_taken_and_every_format_is_among_them(every, tmp_path):
    for name, (read, valid) in every.items():
        for number, files in enumerate(valid):
            with watched(tmp_path, Path(tempfile.gettempdir())) as seen:
                read(lay_out(files, tmp_path / f"{name} {number}"))
            assert not seen
    suffixes = [
        ("map ", MAPS),
        ("region ", (*_READERS, *_LAYERED)),
        ("mission ", MISSIONS),
        ("workspace ", SUFFIXES),
    ]
    same = {".tiff", ".jpeg", ".json"}
    for kind, known in suffixes:
        assert {kind + one.lstrip(".") for one in known if one not in same} <= {*every}


def test_the_watch_sees_what_it_is_to_see(tmp_path):
    with watched(tmp_path) as seen:
        (tmp_path / "a").write_text("")
        (tmp_path.parent / "b").write_text("")
        wrong = faults(lambda _path: __import__("stranger_of_the_tests"), tmp_path)
    assert [text.split()[0] for text in seen] == ["open", "import"]
    assert "ModuleNotFoundError" in wrong[0]


@pytest.mark.parametrize(
    ("code", "ended"),
    [
        ("socket.socket()", signal.SIGSYS),
        ("os.execv(sys.executable, [sys.executable])", signal.SIGSYS),
        ("while True: pass", signal.SIGPROF),
        ("bytearray(2**30 + 2**27)", None),
    ],
)
@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's filter is Linux'")
def test_the_kernel_ends_what_readers_may_not_do(code, ended):
    said = subprocess.run(
        [sys.executable, "-c", CONFINED.format(code)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert said.returncode == (-ended if ended else 1)
    assert said.stderr.endswith("" if ended else "MemoryError\n")


def test_every_kind_of_hostile_file(every, tmp_path):
    for name, (read, (files, *_)) in every.items():
        first, content = next(iter(files.items()))
        assert (
            len({change(content) for change in CONTENTS.values()} - {content}) + len(PLACES) > LEAST
        ), name
        for number, (kind, change) in enumerate((CONTENTS | PLACES).items()):
            path = lay_out(files, tmp_path / f"{name} {number}")
            path.write_bytes(CONTENTS[kind](content)) if kind in CONTENTS else change(path)
            with watched(tmp_path, Path(tempfile.gettempdir())) as seen:
                wrong = faults(read, path)
            assert not wrong, (name, kind)
            assert not seen, (name, kind)
            assert path.name == Path(first).name


def test_geometries_nested_until_the_stack_would_end(every, tmp_path):
    read, (files, *_) = every["region gpkg"]
    path = lay_out(files, tmp_path)
    deep = b"".join(struct.pack("<BII", 1, kind, 1) for kind in (6, 7) * 20_000)
    with closing(sqlite3.connect(path)) as database:
        for (name,) in database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        ).fetchall():
            database.execute(f'DROP TRIGGER "{name}"')  # they need functions of GeoPackages
        database.execute("UPDATE a SET geom = ?", (b"GP\0\1" + bytes(4) + deep,))
        database.commit()
    with pytest.raises(
        InvalidInputError,
        match=r"feature 1: expected a geometry of straight lines, got a damaged one",
    ):
        read(path)


def test_the_page_of_limits_tells_those_that_hold():
    page = ROOT / "docs" / "concepts" / "trust.md"
    rows = re.findall(
        r"^\| .* \| ([\d,e]+) \| `([\w.]+)` \|$", page.read_text(encoding="utf-8"), re.MULTILINE
    )
    assert len(rows) > 20
    for number, name in rows:
        assert float(number.replace(",", "")) == pkgutil.resolve_name(name), name
