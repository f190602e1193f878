"""Damaged files of every format: a result or one sentence, no more. ``python -m tests.hostile COUNT`` reads any number of them."""

from __future__ import annotations

import pytest
from tests.hostile.__main__ import play
from tests.hostile.samples import faults, lay_out, samples
from tests.hostile.watch import watched

from shoal.search.missions.files import FORMATS as MISSIONS
from shoal.search.regions.formats import _LAYERED, _READERS
from shoal.steering.workspaces.formats import SUFFIXES
from shoal.swarm.maps.files import FORMATS as MAPS

FILES = 10  # of each format


@pytest.fixture(scope="module")
def every(tmp_path_factory):
    return samples(tmp_path_factory.mktemp("samples"))


def test_damaged_files(every, tmp_path):
    for name, sample in every.items():
        for seed in range(FILES):
            folder = tmp_path / f"{name} {seed}"
            folder.mkdir()
            assert not play(name, sample, seed, folder), (name, seed)


def test_whole_files_are_taken_and_every_format_is_among_them(every, tmp_path):
    for name, (read, valid) in every.items():
        for number, files in enumerate(valid):
            with watched(tmp_path) as seen:
                read(lay_out(files, tmp_path / f"{name} {number}"))
            assert not seen
    suffixes = [("map ", MAPS), ("region ", (*_READERS, _LAYERED)), ("mission ", MISSIONS), ("workspace ", SUFFIXES)]
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
