"""The programs of docs/how-to/clients.md run as they stand, for 2,000 steps or more."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.clients.counted import STEPS

PAGE = Path(__file__).parents[2] / "docs/how-to/clients.md"
PROGRAMS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
LIBRARIES = (
    "supersuit",
    "stable_baselines3",
    "sb3_contrib",
    "torchrl",
    "skrl",
    "ray",
    "tianshou",
)


def name_of(program):
    """Return the first library that a program imports, and what of it."""
    imported = re.findall(r"^(?:from|import) (\w+)", program, re.MULTILINE)
    library = next((name for name in LIBRARIES if name in imported), "script")
    return "-".join(
        [library, *re.findall(r"\w+Policy(?=\")|(?<=import )PettingZooWrapper", program)]
    )


@pytest.mark.parametrize("program", PROGRAMS, ids=name_of)
def test_a_program_runs_as_it_stands(program, tmp_path):
    path = tmp_path / "program.py"
    path.write_text(program, encoding="utf-8")
    command = [sys.executable, str(Path(__file__).with_name("counted.py")), str(path)]
    told = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert told.returncode == 0, told.stderr[-2000:]
    assert int(re.findall(rf"{STEPS} (\d+)", told.stdout)[-1]) >= 2000


def test_the_page_has_a_program_for_each_library():
    libraries = {name_of(program).partition("-")[0] for program in PROGRAMS}
    assert libraries == {*LIBRARIES, "script"}
