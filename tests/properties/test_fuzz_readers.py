"""Readers of files and of what users type: whatever comes, the answer is a valid object or a
ShoalError of one line.

Warnings are errors in tests, so a reader that lets one through fails here, too.
"""

from __future__ import annotations

import gc
import io
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from tests.swarm_runs import run

from shoal.core.episode import Verification
from shoal.core.errors import ShoalError
from shoal.swarm import GridWorkspace, SwarmEpisode, make_policy, make_task
from shoal.swarm.grid.tasks import PLACEMENTS, TASKS, place
from shoal.swarm.maps import generators
from shoal.swarm.maps.files import open_map, read_map
from shoal.swarm.maps.generators import GENERATORS
from shoal.swarm.maps.pages import PICTURES
from shoal.swarm.policies import POLICIES

SUFFIXES = (*PICTURES, ".txt", ".map", ".npy", ".csv", ".mat", ".nrrd", ".dcm")
WORKSPACE = GridWorkspace([[1, 1, 0, 1], [0, 1, 1, 1]])
EPISODE = run(WORKSPACE, particles=2, policy="random-moves", seed=3, task="coverage")


@pytest.fixture(autouse=True, scope="module")
def _small_and_tidy():
    """Take only small maps, as a damaged header may ask for a huge one; find files that were left
    open.
    """
    with pytest.MonkeyPatch.context() as patch:
        for module in ("maps.reading", "maps.workspace", "simulation.episode_file"):
            patch.setattr(f"shoal.swarm.{module}.MAX_CELLS", 2**16)
        yield
        gc.collect()


def answer(call, *arguments, where=""):
    """Return what a call gives, or None if it refuses in one line."""
    try:
        return call(*arguments)
    except ShoalError as error:
        text = str(error)
        assert text.strip()
        assert "\n" not in text, f"more than one line: {text!r}"
        assert where in text, f"does not say where: {text!r}"
        assert len(text) < 1000, f"too long for a sentence: {text!r}"
        return None


def read(call, name, content):
    """Call a reader with a file of that name and content."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        return answer(call, path, where=name)


def assert_is_workspace(workspace):
    assert workspace is None or isinstance(workspace, GridWorkspace)
    if workspace is not None:
        assert workspace.n_free > 0
        assert workspace.ndim in (2, 3)
        assert len(workspace.text) >= workspace.free.size


def packed(values, **options):
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, np.asarray(values), **options)
    return buffer.getvalue()


@pytest.mark.parametrize("suffix", [".txt", ".map", ".csv"])
@settings(max_examples=80)
@given(
    st.text(alphabet="..##@GTW01,, \r\n\tmapheigwdt 2²\ufeff\x00\x1f\u2028", max_size=60),
    st.sampled_from(["utf-8", "utf-16", "latin-1"]),
)
@example("height 0\nwidth 0\nmap\n", "utf-8")
@example("map\n\n\n", "utf-8")
@example("height ²\nmap\n..", "utf-8")
def test_maps_of_any_text(suffix, text, encoding):
    assert_is_workspace(read(read_map, f"text{suffix}", text.encode(encoding, "replace")))


NPY_HEADERS = st.fixed_dictionaries(
    {
        "descr": st.sampled_from(
            [
                "<f8",
                "|b1",
                "<i4",
                "|O",
                "<U3",
                "<c16",
                "|V5",
                "|S0",
                "<M8[s]",
                "|a3",
                "f8,i4",
                "x",
                3,
                None,
                [("a", "<f8")],
            ]
        ),
        "fortran_order": st.sampled_from([True, False, 1, "yes"]),
        "shape": st.one_of(
            st.lists(st.sampled_from([-1, 0, 1, 2, 3, 10**5, 10**30, True]), max_size=5).map(tuple),
            st.sampled_from([3, None, "(2, 2)"]),
        ),
    }
)


@settings(max_examples=200)
@given(
    NPY_HEADERS,
    st.integers(0, 80),
    st.sampled_from([b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x00"]),
)
@example({"descr": "<f8", "fortran_order": False, "shape": (2, 2)}, 32, b"\x01\x00")
def test_arrays_of_any_header(header, size, version):
    text = repr(header).encode() + b"\n"
    length = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    content = b"\x93NUMPY" + version + length + text + b"\x01" * size
    assert_is_workspace(read(read_map, "header.npy", content))


# Episodes


def saved():
    with tempfile.TemporaryDirectory() as folder:
        EPISODE.save(Path(folder) / "episode.npz")
        return (Path(folder) / "episode.npz").read_bytes()


SAVED = saved()
with np.load(io.BytesIO(SAVED)) as _archive:
    ARRAYS = {name: _archive[name] for name in _archive.files}
HEADER = json.loads(ARRAYS["header"].tobytes())


def assert_is_episode(content):
    """An episode that loads can be verified, or says in one line why not."""
    episode = read(SwarmEpisode.load, "episode.npz", content)
    assert episode is None or isinstance(episode, SwarmEpisode)
    if episode is not None:
        verified = answer(episode.verify)
        assert verified is None or isinstance(verified, Verification)
        assert "\n" not in repr(episode.sentence)


def some_array():
    shapes = st.lists(st.integers(0, 4), max_size=3).map(tuple)
    dtypes = st.sampled_from(
        [
            np.int8,
            np.uint8,
            np.int32,
            np.int64,
            np.uint64,
            ">i4",
            np.float64,
            np.bool_,
            "U2",
            "S3",
            np.complex128,
        ]
    )
    return st.tuples(dtypes, shapes, st.integers(-3, 9)).map(
        lambda chosen: np.full(chosen[1], chosen[2]).astype(chosen[0])
    )


ANYTHING = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-2, 9),
    st.sampled_from(
        [
            10**30,
            float("nan"),
            float("inf"),
            "tilt",
            "merge",
            "mapping",
            "coverage",
            "complete",
            "subset-coverage:fraction=2",
        ]
    ),
    # a colon would import a module of that name
    st.text(alphabet=st.characters(blacklist_characters=":"), max_size=5),
    st.lists(st.integers(-1, 9), max_size=4),
)


@settings(max_examples=250)
@given(
    arrays=st.dictionaries(st.sampled_from([*ARRAYS, "other"]), some_array(), max_size=2),
    fields=st.dictionaries(st.sampled_from([*HEADER, "other"]), ANYTHING, max_size=2),
    missing=st.sets(st.sampled_from([*ARRAYS]), max_size=1),
)
def test_episodes_with_other_contents(arrays, fields, missing):
    changed = ARRAYS | arrays
    if "header" not in arrays:
        changed["header"] = np.frombuffer(json.dumps(HEADER | fields).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(
        buffer,
        allow_pickle=False,
        **{name: value for name, value in changed.items() if name not in missing},
    )
    assert_is_episode(buffer.getvalue())


# What users type

# few digits: a large map takes long, which is no fault
NUMBERS = st.text(alphabet="0123459xX:+-. ²٣", max_size=4)
LARGE = st.sampled_from(
    ["9" * 12, "1" * 300, "99999999x99999999", "1x" + "9" * 500, "-" + "9" * 99, "5:" + "9" * 300]
)


@settings(max_examples=150)
@given(
    st.sampled_from([*GENERATORS, "vessel", ""]),
    st.sampled_from([":", "", "::", " :"]),
    st.one_of(NUMBERS, LARGE),
)
def test_names_of_maps(name, colon, size):
    workspace = answer(open_map, name + colon + size)
    assert_is_workspace(workspace)


@settings(max_examples=100)
@given(st.one_of(st.text(max_size=30), st.text(alphabet="mazelin:x./\\\x00\t9", max_size=12)))
def test_names_of_maps_of_any_text(text):
    # the command line makes one line of a file name that has several
    text = text.replace("\n", " ")
    free = answer(generators.generate, text)
    assert free is None or free.any()
    assert_is_workspace(answer(open_map, text))


OPTIONS = st.one_of(
    st.text(alphabet=st.characters(blacklist_categories=["Cs"]), max_size=12),
    st.lists(
        st.tuples(
            st.sampled_from(
                ["ties", "neighbours", "commands", "fraction", "", "name", "kind", "self"]
            ),
            st.sampled_from(["=", "", "=="]),
            st.one_of(
                st.sampled_from(
                    ["row-major", "lurd", "drul", "lurdio", "0.5", "nan", "1e999", "-1"]
                ),
                st.text(alphabet="lurdio.=é ", max_size=6),
            ),
        ).map("".join),
        max_size=3,
    ).map(",".join),
)


@settings(max_examples=200)
@given(st.sampled_from([*POLICIES]), OPTIONS)
@example("manual", "l,u")
@example("random-moves", "=")
def test_policies_with_any_options(name, options):
    text = f"{name}:{options}"
    policy = answer(make_policy, text)
    if policy is not None:
        episode = answer(lambda: run(WORKSPACE, particles=3, policy=text, max_moves=12))
        assert episode is None or episode.verify()


@settings(max_examples=80)
@given(st.sampled_from([*TASKS]), OPTIONS)
def test_tasks_with_any_options(name, options):
    task = answer(make_task, f"{name}:{options}")
    assert task is None or task.name in TASKS


@settings(max_examples=80)
@given(
    st.one_of(
        st.text(alphabet=st.characters(blacklist_characters=":"), max_size=20),
        st.sampled_from([*POLICIES, *PLACEMENTS, *TASKS]),
    ),
    st.booleans(),
)
@example("", True)
@example("math", True)
def test_names_of_any_text(text, imported):
    """Every attribute of a module that exists, and every module that does not, is refused if it
    does not fit.
    """
    text = f"{text.strip('.')}no:such" if imported else text
    rng = np.random.default_rng(1)
    for make in (
        make_policy,
        make_task,
        lambda name: place(WORKSPACE, 2, name, rng),
        lambda name: run(WORKSPACE, particles=1, rule=name),
    ):
        answer(make, text)
