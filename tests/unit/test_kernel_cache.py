"""Where compiled kernels are kept: no folder, damage, a full disk, several first runs and a kill are no reason to stop."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from shoal import notices
from shoal.jit import COMPILING, cache

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
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("SHOAL_CACHE", "XDG_CACHE"))}
    return subprocess.Popen(
        [*prefix, sys.executable, str(script), *kinds], env=clean | environment, text=True, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )  # fmt: skip


def played(script, *kinds, **more):
    """Return what a run printed: its results, whether it compiled, and the lines on stderr."""
    process = start(script, *kinds, **more)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    results, compiled = out.splitlines()
    return results, compiled, [line for line in err.splitlines() if line != COMPILING]


def imported(script):
    """Return what the kernels give in this process, as if it had begun anew, and whether they were compiled."""
    cache._stamp.cache_clear()
    cache.folder_of.cache_clear()
    module = importlib.util.module_from_spec(importlib.util.spec_from_file_location(script.stem, script))
    module.__spec__.loader.exec_module(module)
    result = module.total(np.arange(4))
    return int(result), "compiled" if sum(module.total.stats.cache_misses.values()) else "loaded"


def test_beside_the_sources_and_in_a_named_folder(script, told, tmp_path, monkeypatch):
    assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]
    assert list((script.parent / "__pycache__").glob("*.nbi"))
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
    (kernels / "small.py").write_text("\n" + (kernels / "small.py").read_text())  # each kernel one line further down
    assert [imported(kernels / "small.py")[1] for _ in range(2)] == ["compiled", "loaded"]
    assert sorted(path.name for path in (kernels / "__pycache__").iterdir()) == before


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become another user")
def test_installed_by_root_and_used_by_somebody_without_a_home(script, tmp_path):
    for folder in script.parents:
        if folder != Path(tempfile.gettempdir()) and folder.is_relative_to(tempfile.gettempdir()):
            folder.chmod(0o755)
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    temporary.chmod(0o1777)
    become = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    reads = subprocess.run([*become, sys.executable, "-c", "import shoal"], capture_output=True, check=False)
    if reads.returncode:
        pytest.skip("another user cannot read the installation")
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


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_files_are_replaced(suffix, script):
    imported(script)
    for damage in (b"", b"\x80", b"garbage" * 99):
        for path in (script.parent / "__pycache__").glob(f"*{suffix}"):
            path.write_bytes(damage)
        assert [imported(script), imported(script)] == [(12, "compiled"), (12, "loaded")]


def test_a_full_disk_costs_time_and_one_line(script, told, tmp_path, monkeypatch):
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "none", str(small)], capture_output=True, check=False)
    if mounted.returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        monkeypatch.setenv("SHOAL_CACHE", str(small))
        assert imported(script) == (12, "compiled")
        assert len(told) == 1
        assert told[0].startswith("compiled kernels cannot be kept in")
        assert not list(small.rglob("*.tmp.*"))
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_three_first_runs_at_once_and_a_killed_one(script):
    killed = start(script, "int", "float", "short")
    while killed.poll() is None and not list((script.parent / "__pycache__").glob("*.nbi")):
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    runs = [start(script, *kinds) for kinds in (("int", "float"), ("float", "short"), ("short", "int"))]
    assert [run.communicate(timeout=120)[0].splitlines()[0] for run in runs] == ["12.0 12.0"] * 3
    assert played(script, "int", "float", "short") == ("12.0 12.0 12.0", "loaded", [])


def test_a_kernel_from_the_cache_is_not_taken_for_another_that_was_made_alike(script):
    alone = played(script, "made", "one")[0], played(script, "made", "nine")[0]
    assert alone[0] != alone[1]
    for path in (script.parent / "__pycache__").glob("*nine_more*"):
        path.unlink()
    assert played(script, "made", "one", "nine")[0] == " ".join(alone)  # one is loaded, then nine compiled
