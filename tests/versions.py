"""Test the declared bounds of all dependencies: ``make versions``, or ``python -m tests.versions lowest highest``.

For each word, Shoal is installed with all its extras into an environment of its own: with the lowest declared version of each
dependency, or with the highest that the bounds allow. A sample of tests runs there, against the installed package. Where a
dependency has an upper bound and a newer version is available, the sample also runs with that version, and a line tells
whether the bound can be raised.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXTRAS = ("imaging", "serial", "studio", "lab", "cluster", "volumes", "envs")
TOOLS = ("pytest", "hypothesis", "gpxpy", "lxml", "pymavlink", "bokeh-sampledata")
# Tests that use each dependency at least once, without the browser and without measurements of types or pages.
SAMPLE = (
    "tests/golden", "tests/unit/envs", "tests/unit/test_lab.py", "tests/unit/test_sweep.py", "tests/unit/test_cluster.py",
    "tests/unit/search/test_regions.py", "tests/unit/search/test_mission_lint.py", "tests/unit/studio/test_server.py",
    "tests/unit/studio/test_guard.py", "tests/unit/swarm/test_map_files.py", "tests/unit/swarm/test_volumes.py",
    "tests/unit/swarm/test_imaging.py", "tests/unit/swarm/test_rigs.py", "tests/unit/views/test_figure_and_film.py",
    "tests/unit/steering/test_svg.py", "tests/unit/test_kernel_cache.py",
)  # fmt: skip
_REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(?:\[[^]]*\])?>=(?P<lowest>[\w.]+)(?:,<(?P<bound>[\w.]+))?$")


def declared() -> dict[str, re.Match[str]]:
    """Return the declared range of every dependency that Shoal needs to run, by name.

    Raises
    ------
    SystemExit
        If a dependency has no lowest version.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    texts = [*project["dependencies"], *(text for extra in EXTRAS for text in extras[extra])]
    found = {text: _REQUIREMENT.match(text) for text in texts}
    if wrong := [text for text, match in found.items() if match is None]:
        raise SystemExit(f"pyproject.toml: expected NAME>=VERSION or NAME>=VERSION,<VERSION, got {', '.join(wrong)}")
    return {match["name"]: match for match in found.values() if match}


def passes(pins: list[str], beyond: str = "") -> bool:
    """Install Shoal with pinned versions, and then the package ``beyond`` its bound. Return whether the sample passes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("tests", "docs", "examples", "benchmarks", "README.md", "pyproject.toml"):
            source = ROOT / part
            (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / part)
        (folder / "src").mkdir()
        (folder / "pins.txt").write_text("\n".join(pins))
        subprocess.run([sys.executable, "-m", "venv", folder / "environment"], check=True)
        python = folder / "environment" / "bin" / "python"
        pip = [python, "-m", "pip", "--disable-pip-version-check", "-q", "install"]
        wanted = [f"{ROOT}[{','.join(EXTRAS)}]", *TOOLS]
        if subprocess.run([*pip, "-c", "pins.txt", *wanted], cwd=folder, env=_environment(), check=False).returncode:
            return False
        if beyond:
            subprocess.run([*pip, beyond], cwd=folder, env=_environment(), check=True)
        # Old libraries beside new ones of their own dependencies warn of one another.
        options = ["-q", "-p", "no:cacheprovider", "-o", "filterwarnings=default", "--disable-warnings"]
        tested = subprocess.run([python, "-m", "pytest", *options, *SAMPLE], cwd=folder, env=_environment(), check=False)
        return tested.returncode == 0


def _environment() -> dict[str, str]:
    """Return the environment variables without those that would bring in the lock or the sources of this checkout."""
    return {name: value for name, value in os.environ.items() if name not in {"PIP_CONSTRAINT", "PYTHONPATH"}}


def newer_than_bound(name: str, bound: str) -> str:
    """Return the newest available version of a dependency if its bound excludes that version, or an empty text."""
    told = subprocess.run(
        [sys.executable, "-m", "pip", "--disable-pip-version-check", "index", "versions", name],
        env=_environment(), capture_output=True, text=True, check=False,
    ).stdout  # fmt: skip
    newest = re.search(r"\(([\d.]+)\)", told)
    numbers = [tuple(map(int, text.split("."))) for text in (newest[1] if newest else "0", bound)]
    return newest[1] if newest and numbers[0] >= numbers[1] else ""


def main(words: list[str]) -> int:
    """Return 1 if a sample failed within the declared bounds."""
    failed = []
    ranges = declared()
    pins = {"lowest": [f"{name}=={match['lowest']}" for name, match in ranges.items()], "highest": []}
    for word in words or list(pins):
        print(f"== the {word} declared versions", flush=True)
        if not passes(pins[word]):
            failed.append(word)
    for name, match in ranges.items():
        newest = newer_than_bound(name, match["bound"]) if match["bound"] else ""
        if newest:
            print(f"== {name} {newest}, which the bound {match['bound']} excludes", flush=True)
            works = passes([], f"{name}=={newest}")
            print(f"{name} {newest} {'works: raise the bound' if works else 'fails: keep the bound'}")
        elif match["bound"]:
            print(f"{name}: no version is newer than the bound {match['bound']}")
    print("failed: " + ", ".join(failed) if failed else "the declared bounds hold")
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
