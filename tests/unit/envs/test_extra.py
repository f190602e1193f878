"""Environments are an extra: without it one sentence says what to install, and the rest of Shoal
never loads it.
"""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest

from shoal.core.errors import MissingExtraError


@pytest.mark.parametrize("library", ["gymnasium", "pettingzoo"])
def test_without_the_extra(library, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("shoal.envs")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)  # as if it were not installed
    with pytest.raises(MissingExtraError, match=r'pip install "shoal\[envs\]"'):
        importlib.import_module("shoal.envs")


def test_an_id_with_its_module_needs_no_import():
    made = (
        "gymnasium.make('shoal.envs:shoal/Mapping-v0', map='line:5',"
        " particles=1).reset(seed=1)[0].shape"
    )
    told = subprocess.run(
        [sys.executable, "-c", f"import gymnasium; print({made})"],
        check=True,
        capture_output=True,
        text=True,
    )
    assert told.stdout == "(4, 3, 7)\n"
