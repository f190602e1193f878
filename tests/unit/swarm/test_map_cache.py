"""Generated maps kept on disk."""

from __future__ import annotations

import io

import numpy as np
import pytest

from shoal.core.files import without_checksum
from shoal.swarm.maps.generators import catalogue as cache
from shoal.swarm.maps.generators import generate, generate_cached


@pytest.fixture(autouse=True)
def cache_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path


def test_kept_and_read_back(cache_folder, monkeypatch):
    first = generate_cached("vessels:300:4")
    (kept,) = cache_folder.rglob("*.map")
    monkeypatch.setattr(cache, "generate", lambda spec: pytest.fail("generated twice"))
    np.testing.assert_array_equal(generate_cached("vessels:300:4"), first)
    stored = np.load(io.BytesIO(without_checksum(kept.read_bytes())))
    np.testing.assert_array_equal(stored, generate("vessels:300:4"))


def test_a_damaged_file_is_made_again(cache_folder):
    generate_cached("vessels:300:4")
    (kept,) = cache_folder.rglob("*.map")
    whole = kept.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1  # one cell of the map: everything else about the file is right
    for damaged in (b"\x93NUMPY", bytes(flipped), whole[:-1], b""):
        kept.write_bytes(damaged)
        np.testing.assert_array_equal(generate_cached("vessels:300:4"), generate("vessels:300:4"))
        assert kept.read_bytes() == whole


def test_quick_maps_are_not_kept(cache_folder):
    generate_cached("line:9")
    assert not list(cache_folder.rglob("*.map"))


def test_a_folder_that_cannot_be_written_does_no_harm(cache_folder, monkeypatch):
    blocked = cache_folder / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    assert generate_cached("vessels:300:4").sum() == 300
