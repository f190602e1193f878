"""How kernels are compiled, who is told, and what is not counted."""

import importlib.util
import time
from types import SimpleNamespace

import numpy as np
import pytest
from numba.core import config

from shoal import jit
from shoal.core import notices
from shoal.jit import cache, entry
from shoal.steering import SteeringProblem
from shoal.steering.planners.task import SteeringTask

SOURCE = """
import numpy as np
from shoal.jit import in_place_kernel, kernel

@in_place_kernel
def total(words):
    value = 0
    for i in range(words.shape[0]):
        value += words[i]
    return value

@kernel
def doubled(words):
    out = np.empty(words.shape[0], dtype=words.dtype)
    for i in range(words.shape[0]):
        out[i] = 2 * words[i]
    return out

@kernel
def total_of_doubled(words):
    return total(doubled(words))
"""


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Return a function that imports kernels whose caches lie beside them, and the list of what
    people were told.
    """
    told = []
    monkeypatch.setattr(notices, "listeners", [told.append])
    monkeypatch.setattr(notices, "_told", set())
    monkeypatch.delenv(cache.ENVIRONMENT, raising=False)  # names a folder for all caches
    path = tmp_path / "some_kernels.py"
    path.write_text(SOURCE)

    def load():
        spec = importlib.util.spec_from_file_location("some_kernels", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load, told, tmp_path


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_people_are_told_once_and_only_of_what_is_compiled(fresh):
    load, told, folder = fresh
    kernels, words = load(), np.arange(5)
    watch, began = jit.Stopwatch(), time.perf_counter()
    assert kernels.total_of_doubled(words) == 20
    elapsed = time.perf_counter() - began
    assert told == [jit.COMPILING]
    # compiling it takes some tenths of a second, calling it microseconds
    assert watch.seconds < 0.2 * elapsed
    # of the kernel that was called from Python; the others are parts of it
    assert len(list(folder.rglob("*.kernel"))) == 1
    assert kernels.total(words) == 10  # the same kernel called from Python is compiled for that
    assert len(list(folder.rglob("*.kernel"))) == 2
    assert told == [jit.COMPILING]


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_what_is_loaded_from_the_cache_is_not_told(fresh):
    load, told, _ = fresh
    assert load().total_of_doubled(np.arange(3)) == 6
    told.clear()
    notices._told.clear()
    watch = jit.Stopwatch()
    spent = jit.seconds_compiling()
    assert load().total_of_doubled(np.arange(3)) == 6
    assert not told
    assert jit.seconds_compiling() > spent  # loading takes time, too, which is not the kernel's
    assert watch.seconds >= 0


def test_a_time_limit_stands_still_while_kernels_compile(monkeypatch):
    """A limit of two seconds was over before the first use of a planner had compiled
    its kernels.
    """
    seconds = [100.0]
    monkeypatch.setattr(entry, "time", SimpleNamespace(perf_counter=lambda: seconds[0]))
    at = np.array([(0.2, 0.5), (0.4, 0.5)])
    task = SteeringTask(
        SteeringProblem("square", at, at).world(gain=0.0),
        at,
        at,
        1e-6,
        deadline=jit.working_time() + 2,
    )
    with entry.Compiling():
        seconds[0] += 60
    assert not task.late
    seconds[0] += 3
    assert task.late


def test_nobody_is_told_where_nobody_listens(monkeypatch):
    monkeypatch.setattr(notices, "listeners", [])
    monkeypatch.setattr(notices, "_told", set())
    notices.tell_once("some news")
    told = []
    notices.listeners.append(told.append)
    notices.tell_once("some news")
    notices.tell_once("some news")
    assert told == ["some news"]
