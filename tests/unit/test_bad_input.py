"""Bad input on the command line: one clear sentence, exit code 2, and nothing half-written.

Each case gives the words of a command, in which {bad} is a folder of damaged files and {out} an
empty one, and words that the sentence must hold: what was expected, what came, and where.
"""

from __future__ import annotations

import inspect
import io
import json
import os
import pkgutil
import resource
import shlex
import signal
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.swarm_runs import run as play

import shoal
from shoal import lab, missions, rigs, robots, search, steering, swarm, views
from shoal.cli import run
from shoal.core.errors import InvalidInputError, OutputError, UnknownNameError
from shoal.jit import COMPILING
from shoal.swarm import GridWorkspace, SwarmEpisode, make_task

OPEN = GridWorkspace(np.ones((3, 3)))
RNG = np.random.default_rng(1)
SQUARE = [(0, 0), (9, 0), (9, 9), (0, 9)]
FIELD = search.open_region("square:40")
ROUTE = [(5.0, 5.0), (30.0, 5.0)]
TOUR = search.make_tour("comb", (4, 4))
COST = search.TourCost(TOUR)
EPISODE = play(OPEN, particles=2)
SHOAL = [sys.executable, "-c", "from shoal.__main__ import main; main()"]

# The damaged files


def png_header(width, height):
    """Return the first bytes of a PNG of that size, up to where its pixels should begin."""
    chunk = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + struct.pack(">I", 13)
        + chunk
        + struct.pack(">I4s", zlib.crc32(chunk), bytes(4))
        + b"IDAT"
    )


def bmp_header(width, height):
    return (
        b"BM"
        + struct.pack("<IHHI", 54, 0, 0, 54)
        + struct.pack("<IiiHHIIiiII", 40, width, height, 1, 24, 0, 0, 0, 0, 0, 0)
    )


def picture(kind, *, cut=None, **options):
    buffer = io.BytesIO()
    Image.fromarray(np.random.default_rng(1).integers(0, 256, (40, 50), dtype=np.uint8)).save(
        buffer, format=kind, **options
    )
    return buffer.getvalue()[:cut]


def array(values, *, cut=None):
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(values), allow_pickle=True)
    return buffer.getvalue()[:cut]


def infinite():
    values = np.ones((3, 4))
    values[1, 2] = np.inf
    return array(values)


FILES = {
    # Maps without a place for a particle, or with parts that cannot be reached
    "empty.txt": b"",
    "blank.txt": b"\n\n",
    "walls.txt": b"####\n####\n",
    "walls.png": picture("PNG"),  # painted black below
    "parts.txt": b"..#..\n..#..\n",
    # Text
    "ragged.txt": b"....\n...\n....\n",
    "letter.txt": b"....\n..x.\n",
    "spaces.txt": b"..\n. \n",
    "binary.txt": b"..\n\xff\xfe..",
    "two.csv": b"1,1\n1,2\n",
    "word.csv": b"1,1\nfree,1\n",
    "ragged.csv": b"1,1,1\n1,1\n",
    "semicolons.csv": b"1;0.5;1\n",
    "trailing.csv": b"1,0,\n",
    "header.map": b"type octile\nhigh 2\nwidth 2\nmap\n..\n..\n",
    "height.map": b"type octile\nheight 3\nwidth 4\nmap\n....\n....\n",
    "width.map": b"type octile\nheight 2\nwidth 5\nmap\n....\n....\n",
    "number.map": b"height " + b"9" * 5000 + b"\nmap\n..\n",
    "nothing.map": b"type octile\nheight 2\nwidth 2\n",
    "cut.map": b"type octile\nheight 2\nwidth 2\nmap\n",
    "letter.map": b"type octile\nheight 1\nwidth 3\nmap\n.#.\n",
    # Pictures
    "garbage.png": bytes(range(256)),
    "text.png": b"....\n....\n",
    "huge.png": png_header(60_000, 60_000),
    "huge.bmp": bmp_header(60_000, 60_000),
    "header.png": png_header(20, 10),
    "cut.png": picture("PNG", cut=600),
    "cut.jpg": picture("JPEG", cut=500),
    "cut.tif": picture("TIFF", cut=900),
    "cut.bmp": picture("BMP", cut=1500),
    # libtiff prints lines of its own
    "zipped.tif": (picture("TIFF", compression="tiff_adobe_deflate").replace(b"x\x9c", b"x\x00")),
    "cells.webp": picture("WEBP"),
    "cut.gif": picture("GIF", cut=1500),
    "gif.png": picture("GIF"),
    # Arrays
    "text.npy": b"....\n....\n",
    "picture.npy": picture("PNG"),
    "object.npy": array(np.array([[1, None]], dtype=object)),
    "nan.npy": infinite(),
    "line.npy": array([1, 1, 1]),
    "four.npy": array(np.ones((1, 2, 2, 2))),
    "complex.npy": array([[1j, 1]]),
    "words.npy": array([["free", "wall"]]),
    "none.npy": array(np.ones((0, 5))),
    "walls.npy": array(np.zeros((3, 3))),
    "cut.npy": array(np.ones((9, 9)), cut=500),
    "header.npy": array(np.ones((9, 9)), cut=50),
    "cells.npz": b"PK\x05\x06" + bytes(18),
    "cells": b"..\n",
    # Maps that are fine
    "cube.npy": array(np.ones((2, 4, 5))),
    "grey.png": picture("PNG"),
}


@pytest.fixture(scope="module")
def bad(tmp_path_factory):
    """A folder with all the damaged files."""
    folder = tmp_path_factory.mktemp("bad")
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    Image.new("L", (9, 7)).save(folder / "walls.png")
    (folder / "folder.png").mkdir()
    episode = play(
        GridWorkspace([[1, 1, 1, 0, 1, 1, 1]], name="seven"),
        start=[(0, 1), (0, 5)],
        policy="random-moves",
        seed=1,
    )
    assert episode.moves > 2
    covered = play(
        episode.workspace, start=[(0, 1), (0, 5)], policy="random-moves", seed=1, task="coverage"
    )
    episode.save(folder / "good.npz")
    for name, change in EPISODES.items():
        damage(folder / "good.npz", folder / f"{name}.npz", change)
    covered.save(folder / "cover.npz")
    damage(
        folder / "cover.npz",
        folder / "unreachable.npz",
        {"start": np.array([[0, 1], [0, 2]], np.int32)},
    )
    whole = (folder / "good.npz").read_bytes()
    (folder / "cut.npz").write_bytes(whole[: len(whole) // 2])
    (folder / "flipped.npz").write_bytes(flipped_in_data(whole))
    (folder / "notes.npz").write_bytes(b"no zip at all")
    (folder / "array.npz").write_bytes(array([1, 2]))
    return folder


EPISODES = {
    # name: the arrays to put in place of the good ones; None takes one out, a dict changes fields
    # of the header
    "no-header": {"header": None},
    "no-commands": {"commands": None},
    "no-start": {"start": None},
    "bad-json": {"header": np.frombuffer(b'{"format": 1,', np.uint8)},
    "number-header": {"header": np.array([1.5, 2.5])},
    "old-format": {"header": {"format": 7}},
    "extra-field": {"header": {"colour": "red"}},
    "bad-seed": {"header": {"seed": -1}},
    "bad-status": {"header": {"status": "bored"}},
    "bad-rule": {"header": {"problem": {"rule": "bounce"}}},
    "bad-task": {"header": {"problem": {"task": "mappping"}}},
    "no-task": {"header": {"problem": {"task": "math:pi"}}},
    "bad-shape": {"header": {"map": {"shape": [7]}}},
    "zero-shape": {"header": {"map": {"shape": [0, 7]}}},
    "big-shape": {"header": {"map": {"shape": [10**9, 10**9]}}},
    "other-shape": {"header": {"map": {"shape": [90, 7]}}},
    "commands-type": {"commands": np.array([0.0, 1.0])},
    "commands-range": {"commands": np.array([0, 1, 9], np.int8)},
    "commands-negative": {"commands": np.array([0, -1], np.int8)},
    "commands-3-d": {"commands": np.array([4, 5], np.int8)},
    "short-column": {"frontier": np.array([1], np.int32)},
    "wall-start": {"start": np.array([[0, 3]], np.int32)},
    "outside-start": {"start": np.array([[5, 5]], np.int32)},
    "twice-start": {"start": np.array([[0, 1], [0, 1]], np.int32)},
    "empty-start": {"start": np.zeros((0, 2), np.int32)},
    "float-start": {"start": np.array([[0.0, 1.0]])},
    "object-start": {"start": np.array([[None, 1]], dtype=object)},
    "all-walls": {"free": np.zeros(1, np.uint8)},
    "free-type": {"free": np.zeros(1, np.float32)},
    "wall-targets": {
        "targets": np.packbits([0, 0, 0, 1, 0, 0, 0]),
        "header": {"problem": {"task": "coverage"}},
    },
}


def damage(source, target, change):
    """Write an episode file in which some arrays are others."""
    with np.load(source) as archive:
        arrays = {name: archive[name] for name in archive.files}
    for name, value in change.items():
        if value is None:
            del arrays[name]
        elif isinstance(value, dict):
            header = json.loads(arrays["header"].tobytes())
            for field, new in value.items():
                header[field] = header[field] | new if isinstance(new, dict) else new
            arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        else:
            arrays[name] = value
    np.savez_compressed(target, allow_pickle=True, **arrays)


def flipped_in_data(whole):
    """Return a zip file with bits turned round in the first of its compressed arrays."""
    at = whole.index(b"header.npy") + 60
    return whole[:at] + bytes(byte ^ 0xFF for byte in whole[at : at + 40]) + whole[at + 40 :]


# The cases

LINE = "map line:5 -n 2"
NUMBERS = [
    ("map line:5 -n 0", "particles: expected a whole number from 1 to 268435456, got 0"),
    ("map line:5 -n -3", "particles: expected a whole number from 1 to 268435456, got -3"),
    ("map line:5 -n 6", "particles: expected 1 to 5 | got 6"),
    ("map line:5", "particles: expected 1 to 5 | got 100"),
    ("cover line:5 -n 0", "particles: expected a whole number from 1 to 268435456, got 0"),
    ("map line:5 --particles many", "--particles: expected a whole number | got 'many'"),
    ("map line:5 --particles 2.5", "--particles: expected a whole number | got '2.5'"),
    (f"{LINE} --trials 0", "trials: expected a whole number from 1 to 1000000000, got 0"),
    (f"{LINE} --trials -1", "trials: expected a whole number from 1 to 1000000000, got -1"),
    (f"{LINE} --workers 0", "workers: expected a whole number, 1 or more | got 0"),
    (f"{LINE} --workers -2", "workers: expected a whole number, 1 or more | got -2"),
    (f"{LINE} --max-moves -1", "max_moves: expected a whole number, 0 or more | got -1"),
    (f"{LINE} --seed -1", "seed: expected a whole number, 0 or more | got -1"),
    ("tour hilbert 8 --seed -1", "seed: expected a whole number, 0 or more, got -1"),
    ("line -n 3 --cells 9 --seed -1", "seed: expected a whole number, 0 or more, got -1"),
    (
        "schedule --scan-cost 2 --move-cost 1 --seed -1",
        "seed: expected a whole number, 0 or more, got -1",
    ),
    ("missions check . square:9 --seed -1", "seed: expected a whole number, 0 or more, got -1"),
    ("sweep check none --seed -1", "seed: expected a whole number, 0 or more, got -1"),
    (f"{LINE} --seed x", "--seed: expected a whole number | got 'x'"),
    (f"{LINE} --threshold bright", "--threshold: expected a number | got 'bright'"),
    (f"{LINE} --threshold 1.5", "threshold: expected a number from 0 to 1 | got 1.5"),
    (f"{LINE} --threshold nan", "threshold: expected a number from 0 to 1 | got nan"),
    (
        "map {bad}/grey.png -n 2 --threshold -0.1",
        "threshold: expected a number from 0 to 1 | got -0.1",
    ),
    (
        "map {bad}/grey.png -n 2 --scale 0",
        "scale: expected a number, above 0 and at most 64 | got 0",
    ),
    ("map {bad}/grey.png -n 2 --scale -1", "scale: expected a number, above 0 | got -1"),
    ("map {bad}/grey.png -n 2 --scale 65", "at most 64 | got 65"),
    ("map {bad}/grey.png -n 2 --scale inf", "scale: | got inf"),
    (
        "map maze:9x7 -n 2 --width 40",
        "width: expected no width for the generated map 'maze:9x7', got 40",
    ),
    (
        "map maze:9x7 -n 2 --join-diagonals",
        "join-diagonals: expected no join-diagonals for the generated map 'maze:9x7'",
    ),
    (
        "map {bad}/grey.png -n 2 --vessels --width 0",
        "width: expected a whole number, 1 or more, got 0",
    ),
    (
        f"map maze:9x7 -n {10**400}",
        "particles: expected a whole number from 1 to 268435456, got 1000",
    ),
    (
        f"map maze:9x7 -n 2 --trials {10**400}",
        "trials: expected a whole number from 1 to 1000000000, got 1000",
    ),
    (f"reach square --moves {10**400}", "moves: expected a whole number from 2 to 10000, got 1000"),
    ("cover line:5 -n 2 --subset 0", "subset: expected a number, above 0 and at most 1, got 0"),
    ("cover line:5 -n 2 --subset 1.5", "subset: expected a number, above 0 and at most 1, got 1.5"),
    ("cover line:5 -n 2 --subset -0.5", "subset: expected a number | got -0.5"),
    ("cover line:5 -n 2 --subset nan", "subset: expected a number | got nan"),
    ("cover line:5 -n 2 --subset half", "--subset: expected a number | got 'half'"),
]
MAPS = [
    ("map {bad}/missing.png", "{bad}/missing.png: expected a map, got no such file"),
    ("map 'two\nlines.png'", "two lines.png: expected a map, got no such file"),
    ("map {bad}/folder.png", "{bad}/folder.png: expected a map file, got a folder"),
    ("map {bad}", "{bad}: expected slices of one kind, got .bmp and"),
    ("map {bad}/cells", "{bad}/cells: expected a map file | got the suffix ''"),
    ("map {bad}/cells.webp", "{bad}/cells.webp: expected a map file | got the suffix '.webp'"),
    ("map {bad}/cut.gif", "cut.gif: expected a picture, got a damaged or truncated file"),
    ("map {bad}/cells.npz", "{bad}/cells.npz: expected a map file | got the suffix '.npz'"),
    ("map ''", "expected a map file | got the suffix ''"),
    ("map " + "x" * 400, "unknown map generator | known: line, rectangle"),
    ("map {bad}/" + "x" * 400 + ".png", "cannot be read: File name too long"),
    ("map {bad}/empty.txt", "empty.txt: expected a map, got an empty file"),
    ("map {bad}/blank.txt", "blank.txt, line 1: expected a row of cells, got an empty line"),
    (
        "map {bad}/walls.txt",
        "walls.txt: workspace: expected at least one free cell, got 8 obstacles only",
    ),
    (
        "map {bad}/walls.png",
        "walls.png: workspace: expected at least one free cell, got 63 obstacles only",
    ),
    (
        "map {bad}/walls.npy",
        "walls.npy: workspace: expected at least one free cell, got 9 obstacles only",
    ),
    (
        "map {bad}/parts.txt -n 5 --placement flood-fill",
        "flood-fill: expected 5 connected free cells around | parts | got only 4",
    ),
    (
        "cover {bad}/parts.txt -n 1",
        "coverage: expected a particle in every connected part of parts | got none | 4 of them",
    ),
    ("map {bad}/ragged.txt", "ragged.txt, line 2: expected 4 cells as in the first row, got 3"),
    ("map {bad}/letter.txt", "letter.txt, line 2, column 3: expected one of '.#', got 'x'"),
    ("map {bad}/spaces.txt", "spaces.txt, line 2, column 2: expected one of '.#', got ' '"),
    ("map {bad}/binary.txt", "binary.txt: expected text in UTF-8, got byte 0xff in line 2"),
    ("map {bad}/two.csv", "two.csv, line 2, column 2: expected 0 or 1, got '2'"),
    ("map {bad}/word.csv", "word.csv, line 2, column 1: expected 0 or 1, got 'free'"),
    ("map {bad}/ragged.csv", "ragged.csv, line 2: expected 3 cells as in the first row, got 2"),
    (
        "map {bad}/semicolons.csv",
        (
            "semicolons.csv, line 1, column 2: expected 0 or 1, got '0.5' (--level and --label take"
            " other"
        ),
    ),
    ("map {bad}/trailing.csv", "trailing.csv, line 1, column 3: expected 0 or 1, got ''"),
    (
        "map {bad}/header.map",
        "header.map, line 2: expected 'type NAME', 'height N', 'width N' or 'map', got 'high 2'",
    ),
    ("map {bad}/height.map", "height.map: expected height 3 according to the header, got 2"),
    ("map {bad}/width.map", "width.map: expected width 5 according to the header, got 4"),
    (
        "map {bad}/number.map",
        "number.map, line 1: expected 'type NAME', 'height N' | got 'height 999",
    ),
    (
        "map {bad}/nothing.map",
        "nothing.map: expected a line 'map' after the header, got none in 3 lines",
    ),
    (
        "map {bad}/cut.map",
        "cut.map, line 5: expected a row of cells after 'map', got the end of the file",
    ),
    ("map {bad}/letter.map", "letter.map, line 5, column 2: expected one of '.GS@OTW', got '#'"),
    (
        "map {bad}/garbage.png",
        "garbage.png: expected a PNG, TIFF, BMP or JPEG picture | begins with b'\\x00\\x01",
    ),
    (
        "map {bad}/text.png",
        "text.png: expected a PNG, TIFF, BMP or JPEG picture | begins with b'....\\n...'",
    ),
    ("map {bad}/gif.png", "gif.png: expected a PNG, TIFF, BMP or JPEG picture | begins with b'GIF"),
    ("map {bad}/huge.png", "huge.png: expected at most 268435456 cells, got 60000x60000"),
    ("map {bad}/huge.bmp", "huge.bmp: expected at most 268435456 cells, got 60000x60000"),
    (
        "map {bad}/header.png",
        "header.png: expected a picture, got a damaged or truncated file: | truncated",
    ),
    (
        "map {bad}/cut.png",
        "cut.png: expected a picture, got a damaged or truncated file: | truncated",
    ),
    (
        "map {bad}/cut.jpg",
        "cut.jpg: expected a picture, got a damaged or truncated file: | truncated",
    ),
    ("map {bad}/cut.tif", "cut.tif: | damaged"),
    (
        "map {bad}/zipped.tif",
        "zipped.tif: expected a picture, got a damaged or truncated file: decoder error",
    ),
    (
        "map {bad}/cut.bmp",
        "cut.bmp: expected a picture, got a damaged or truncated file: | truncated",
    ),
    (
        "map {bad}/cut.png --vessels",
        "cut.png: expected a picture, got a damaged or truncated file: | truncated",
    ),
    ("map {bad}/text.npy --vessels", "text.npy: expected a picture (.png | got '.npy'"),
    ("map {bad}/missing.png --vessels", "missing.png: expected a picture, got no such file"),
    ("map {bad}/empty.png --vessels", "empty.png: expected a picture"),
    (
        "map {bad}/walls.png --vessels",
        "walls.png: expected a picture of at least 16x16 pixels, got shape (7, 9)",
    ),
    ("map line:5 --vessels", "vessels: expected a photograph, got the generated map 'line:5'"),
    ("map {bad}/text.npy", "text.npy: expected a NumPy array file"),
    ("map {bad}/picture.npy", "picture.npy: expected a NumPy array file | PNG"),
    (
        "map {bad}/object.npy",
        "object.npy: expected a NumPy array file (.npy), got a damaged | Python objects in dtype",
    ),
    ("map {bad}/nan.npy", "nan.npy: expected finite numbers, got inf at cell (1, 2)"),
    ("map {bad}/line.npy", "line.npy: expected a 2-D or 3-D array | got int64 (3,)"),
    ("map {bad}/four.npy", "four.npy: expected a 2-D or 3-D array | got float64 (1, 2, 2, 2)"),
    ("map {bad}/complex.npy", "complex.npy: expected | booleans or numbers, got complex128 (1, 2)"),
    ("adversary closest-frontier --max-moves 0", "max_moves: expected a whole number, 1 or more"),
    ("steer square --check {bad}/words.npy --planner greedy", "--check: expected no --planner"),
    ("steer square --check {bad}/words.npy --max-moves 9", "--check: expected no --max-moves"),
    (
        "search square:60 --robots 2 --footprint 9,8,7",
        "footprint: expected one length, or 2 | got 3",
    ),
    ("map {bad}/words.npy", "words.npy: expected | booleans or numbers, got <U4 (1, 2)"),
    ("map {bad}/none.npy", "none.npy: workspace: expected at least one cell, got shape (0, 5)"),
    (
        "map {bad}/cut.npy",
        (
            "cut.npy: expected a NumPy array file (.npy), got a damaged or truncated file: |"
            " greater than file size"
        ),
    ),
    ("map {bad}/header.npy", "header.npy: expected a NumPy array file"),
    ("map maez:9x9", "unknown map generator 'maez': did you mean 'maze'?"),
    ("map maze", "expected a size (WIDTHxHEIGHT) in the map name, got 'maze'"),
    ("map maze:9", "expected a size of 2 numbers (WIDTHxHEIGHT), got '9'"),
    ("map line:0", "expected at least 1 for the cells, got '0'"),
    ("map line:five", "expected a whole number of cells, got 'five'"),
    ("map line:999999999999", "expected from 1 to 268435456 cells | got 999999999999"),
    ("map maze:9x9:-1", "expected a seed that is an integer of at least 0, got '-1'"),
    ("map line:5:1", "expected no seed | got 1 in 'line:5:1'"),
    ("maps maze:9x9:1 --seed 2", "seed: expected one seed, got 'maze:9x9:1' and --seed 2"),
    ("maps --seed 2", "--seed: expected the name of a map beside this option | got none"),
    ("maps --out {out}/x.png", "--out: expected the name of a map beside this option | got none"),
]
NAMES = [
    (
        f"{LINE} --policy closest-fronteir",
        "unknown policy 'closest-fronteir': did you mean 'closest-frontier'? | sweep",
    ),
    (f"{LINE} --policy ''", "unknown policy '': (known: closest-frontier"),
    (
        f"{LINE} --policy math:nope",
        (
            "cannot import the policy 'math:nope': AttributeError: module 'math' has no attribute"
            " 'nope'"
        ),
    ),
    (
        f"{LINE} --policy no_such_module:x",
        (
            "cannot import the policy 'no_such_module:x': ModuleNotFoundError: No module named"
            " 'no_such_module'"
        ),
    ),
    (
        f"{LINE} --policy builtins:map",
        "the policy 'builtins:map': expected a class without arguments",
    ),
    (
        f"{LINE} --policy math:pi",
        "policy: expected a name, or an object with a name and a method decide, got 3.14",
    ),
    (
        f"{LINE} --policy closest-frontier:tie=row-major",
        "policy 'closest-frontier' has no option 'tie' (it has ties, neighbours)",
    ),
    (
        f"{LINE} --policy closest-frontier:ties=any",
        "ties: expected column-major or row-major, got 'any'",
    ),
    (
        f"{LINE} --policy closest-frontier:neighbours=llll",
        "neighbours: expected an order of 'lurd', got 'llll'",
    ),
    (
        f"{LINE} --policy closest-frontier:ties=row-major,ties=row-major",
        "expected the option 'ties' once, got it again",
    ),
    (
        f"{LINE} --policy random-moves:fast",
        "the policy 'random-moves' has no option 'fast' (it has none)",
    ),
    (
        f"{LINE} --policy manual:llxr",
        "expected commands out of 'lurd' for a 2-D workspace, got 'x' at position 3",
    ),
    (
        f"{LINE} --policy manual:lr,rl",
        "the policy 'manual': expected the option 'commands' once, got it again in 'manual:lr,rl'",
    ),
    (f"{LINE} --policy manual:lio", "for a 2-D workspace, got 'i' at position 2"),
    ("map {bad}/cube.npy -n 2 --policy sweep", "policy sweep: expected a 2-D workspace, got 3-D"),
    (
        f"{LINE} --policy depth-first --rule tilt",
        "policy depth-first: expected rule block or merge, got tilt",
    ),
    (
        f"{LINE} --policy elect-particle --rule tilt",
        "policy elect-particle: expected rule block or merge, got tilt",
    ),
    (
        f"{LINE} --placement unifrom",
        "unknown placement 'unifrom': did you mean 'uniform'? | left-wall",
    ),
    (f"{LINE} --placement math:nope", "cannot import the placement 'math:nope'"),
    (
        f"{LINE} --placement math:pi",
        "placement: expected a name, or a function (workspace, n, rng) -> cells, got 3.14",
    ),
    (
        f"{LINE} --placement math:sqrt",
        "placement: expected a name, or a function (workspace, n, rng) -> cells, got",
    ),
    (
        f"{LINE} --rule blok",
        "rule: expected one of block, merge, tilt, got 'blok' (did you mean 'block'?)",
    ),
    (f"{LINE} --rule math:pi", "rule: expected one of block, merge, tilt, got 'math:pi'"),
    ("mpa line:5", "No such command 'mpa' | Did you mean 'map'"),
    (f"{LINE} --particels 3", "No such option: --particels | --particles"),
    ("map", "Missing argument 'MAP'"),
    ("replay", "Missing argument 'EPISODE'"),
    (f"{LINE} --trials", "Option '--trials' requires an argument"),
    ("map line:5 line:6", "unexpected extra argument | line:6"),
]
OUTPUTS = [
    (
        f"{LINE} --film {{out}}/x.avi",
        "x.avi: expected a film (.gif .mp4 .html), got the suffix '.avi'",
    ),
    (f"{LINE} --film {{out}}/x", "x: expected a film (.gif .mp4 .html), got the suffix ''"),
    (f"{LINE} --film /proc/nowhere/x.gif", "cannot write into the folder /proc/nowhere"),
    (
        f"{LINE} --film {{bad}}/letter.txt/x.gif",
        "cannot write into the folder {bad}/letter.txt: Not a directory",
    ),
    (f"{LINE} --film {{out}}/folder.gif/", "folder.gif: it is a folder"),
    (
        "map line:9 -n 2 --slip 0.1 --scan-every hyper",
        "noise: expected scan-every as a number of commands",
    ),
    ("map line:9 -n 2 --slip 0.1 --confidence 0.7", "confidence: expected a number, above 0.75"),
    (
        f"{LINE} --out {{bad}}/letter.txt",
        "cannot write into the folder {bad}/letter.txt: Not a directory",
    ),
    (
        f"{LINE} --out {{bad}}/letter.txt/below",
        "cannot write into the folder {bad}/letter.txt/below: Not a directory",
    ),
    (f"{LINE} --out /proc/nowhere", "cannot write into the folder /proc/nowhere"),
    (f"{LINE} --out {{out}}/{'x' * 400}", "cannot write into the folder | File name too long"),
    ("maps line:5 --out {out}/x.gif", "x.gif: expected one of the suffixes .png .tif | got '.gif'"),
    ("maps line:5 --out {out}/x", "x: expected one of the suffixes | got ''"),
    ("maps line:5 --out {out}/folder.png", "cannot write | folder.png: it is a folder"),
    ("maps line:5 --out {bad}/letter.txt/x.png", "cannot write {bad}/letter.txt/x.png: | exists"),
    (
        "maps line:5 --out /proc/nowhere/x.png",
        "cannot write /proc/nowhere/x.png: No such file or directory",
    ),
    (
        "demo --out {bad}/letter.txt",
        "cannot write into the folder {bad}/letter.txt: Not a directory",
    ),
]
REPLAYS = [
    ("replay {bad}/missing.npz", "{bad}/missing.npz: expected an episode file, got no such file"),
    ("replay {bad}", "{bad}: expected an episode file, got a folder"),
    ("replay " + "x" * 400, "expected an episode file, got no such file"),
    ("replay {bad}/good.npz --seed 2", "good.npz: expected an episode of seed 2, got seed 1"),
    (
        "replay {bad}/good.npz --film {out}/x.webm",
        "x.webm: expected a film | got the suffix '.webm'",
    ),
    ("replay {bad}/notes.npz", "notes.npz: expected an episode file | expected a zip archive"),
    ("replay {bad}/array.npz", "array.npz: expected an episode file | expected a zip archive"),
    ("replay {bad}/cut.npz", "cut.npz: expected an episode file | truncated"),
    ("replay {bad}/flipped.npz", "flipped.npz: expected an episode file | damaged"),
    ("replay {bad}/no-header.npz", "no-header.npz: | expected the arrays header, got none"),
    ("replay {bad}/no-commands.npz", "no-commands.npz: | expected the arrays commands, got none"),
    ("replay {bad}/no-start.npz", "no-start.npz: | expected the arrays start, got none"),
    ("replay {bad}/bad-json.npz", "bad-json.npz: expected an episode file | header: expected JSON"),
    (
        "replay {bad}/number-header.npz",
        "number-header.npz: expected an episode file | header: expected",
    ),
    (
        "replay {bad}/old-format.npz",
        "old-format.npz: expected an episode file | format: expected 1, got 7",
    ),
    (
        "replay {bad}/extra-field.npz",
        "extra-field.npz: expected an episode file | header: expected no such field, got 'colour'",
    ),
    (
        "replay {bad}/bad-seed.npz",
        "bad-seed.npz: | seed: expected a whole number, 0 or more, got -1",
    ),
    (
        "replay {bad}/bad-status.npz",
        "bad-status.npz: | status: expected one of complete | got 'bored'",
    ),
    (
        "replay {bad}/bad-rule.npz",
        "bad-rule.npz: | rule: expected one of block, merge, tilt, got 'bounce'",
    ),
    (
        "replay {bad}/bad-task.npz",
        "bad-task.npz: | unknown task 'mappping': did you mean 'mapping'?",
    ),
    ("replay --trust {bad}/no-task.npz", "no-task.npz: task: expected an object with | got 3.14"),
    ("replay {bad}/bad-shape.npz", "bad-shape.npz: | shape: expected 2 or 3 lengths | got [7]"),
    (
        "replay {bad}/zero-shape.npz",
        "zero-shape.npz: | shape: expected 2 or 3 lengths | got [0, 7]",
    ),
    (
        "replay {bad}/big-shape.npz",
        "big-shape.npz: | at most 268435456 cells in all, got [1000000000, 1000000000]",
    ),
    (
        "replay {bad}/other-shape.npz",
        "other-shape.npz: | free: expected 79 packed bytes for (90, 7), got uint8 (1,)",
    ),
    (
        "replay {bad}/commands-type.npz",
        "commands-type.npz: | commands: expected a column of int8, got float64 (2,)",
    ),
    (
        "replay {bad}/commands-range.npz",
        "commands-range.npz: | commands: expected codes 0 to 3, got 0 to 9",
    ),
    (
        "replay {bad}/commands-negative.npz",
        "commands-negative.npz: | commands: expected codes 0 to 3, got -1 to 0",
    ),
    (
        "replay {bad}/commands-3-d.npz",
        "commands-3-d.npz: | commands: expected codes 0 to 3, got 4 to 5",
    ),
    (
        "replay {bad}/short-column.npz",
        "short-column.npz: | frontier: expected | entries, one per command, got 1",
    ),
    (
        "replay {bad}/wall-start.npz",
        "wall-start.npz: | start: expected free cells, got the obstacle (0, 3)",
    ),
    (
        "replay {bad}/outside-start.npz",
        "outside-start.npz: | start: expected cells inside (1, 7), got (5, 5)",
    ),
    (
        "replay {bad}/twice-start.npz",
        "twice-start.npz: | start: expected at most one particle per cell | got two at (0, 1)",
    ),
    (
        "replay {bad}/empty-start.npz",
        "empty-start.npz: | start: expected at least one particle, got none",
    ),
    (
        "replay {bad}/float-start.npz",
        "float-start.npz: | start: expected integer cells of shape (n, 2), got float64",
    ),
    (
        "replay {bad}/object-start.npz",
        "object-start.npz: expected an episode file | Object arrays cannot be loaded",
    ),
    ("replay {bad}/all-walls.npz", "all-walls.npz: | expected at least one free cell"),
    (
        "replay {bad}/free-type.npz",
        "free-type.npz: | free: expected 1 packed bytes | got float32 (1,)",
    ),
    (
        "replay {bad}/wall-targets.npz",
        "wall-targets.npz: targets: expected free cells, got the obstacle (0, 3)",
    ),
    (
        "replay {bad}/unreachable.npz",
        "unreachable.npz: coverage: expected a particle in every connected part | at (0, 4)",
    ),
]


def files_below(*folders):
    return {
        (path, path.stat().st_size, path.stat().st_mtime_ns)
        for folder in folders
        for path in folder.rglob("*")
        if path.is_file()
    }


def assert_sentence(text, words):
    """One line that says ``words``, which are separated by " | "."""
    about_kernels = (COMPILING, "compiled kernels cannot be kept")  # where none was compiled yet
    text = "".join(
        line for line in text.splitlines(keepends=True) if not line.startswith(about_kernels)
    )
    assert text.startswith("shoal: ")
    assert text.endswith("\n")
    assert text.count("\n") == 1, f"more than one line: {text!r}"
    assert "Traceback" not in text
    assert len(text.split()) >= 4, f"no sentence: {text!r}"
    for word in words.split(" | "):
        assert word in text, f"{word!r} is not in {text!r}"


@pytest.mark.parametrize(("command", "words"), [*NUMBERS, *MAPS, *NAMES, *OUTPUTS, *REPLAYS])
def test_bad_input_gets_one_sentence(command, words, bad, tmp_path, monkeypatch, capfd):
    out = tmp_path / "out"
    for folder in ("folder.gif", "folder.png"):
        (out / folder).mkdir(parents=True)
    monkeypatch.chdir(out)
    before = files_below(bad, tmp_path)
    code = run(shlex.split(command.format(bad=bad, out=out)))
    printed, said = capfd.readouterr()
    assert_sentence(said, words.format(bad=bad, out=out))
    assert code == 2
    assert printed == ""
    assert files_below(bad, tmp_path) == before


def test_there_are_enough_cases():
    cases = [*NUMBERS, *MAPS, *NAMES, *OUTPUTS, *REPLAYS]
    assert len({command for command, _ in cases}) == len(cases) >= 45
    assert {f"{name}.npz" for name in EPISODES} <= {
        command.rpartition("/")[2] for command, _ in REPLAYS
    }


def test_a_file_that_may_not_be_read_is_not_called_damaged(bad, monkeypatch, capfd):
    """Root may read everything, so the refusal is played."""

    def refuse(self, *arguments, **options):
        raise PermissionError(13, "Permission denied", str(self))

    for name in ("grey.png", "cube.npy", "letter.txt", "two.csv", "good.npz"):
        with monkeypatch.context() as patch:
            patch.setattr(Path, "open", refuse)
            code = run(["replay" if name == "good.npz" else "map", str(bad / name)])
        assert_sentence(capfd.readouterr().err, f"{bad / name}: cannot be read: Permission denied")
        assert code == 2


def test_an_episode_that_was_changed_is_told_from_one_that_is_damaged(bad, tmp_path, capfd):
    """Exit code 1, and no output: the file can be read, but what it claims is not what its commands
    do.
    """
    damage(bad / "good.npz", tmp_path / "changed.npz", {"header": {"first_frontier": 99}})
    assert (
        run(["replay", str(tmp_path / "changed.npz"), "--out", str(tmp_path / "out"), "--json"])
        == 1
    )
    printed, said = capfd.readouterr()
    assert_sentence(said, "changed.npz: first_frontier differs: 99 stored")
    assert json.loads(printed)["verified"] is False
    assert not (tmp_path / "out").exists()


def test_help_is_no_bad_input(capfd):
    assert run([]) == 0
    printed, said = capfd.readouterr()
    assert "replay" in printed
    assert said == ""


@pytest.mark.parametrize(
    ("task", "error", "words"),
    [
        (
            "subset-coverag",
            UnknownNameError,
            "unknown task 'subset-coverag': did you mean 'subset-coverage'",
        ),
        ("math:nope", UnknownNameError, "cannot import the task 'math:nope'"),
        ("math:pi", InvalidInputError, "task: expected an object with name"),
        ("mapping:fast=1", InvalidInputError, "the task 'mapping' has no option 'fast'"),
        (
            "subset-coverage:fraction=half",
            InvalidInputError,
            "the task 'subset-coverage': fraction: expected a number, got 'half'",
        ),
        (
            "subset-coverage:2",
            InvalidInputError,
            "subset: expected a number, above 0 and at most 1, got 2",
        ),
    ],
)
def test_tasks_are_checked(task, error, words):
    with pytest.raises(error, match=words):
        make_task(task)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ([(0, 0), (0,)], "expected cells of 2 or 3 whole numbers each"),
        ([0, 1], r"got \[0, 1\]"),
        ([(0, 9)], r"expected cells inside \(1, 3\), got \(0, 9\)"),
        ([(0, -1)], r"got \(0, -1\)"),
        ([(10**30, 0)], "expected cells of 2 or 3 whole numbers"),
    ],
)
def test_starts_are_checked(start, words):
    with pytest.raises(InvalidInputError, match=f"start: .*{words}"):
        play(GridWorkspace([[1, 1, 1]]), start=start)


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ([(0, 0)], "expected 2 cells, got 1"),
        ([(0, 0), (0, 0)], r"got two at \(0, 0\)"),
        ([(0, 0), (0, 3)], r"got \(0, 3\)"),
        (None, "expected integer cells"),
    ],
)
def test_what_a_placement_of_others_returns_is_checked(cells, words):
    with pytest.raises(InvalidInputError, match=f"placement <lambda>: .*{words}"):
        play(GridWorkspace([[1, 1, 1]]), particles=2, placement=lambda workspace, n, rng: cells)


# Arguments of the wrong kind from Python


def masked(*values):
    return np.ma.masked_equal(values, values[-1])


def place_two(workspace=OPEN, n=2, rng=RNG):
    return swarm.place(workspace, n, "uniform", rng)


WRONG_KINDS = [
    (lambda: shoal.load(5), "path: expected the path of a file or folder, got 5"),
    (lambda: shoal.load_problem(b"x"), "path: expected the path of a file or folder, got b'x'"),
    (lambda: shoal.read_map(None), "path: expected the path of a file or folder, got None"),
    (lambda: shoal.write_map("x", "map.txt"), "workspace: expected a GridWorkspace, got 'x'"),
    (lambda: shoal.write_map(OPEN, 5), "path: expected the path"),
    (lambda: shoal.open_map([[1, 1], [1]]), "expected rows of .*, got rows of different lengths"),
    (lambda: shoal.open_map(masked(1, 0)[None]), r"got a masked one at \(0, 1\)"),
    (lambda: shoal.open_map([masked(1, 0)]), r"got a masked one at \(0, 1\)"),
    (lambda: shoal.run_trials("x", trials=1), "problem: expected a SwarmProblem, got 'x'"),
    (lambda: shoal.open_map([[masked(1, 0)]]), r"got a masked one at \(0, 0, 1\)"),
    (
        lambda: shoal.run_trials(swarm.SwarmProblem("line:9"), trials=1, on_trial=5),
        "on_trial: expected a function, got 5",
    ),
    (
        lambda: shoal.run_trials(swarm.SwarmProblem("line:9"), trials=1, on_moves="x"),
        "on_moves: expected a function, got 'x'",
    ),
    (lambda: rigs.decode_message("x"), "line: expected bytes, got 'x'"),
    (lambda: rigs.decode_message(None), "line: expected bytes, got None"),
    (lambda: robots.pair(5, {}), "cargos: expected a mapping from the numbers of robots, got 5"),
    (lambda: robots.pair({1: 2}, {}), "cargos: expected a Cargo, got 2"),
    (lambda: robots.pair({}, {"a": 1}), "seats: robot: expected a whole number, got 'a'"),
    (lambda: robots.pair({}, {}, robots=5), "robots: expected a list, got 5"),
    (lambda: shoal.film(EPISODE, 5), "path: expected the path"),
    (lambda: views.save_figure("x", "a.png"), "figure: expected a Figure, got 'x'"),
    (lambda: swarm.GridWorld(OPEN, [1]), r"rule: expected a name, got \[1\]"),
    (lambda: place_two(workspace="x"), "workspace: expected a GridWorkspace, got 'x'"),
    (lambda: place_two(n="x"), "particles: expected a whole number, got 'x'"),
    (lambda: place_two(rng=5), "rng: expected a Generator, got 5"),
    (lambda: steering.open_workspace([5]), r"workspace: expected the path .*, got \[5\]"),
    (lambda: steering.prism("x", 1.0), "base: expected a ConvexWorkspace, got 'x'"),
    (lambda: steering.disk(center=masked(0.0, 1.0)), r"center: .* got a masked one at \(0, 1\)"),
    (lambda: steering.disk(center=[1j, 2]), "center: expected one point of 2 numbers, got"),
    (lambda: steering.region(SQUARE, 5), "obstacles: expected a list, got 5"),
    (lambda: steering.ContactWorld("x"), "workspace: expected a ConvexWorkspace, got 'x'"),
    (lambda: steering.certify("x"), "episode: expected a SteeringEpisode, got 'x'"),
    (
        lambda: steering.polygon_reach("x", (0, 0), moves=2),
        "workspace: expected a ConvexWorkspace, got 'x'",
    ),
    (
        lambda: steering.reached_in_two_moves("x", (0, 0), (0, 0)),
        "workspace: expected a ConvexWorkspace, got 'x'",
    ),
    (lambda: steering.reflection_quartic("x", (0, 0)), "start and goal: expected 2 points"),
    (lambda: steering.reflection_quartic((0, 0), (0, np.nan)), "start and goal: expected finite"),
    (lambda: steering.reflection_quartic((0, 0), (0, 0), 0), "radius: expected a number, above 0"),
    (lambda: search.plan_search("x"), "problem: expected a SearchProblem, got 'x'"),
    (lambda: search.compare_plans(OPEN), "problem: expected a SearchProblem, got <GridWorkspace"),
    (lambda: search.cells_of("x", 1.0), "region: expected a SearchRegion, got 'x'"),
    (lambda: search.cells_of(FIELD, 10.0, angle="x"), "angle: expected a number"),
    (lambda: search.cells_of(FIELD, 10.0, offset=5), "offset: expected one point of 2 numbers"),
    (lambda: search.coverage_check("x", [], 1.0), "region: expected a SearchRegion, got 'x'"),
    (lambda: search.coverage_check(FIELD, 5, 1.0), "routes: expected a list, got 5"),
    (lambda: search.coverage_check(FIELD, np.array(5), 1.0), "routes: expected a list"),
    (lambda: search.coverage_check(FIELD, [ROUTE], 1.0, image="x"), "image: expected an Image"),
    (
        lambda: search.coverage_check(FIELD, [np.ma.masked_equal(ROUTE, 30)], 10.0),
        r"route 1: expected .*, got a masked one at \(1, 0\)",
    ),
    (
        lambda: search.coverage_check(FIELD, [ROUTE, ROUTE], masked(9.0, 8.0)),
        r"footprint: .*, got a masked one at \(1,\)",
    ),
    (lambda: search.RegionPaths("x"), "grid: expected a CellGrid, got 'x'"),
    (lambda: search.TourCost("x"), "tour: expected a Tour, got 'x'"),
    (lambda: search.TourCost(TOUR, turn_cost="x"), "turn cost: expected a number, 0 or more"),
    (lambda: search.Tour([[0, 0], [1]], (1, 2), closed=False, name="t"), "different lengths"),
    (lambda: search.Tour([[0, 0]], 5, closed=False, name="t"), "tour t: shape: expected a list"),
    (lambda: search.make_tour("comb", masked(4, 5)), r"mask: .* got a masked one at \(1,\)"),
    (lambda: search.allocate("x", [0]), "tour_cost: expected a TourCost, got 'x'"),
    (lambda: search.allocate(COST, [[0], [1, 2]]), "starts: .*, got rows of different lengths"),
    (lambda: search.allocate(COST, [0, 1], rates=masked(1.0, 2.0)), "rates: .* got a masked one"),
    (
        lambda: search.affordable_rectangle([(0, 0)], [[1], [2, 3]], footprint=1),
        r"ranges: expected a number, 0 or more, got \[1\]",
    ),
    (lambda: search.merge_collinear(5), "points: expected the points of a path"),
    (lambda: search.merge_collinear([[1], [2, 3]]), "points: .* rows of different lengths"),
    (lambda: search.hilbert_decode(1, order=1, dimensions=[2]), "dimensions: expected a whole"),
    (lambda: search.marker_rule(5), "markers: expected a list, got 5"),
    (lambda: search.read_tracks(5), "path: expected the path"),
    (lambda: search.open_region(np.array(3)), "polygon: expected .* points of shape"),
    (lambda: search.open_region(np.ma.masked_equal(SQUARE, 9)), "got a masked one"),
    (lambda: search.open_region(SQUARE, holes=np.array(3)), "expected a Shapely polygon or"),
    (lambda: search.open_region(SQUARE, layer="x"), "--layer: expected a GeoPackage .* polygons"),
    (lambda: search.region_of(FIELD.area, frame="x"), "frame: expected a LocalFrame, got 'x'"),
    (lambda: search.region_of(FIELD.area, no_go_zones=-1), "no_go_zones: expected .* 0 or more"),
    (lambda: search.SearchProblem(FIELD, bands=np.array(3)), "bands: expected"),
    (lambda: missions.Mission(np.array(3), (0, 0)), "expected"),
    (lambda: missions.MissionSet(5), "missions: expected a list, got 5"),
    (lambda: missions.MissionSet(["x"]), "missions: expected a Mission, got 'x'"),
    (lambda: missions.read_mission(5), "path: expected the path"),
    (lambda: missions.lint(5), "path: expected the path"),
    (lambda: missions.mission_files(5), "folder: expected the path"),
    (lambda: missions.check_missions(5, FIELD), "folder: expected the path"),
    (lambda: missions.write_missions(5, "out"), "missions: expected a list, got 5"),
    (lambda: missions.write_missions([], 5), "folder: expected the path"),
    (lambda: missions.split_missions(ROUTE, "x"), "flight: expected a Flight, got 'x'"),
    (lambda: lab.Store(5), "store: expected the path"),
    (lambda: lab.run_sweep("x", "store"), "sweep: expected a Sweep, got 'x'"),
    (lambda: lab.run_suite("x", [], "store"), "suite: expected a Suite, got 'x'"),
    (lambda: lab.scores("x", "y"), "store: expected a Store, got 'x'"),
    (lambda: lab.merge_stores("ab", "out"), "sources: expected a list, got 'ab'"),
    (lambda: rigs.DriveLog(5), "log: expected the path"),
    (lambda: rigs.read_log(5), "log: expected the path"),
    (lambda: rigs.SimulatedRig("x", [(0, 0)]), "workspace: expected a GridWorkspace, got 'x'"),
    (lambda: rigs.NoisyRig(OPEN, [(0, 0)], 5, RNG), "noise: expected a Noise, got 5"),
    (lambda: rigs.GridCalibration(5.0, origin="x"), "origin: expected one point of 2 numbers"),
    (lambda: rigs.tie_by_marks([[1], [2, 3]]), "mark: expected .*, got rows of different"),
    (lambda: rigs.open_rig(5), "rig: expected a text, got 5"),
    (lambda: rigs.open_camera(5), "camera: expected a text, got 5"),
    (lambda: robots.open_link(5), "link: expected a text, got 5"),
    (lambda: robots.read_seats(5), "systems: expected a text, got 5"),
    (lambda: robots.read_cargos(5), "folder: expected the path"),
    (lambda: robots.upload_missions(5, []), "pairs: expected a list, got 5"),
    (lambda: robots.upload_missions([(1, 2)], []), "pairs: expected pairs of a Cargo and a Seat"),
    (lambda: robots.check_fleet(5), "fleet: expected a Fleet, got 5"),
    (lambda: robots.SimulatedVehicle(autopilot="x"), "autopilot: expected one of"),
    (lambda: robots.SimulatedVehicle(home="x"), "home: expected one point of 2 numbers"),
]


@pytest.mark.parametrize(("call", "sentence"), WRONG_KINDS)
def test_an_argument_of_the_wrong_kind(call, sentence):
    with pytest.raises(InvalidInputError, match=sentence) as raised:
        call()
    assert "\n" not in str(raised.value)


# Names of files are of other people's making


@pytest.mark.parametrize(
    "name", ["$x^{$", "100 %", "[red]map", "血管", "a\nb", "caf\udce9", "<script>", "-n"]
)
def test_any_name_of_a_file_is_good(name, tmp_path, capfd):
    (tmp_path / f"{name}.txt").write_text("....\n")
    film = tmp_path / "film.html"
    assert (
        run(
            [
                "map",
                f"{tmp_path}/{name}.txt",
                "-n",
                "2",
                "--out",
                f"{tmp_path}/out",
                "--film",
                str(film),
            ]
        )
        == 0
    )
    printed, said = capfd.readouterr()
    assert said == ""
    assert "complete" in printed
    assert SwarmEpisode.load(tmp_path / "out" / "episode.npz").verify()


# Full disks

ROOM = 4096  # bytes, less than any of the outputs takes


@pytest.fixture(params=["a file system of 16 kB", "a limit on the size of files"])
def full_disk(request, tmp_path, monkeypatch):
    """A folder with room for a file of 4 kB, and a function that runs something in that room.

    The first way is the true one but only root can mount; the second works for everyone and gives
    another error.
    """
    # it may write a cache, which is not what is tested
    from matplotlib import font_manager  # noqa: F401

    folder = tmp_path / "disk"
    folder.mkdir()
    if request.param == "a limit on the size of files":

        def limited(function):
            soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
            # Python would keep compiled modules that are cut off
            monkeypatch.setattr(sys, "dont_write_bytecode", True)
            resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, hard))
            try:
                return function()
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

        yield folder, limited, "File too large"
        return
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", folder],
        capture_output=True,
        text=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"only root can mount a file system: {mounted.stderr.strip()}")
    try:
        (folder / "filler").write_bytes(bytes(16384 - ROOM))
        yield folder, lambda function: function(), "No space left on device"
    finally:
        subprocess.run(["umount", folder], check=True)


RANDOM = "map cave:60x40 -n 30 --policy random-moves --max-moves 150"


@pytest.mark.parametrize(
    "command",
    [
        f"{RANDOM} --out {{disk}}",
        f"{RANDOM} --out {{disk}}/new/folder",
        f"{RANDOM} --film {{disk}}/film.gif",
        f"{RANDOM} --film {{disk}}/film.mp4",
        f"{RANDOM} --film {{disk}}/film.html",
        "maps cave:300x300 --out {disk}/map.png",
        "maps cave:300x300 --out {disk}/map.tif",
        "maps cave:300x300 --out {disk}/map.bmp",
        "maps cave:300x300 --out {disk}/map.txt",
        "maps cave:300x300 --out {disk}/map.map",
        "maps cave:300x300 --out {disk}/map.csv",
        "maps cave:300x300 --out {disk}/map.npy",
        "tour comb cave:30x20 --out {disk}/tour",
        "line --cells 100 --particles 10 --out {disk}",
        "schedule --scan-cost 10 --move-cost 1 --out {disk}",
        "search square:60 --robots 3 --out {disk}",
    ],
)
def test_a_full_disk_leaves_nothing_behind(command, full_disk, capfd):
    folder, within, why = full_disk
    before = files_below(folder)
    arguments = shlex.split(command.format(disk=folder))
    code = within(lambda: run(arguments))
    printed, said = capfd.readouterr()
    if arguments[-1].endswith(".mp4") and why == "File too large":
        why = "the film encoder stopped"  # by a signal, before it could say a word
    assert_sentence(said, f"cannot write {folder} | {why}")
    assert code == 2
    assert printed == ""
    assert files_below(folder) == before


def test_an_episode_on_a_full_disk(full_disk):
    folder, within, why = full_disk
    episode = play(
        GridWorkspace(np.ones((30, 30))), particles=9, policy="random-moves", max_moves=9000
    )
    before = files_below(folder)
    with pytest.raises(OutputError, match=f"cannot write {folder}/new/episode.npz: {why}"):
        within(lambda: episode.save(folder / "new" / "episode.npz"))
    assert files_below(folder) == before


def test_a_full_disk_keeps_the_old_file(full_disk, capfd):
    folder, within, _ = full_disk
    assert run(["maps", "line:5", "--out", f"{folder}/map.txt"]) == 0
    assert within(lambda: run(["maps", "cave:300x300", "--out", f"{folder}/map.txt"])) == 2
    assert (folder / "map.txt").read_text() == ".....\n"
    capfd.readouterr()


def test_the_standard_output_on_a_full_disk():
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [*SHOAL, "map", "line:5", "-n", "2"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert_sentence(
        ended.stderr, "cannot read or write the standard output: No space left on device"
    )
    assert ended.returncode == 2


def test_a_reader_that_has_gone_is_no_error():
    """As in ``shoal maps | head``."""
    reading, writing = os.pipe()
    os.close(reading)
    ended = subprocess.run(
        [*SHOAL, "maps"], stdout=writing, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (0, "")


# From end to end


def test_bad_input_from_end_to_end(bad):
    command = [*SHOAL, "map", str(bad / "ragged.txt")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert_sentence(ended.stderr, "ragged.txt, line 2: expected 4 cells as in the first row, got 3")
    assert (ended.returncode, ended.stdout) == (2, "")


def test_a_terminal_without_the_letters_is_no_reason_to_stop():
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    command = [*SHOAL, "map", "line:5", "-n", "2"]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert r"\xb5s per move" in ended.stdout


# Interruptions


def interrupt(*arguments, **options):
    raise KeyboardInterrupt


def test_interrupted_while_it_plays(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("shoal.lab.trials.run", interrupt)
    assert run(["map", "line:5", "-n", "2", "--trials", "5", "--out", str(tmp_path)]) == 130
    printed, said = capfd.readouterr()
    assert (printed, said) == ("", "shoal: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_interrupted_while_it_writes(tmp_path, monkeypatch, capfd):
    """Whole files stay, the one that was being written does not."""
    whole = np.savez_compressed
    written = []

    def third_is_interrupted(file, **arrays):
        if len(written) == 2:
            file.write(b"half of")
            raise KeyboardInterrupt
        written.append(file)
        whole(file, **arrays)

    monkeypatch.setattr(np, "savez_compressed", third_is_interrupted)
    assert (
        run(["map", "line:9", "-n", "2", "--trials", "5", "--workers", "1", "--out", str(tmp_path)])
        == 130
    )
    assert capfd.readouterr().err.endswith("shoal: interrupted\n")
    files = sorted(
        str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()
    )
    assert files == ["episodes/00000.npz", "episodes/00001.npz", "frontier.png", "map.png"]
    for path in (tmp_path / "episodes").iterdir():
        assert SwarmEpisode.load(path).verify()


def test_interrupted_while_an_archive_is_made(tmp_path, monkeypatch):
    """A zip archive would answer an interruption with an error of its own, or swallow it."""
    whole, archived = np.savez_compressed, []

    def signalled(file, **arrays):
        signal.raise_signal(signal.SIGINT)
        whole(file, **arrays)
        archived.append(True)

    monkeypatch.setattr(np, "savez_compressed", signalled)
    episode = play(GridWorkspace([[1, 1, 1, 1]]), particles=2)
    with pytest.raises(KeyboardInterrupt):
        episode.save(tmp_path / "episode.npz")
    assert archived
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_interrupted_while_it_films(tmp_path, monkeypatch, capfd, suffix):
    from shoal.views.swarm import films

    frames = films.film_frames

    def three(*arguments, **options):
        for count, frame in enumerate(frames(*arguments, **options)):
            if count == 3:
                raise KeyboardInterrupt
            yield frame

    monkeypatch.setattr(films, "film_frames", three)
    assert run(["map", "cave:30x20", "-n", "9", "--film", f"{tmp_path}/film{suffix}"]) == 130
    assert capfd.readouterr().err.endswith("shoal: interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("loading", ["typer._click.core", "numpy._core", "shoal.swarm.problem"])
def test_ctrl_c_while_the_command_line_is_loaded(loading):
    """A real signal, when a module is being imported."""
    command = [sys.executable, "-X", "importtime", "-m", "shoal", "map", "vessels:9000", "-n", "9"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            while loading not in process.stderr.readline():
                assert process.poll() is None
            process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=30)[1]
        finally:
            process.kill()
    assert process.returncode == 130
    assert "Traceback" not in said
    assert [line for line in said.splitlines() if not line.startswith("import time:")] == [
        "shoal: interrupted"
    ]


def test_ctrl_c(tmp_path):
    """A real signal, while the episodes of many trials are written."""
    command = [
        *SHOAL,
        "map",
        "maze:9x9",
        "-n",
        "5",
        "--policy",
        "closest-frontier",
        "--trials",
        "1000",
        "--workers",
        "1",
        "--out",
        str(tmp_path / "out"),
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            until = time.monotonic() + 60
            while not (tmp_path / "out" / "episodes" / "00005.npz").exists():
                assert process.poll() is None, f"it ended too early: {process.communicate()}"
                assert time.monotonic() < until
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            printed, said = process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == 130
    assert printed == ""
    assert said.endswith("shoal: interrupted\n")
    assert "Traceback" not in said
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == ["episodes", "frontier.png", "map.png"]
    names = sorted(path.name for path in (out / "episodes").iterdir())
    assert 6 <= len(names) < 1000
    assert names == [f"{trial:05d}.npz" for trial in range(len(names))]
    assert all(
        SwarmEpisode.load(out / "episodes" / name).verify()
        for name in (names[0], names[-2], names[-1])
    )


@pytest.mark.parametrize("value", [3, "print", [print]])
@pytest.mark.parametrize(
    "function",
    [
        "shoal.lab.bench:run_suite",
        "shoal.lab.coordinator:run_sweep",
        "shoal.lab.trials:run_trials",
        "shoal.papers.reproduce:reproduce",
        "shoal.papers.reproduce:reproduce_all",
        "shoal.rigs.driving:drive",
        "shoal.rigs.remote:open_rig",
        "shoal.rigs.remote:RemoteRig",
        "shoal.robots.rehearsal:Rehearsal.run",
        "shoal.robots.starting:start_missions",
        "shoal.robots.starting:watch_fleet",
        "shoal.robots.uploading:upload_missions",
        "shoal.search.simulation.live.supervisor:run_live",
        "shoal.steering.driving:follow",
        "shoal.steering.driving:steer_rig",
        "shoal.swarm.run:run",
        "shoal.swarm.theory.one_dimension:sample",
        "shoal.views:film",
    ],
)
def test_what_is_called_back_must_be_a_function(function, value):
    """Refused before anything runs, and before whatever else is wrong."""
    call = pkgutil.resolve_name(function)
    parameters = inspect.signature(call).parameters.values()
    given = {one.name: None for one in parameters if one.default is one.empty}
    calls = [one.name for one in parameters if one.name.startswith("on_") and one.name != "on_map"]
    assert calls
    for name in calls:
        with pytest.raises(InvalidInputError, match=rf"^{name}: expected a function, got "):
            call(**given | {name: value})
