"""Where compiled kernels are kept: no folder, damage, a full disk, several first runs and a kill
are no reason to stop.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof

from shoal.core import notices
from shoal.jit import COMPILING, folders, lowered
from shoal.jit.machine_code import compiled_form, kinds_of_arguments, load_machine_code

SOURCE = Path(__file__).with_name("small_kernels.py")
NOBODY = 65534


@pytest.fixture
def told(monkeypatch):
    """What commands would print on stderr."""
    found = []
    monkeypatch.setattr(notices, "listeners", [found.append])
    monkeypatch.setattr(notices, "_told", {COMPILING})
    return found


@pytest.fixture
def script(tmp_path):
    """The kernels in a folder of their own."""
    folder = tmp_path / "code"
    folder.mkdir()
    shutil.copy(SOURCE, folder)
    return folder / SOURCE.name


def start(script, *kinds, prefix=(), **environment):
    clean = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("SHOAL_CACHE", "XDG_CACHE"))
    }
    return subprocess.Popen(
        [*prefix, sys.executable, str(script), *kinds],
        env=clean | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def played(script, *kinds, **more):
    """Return what a run printed: its results, whether it compiled, and the lines on stderr."""
    process = start(script, *kinds, **more)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    results, compiled = out.splitlines()
    return results, compiled, [line for line in err.splitlines() if line != COMPILING]


def imported_module(script):
    """Return the module of the kernels, imported as if this process had begun anew."""
    for function in (folders.stamp, lowered._opened, folders.folder_of):
        function.cache_clear()
    module = importlib.util.module_from_spec(
        importlib.util.spec_from_file_location(script.stem, script)
    )
    module.__spec__.loader.exec_module(module)
    return module


def imported(script):
    """Return what the kernels give in this process, and whether they were compiled."""
    module = imported_module(script)
    result = module.total(np.arange(4))
    return int(result), "compiled" if sum(
        module.total.entry.stats.cache_misses.values()
    ) else "loaded"


def test_beside_the_sources_and_in_a_named_folder(script, told, tmp_path, monkeypatch):
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert list((script.parent / "__pycache__").glob("*.kernel"))
    monkeypatch.setenv("SHOAL_CACHE", str(tmp_path / "named"))
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert not told
    (tmp_path / "file").touch()
    monkeypatch.setenv("SHOAL_CACHE", str(tmp_path / "file"))
    assert imported(script) == (12, "compiled")
    assert len(told) == 1
    assert told[0].startswith("SHOAL_CACHE: expected a folder that can be written")


def test_a_change_of_any_kernel_is_seen_and_leaves_nothing_behind(script):
    kernels = script.parent / "kernels"
    kernels.mkdir()
    script.rename(kernels / "small.py")
    (kernels / "other.py").write_text("factor = 1\n")
    assert imported(kernels / "small.py") == (12, "compiled")
    before = sorted(path.name for path in (kernels / "__pycache__").iterdir())
    (kernels / "other.py").write_text("factor = 2\n")
    (kernels / "small.py").write_text(
        "\n" + (kernels / "small.py").read_text()
    )  # each kernel one line further down
    assert [imported(kernels / "small.py")[1] for _ in range(2)] == ["compiled", "loaded"]
    assert sorted(path.name for path in (kernels / "__pycache__").iterdir()) == before


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become another user"
)
def test_installed_by_root_and_used_by_somebody_without_a_home(script, tmp_path, tmp_path_factory):
    shared, ours = (
        Path(tempfile.gettempdir()),
        tmp_path_factory.getbasetemp(),
    )  # the latter may be anywhere
    for folder in script.parents:
        if folder.is_relative_to(ours) or (folder != shared and folder.is_relative_to(shared)):
            folder.chmod(0o755)
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    temporary.chmod(0o1777)
    become = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    reading = "import sys, shoal; open(sys.argv[1])"
    reads = subprocess.run(
        [*become, sys.executable, "-c", reading, str(script)], capture_output=True, check=False
    )
    if reads.returncode:
        pytest.skip("another user cannot read the installation, or the folder of the tests")
    place = {"HOME": "/nonexistent", "TMPDIR": str(temporary), "PYTHONDONTWRITEBYTECODE": "1"}
    results, compiled, told = played(script, prefix=become, **place)
    assert (results, compiled, len(told)) == ("12.0", "compiled", 1)
    assert f"kept in {temporary}/shoal-kernels-{NOBODY}" in told[0]
    assert (temporary / f"shoal-kernels-{NOBODY}").stat().st_mode & 0o077 == 0
    # a folder of that name that somebody else made may hold anything: it is not used
    shutil.rmtree(temporary / f"shoal-kernels-{NOBODY}")
    (temporary / f"shoal-kernels-{NOBODY}").mkdir(mode=0o777)
    results, compiled, told = played(script, prefix=become, **place)
    assert (results, compiled, len(told)) == ("12.0", "compiled", 1)
    assert "compiled anew by each run" in told[0]
    assert not list((temporary / f"shoal-kernels-{NOBODY}").iterdir())


def test_a_kernel_in_the_cache_needs_no_numba(script):
    """Importing Numba takes longer than most commands. Whatever is imported later works beside what
    is loaded.
    """
    imported(script)
    program = """if True:
        import sys, numpy as np, small_kernels
        print(small_kernels.total(np.arange(4)), "numba" in sys.modules)
        print(small_kernels.total(np.arange(4.0)), "numba" in sys.modules)
        """
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=script.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == ["12 False", "12.0 True"]


def test_what_determines_a_compiled_form():
    class Pair(NamedTuple):
        one: object
        other: object

    class Twin(NamedTuple):
        one: object
        other: object

    numbers = np.zeros((4, 6))
    fixed = numbers.copy()
    fixed.setflags(write=False)
    arrays = [
        numbers,
        numbers.astype(np.float32),
        numbers.ravel(),
        numbers[:, ::2],
        numbers.T,
        fixed,
        numbers.view(np.recarray),
    ]
    records = [
        np.rec.array(np.zeros(1, dtype=[(name, kind)]))[0]
        for name, kind in (("a", "i8"), ("b", "i8"), ("a", "f8"))
    ]
    values = [
        *arrays,
        *records,
        1,
        2**63,
        True,
        1.0,
        None,
        np.int8(1),
        (1, 2),
        (1, 2.0),
        Pair(1, 2),
        Twin(1, 2),
        Pair(1, numbers),
    ]
    assert len({kinds_of_arguments((value,)) for value in values}) == len(values)
    assert kinds_of_arguments((1, Pair(2, numbers))) == kinds_of_arguments(
        (-5, Pair(7, numbers + 1))
    )
    for value in ("text", [1], np.timedelta64(1), {}):
        with pytest.raises(TypeError):
            kinds_of_arguments((1, value))


def test_arguments_of_one_numba_type_share_machine_code():
    flat = np.zeros((1, 4))
    values = [
        1,
        np.int64(2),
        True,
        np.bool_(0),
        1.0,
        np.float64(2),
        np.float32(2),
        flat,
        flat.T,
        flat[:, ::2],
        np.zeros((3, 4)),
    ]
    values += [
        np.zeros((3, 4)).T,
        np.zeros((0, 4)),
        (1, flat),
        (np.int64(1), np.zeros((3, 4))),
        (1.0, flat),
    ]
    for one in values:
        for other in values:
            same = compiled_form(kinds_of_arguments((one,))) == compiled_form(
                kinds_of_arguments((other,))
            )
            assert same == (typeof(one) == typeof(other)), (one, other)


def test_damaged_files_are_replaced(script):
    imported(script)
    (whole,) = (script.parent / "__pycache__").glob("*.kernel")
    for damage in (
        b"",
        b"\x80",
        b"garbage" * 99,
        whole.read_bytes()[:99],
        whole.read_bytes()[:-99],
    ):
        whole.write_bytes(damage)
        assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]


def test_a_flipped_bit_is_never_run(script):
    """Of 1,000 random places: machine code with a wrong bit may give wrong results, or end the
    process.
    """
    imported(script)
    (file,) = (script.parent / "__pycache__").glob("*.kernel")
    whole = file.read_bytes()
    kernel = imported_module(script).total
    kinds = kinds_of_arguments((np.arange(4),))
    assert load_machine_code(kernel.__wrapped__, kinds) is not None
    rng = np.random.default_rng(1)
    for place in rng.integers(len(whole) * 8, size=1000):
        damaged = bytearray(whole)
        damaged[place // 8] ^= 1 << place % 8
        file.write_bytes(damaged)
        assert load_machine_code(kernel.__wrapped__, kinds) is None, place
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert len(file.read_bytes()) == len(whole)


def test_the_file_of_one_kernel_is_not_taken_for_that_of_another(script):
    """A file that got another name, by a repair of the disk or by hand, is whole but compiled from
    something else.
    """
    module = imported_module(script)
    assert module.total(np.arange(4)) == 12
    assert module.total(np.arange(4.0)) == 12.0
    first, second = sorted((script.parent / "__pycache__").glob("*.kernel"))
    kept = first.read_bytes(), second.read_bytes()
    first.write_bytes(kept[1])
    second.write_bytes(kept[0])
    again = imported_module(script).total
    for numbers in (np.arange(4), np.arange(4.0)):
        assert load_machine_code(again.__wrapped__, kinds_of_arguments((numbers,))) is None
        assert again(numbers) == 12
    assert all(
        load_machine_code(again.__wrapped__, kinds_of_arguments((numbers,)))
        for numbers in (np.arange(4), np.arange(4.0))
    )


def test_a_damaged_cache_of_a_whole_command(tmp_path):
    """Five wrong bits in each file: the next command compiles, says nothing else, and gives the
    same moves.
    """
    words = [
        sys.executable,
        "-m",
        "shoal",
        "map",
        "rectangle:6x6",
        "-n",
        "3",
        "--policy",
        "closest-frontier",
        "--json",
    ]
    environment = {**os.environ, "SHOAL_CACHE": str(tmp_path)}
    environment["PYTHONPATH"] = str(Path(folders.__file__).parents[2])

    def moves():
        ended = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
        assert not [line for line in ended.stderr.splitlines() if line != COMPILING]
        return json.loads(ended.stdout)["moves"]

    before, rng = moves(), np.random.default_rng(2)
    files = sorted(tmp_path.rglob("*.kernel"))
    assert files
    kept = {file: file.read_bytes() for file in files}
    for file, content in kept.items():
        damaged = bytearray(content)
        for place in rng.integers(len(content) * 8, size=5):
            damaged[place // 8] ^= 1 << place % 8
        file.write_bytes(damaged)
    assert moves() == before
    assert {file: len(file.read_bytes()) for file in files} == {
        file: len(content) for file, content in kept.items()
    }


def test_a_full_disk_costs_time_and_one_line(script, told, tmp_path, monkeypatch):
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4k", "none", str(small)],
        capture_output=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        monkeypatch.setenv("SHOAL_CACHE", str(small))
        assert imported(script) == (12, "compiled")
        assert len(told) == 1
        assert told[0].startswith("compiled kernels cannot be kept in")
        assert not [path for path in small.rglob("*") if path.is_file()]
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_three_first_runs_at_once_and_a_killed_one(script):
    killed = start(script, "int", "float", "short")
    while killed.poll() is None and not list((script.parent / "__pycache__").glob("*.kernel")):
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    runs = [
        start(script, *kinds) for kinds in (("int", "float"), ("float", "short"), ("short", "int"))
    ]
    assert [run.communicate(timeout=120)[0].splitlines()[0] for run in runs] == ["12.0 12.0"] * 3
    assert played(script, "int", "float", "short") == ("12.0 12.0 12.0", "loaded", [])


def test_a_kernel_from_the_cache_is_not_taken_for_another_that_was_made_alike(script):
    alone = played(script, "made", "one")[0], played(script, "made", "nine")[0]
    assert alone[0] != alone[1]
    for path in (script.parent / "__pycache__").glob("*nine_more*"):
        path.unlink()
    assert played(script, "made", "one", "nine")[0] == " ".join(
        alone
    )  # one is loaded, then nine compiled


@pytest.fixture
def archive(script, monkeypatch):
    """The archive of the kernels, which are to be compiled; nothing is kept of them but that."""
    monkeypatch.setattr(lowered, "noted", {})
    assert imported(script) == (12, "compiled")
    lowered.write(script.parent)
    monkeypatch.setattr(lowered, "noted", None)
    forget(script)
    return script.parent / lowered.NAME


def forget(script):
    """Remove what is kept in the cache."""
    for path in (script.parent / "__pycache__").glob("*.kernel"):
        path.unlink()


def test_what_was_lowered_ahead_is_only_optimized(archive, script, told, monkeypatch):
    monkeypatch.setattr(notices, "_told", set())
    assert imported(script) == (12, "loaded")
    assert told == [COMPILING]
    archive.unlink()
    assert imported(script) == (12, "loaded")  # from the cache


@pytest.mark.parametrize("change", ["kernel", "numba", "platform", "damage", "part of it"])
def test_what_was_lowered_ahead_of_something_else_is_not_used(change, archive, script, monkeypatch):
    if change == "kernel":
        script.write_text(script.read_text().replace("2 * numbers", "10 * numbers"))
    elif change == "numba":
        monkeypatch.setattr(lowered.numba, "__version__", "0.0")
    elif change == "platform":
        monkeypatch.setattr(lowered.binding, "get_process_triple", lambda: "some-other-machine")
    elif change == "damage":
        archive.write_bytes(b"garbage" * 99)
    else:
        content = bytearray(archive.read_bytes())
        content[200:900] = bytes(700)
        archive.write_bytes(content)
    assert imported(script) == (60 if change == "kernel" else 12, "compiled")


def test_archives_fit_their_kernels():
    """If a kernel was changed: make kernels."""
    parts = {
        path.parent for path in Path(lowered.__file__).parents[1].glob("*/kernels/lowered.zip")
    }
    assert {part.parent.name for part in parts} == {"swarm", "steering", "search", "jit"}
    for part in parts:
        with zipfile.ZipFile(part / lowered.NAME) as archive:
            assert archive.comment.decode().startswith(lowered.stamp(part).hex()), (
                f"{part.parent.name}: make kernels"
            )
            assert not [
                kernel
                for kernel in archive.namelist()
                if str(Path.home()).encode() in archive.read(kernel)
            ]


def test_archives_hold_what_every_kind_of_command_calls():
    """Offline plans, drives, noise, the line, friction, regions, reach and rows once compiled
    theirs from the source.
    """
    held = set()
    for path in Path(lowered.__file__).parents[1].glob("*/kernels/lowered.zip"):
        with zipfile.ZipFile(path) as archive:
            held |= {kernel.rpartition("-")[0] for kernel in archive.namelist()}
    called = {
        "plan_search.prepare",
        "anneal.anneal",
        "policy_episode.begin_run",
        "noisy_state.learn_noisy",
        "line_samples.trials",
    }
    called |= {
        "cycles.is_kept_out",
        "cycles.grow_extreme_nodes",
        "shooting.search_guided",
        "region_contact.advance",
        "cycles.deepen",
    }
    assert called <= held
