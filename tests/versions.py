"""Test the declared bounds of all dependencies: ``make versions``, or ``python -m tests.versions
lowest highest 3.13``.

For each word, Shoal is installed with all its extras into an environment of its own: with the
lowest declared version of each dependency, with the highest that the bounds allow, or with the
highest in another version of Python, if this machine has one. A sample of tests runs there, against
the installed package. Where a dependency has an upper bound and a newer version is available, the
sample also runs with that version, and a line tells whether the bound can be raised.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
UV = os.path.join(os.path.dirname(sys.executable), "uv")
EXTRAS = ("imaging", "physics", "serial", "studio", "lab", "cluster", "volumes", "envs")
TOOLS = ("pytest", "hypothesis", "gpxpy", "lxml", "pymavlink", "bokeh-sampledata")
# Tests that use each dependency at least once, without the browser and without measurements of
# types or pages.
SAMPLE = (
    "tests/golden",
    "tests/unit/envs",
    "tests/unit/test_lab.py",
    "tests/unit/test_sweep.py",
    "tests/unit/test_cluster.py",
    "tests/unit/search/test_regions.py",
    "tests/unit/search/test_mission_lint.py",
    "tests/unit/studio/test_server.py",
    "tests/unit/studio/test_guard.py",
    "tests/unit/swarm/test_map_files.py",
    "tests/unit/swarm/test_volumes.py",
    "tests/unit/swarm/test_imaging.py",
    "tests/unit/swarm/test_physics.py",
    "tests/unit/swarm/test_rigs.py",
    "tests/unit/views/test_figure_and_film.py",
    "tests/unit/steering/test_svg.py",
    "tests/unit/test_kernel_cache.py",
)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def dependencies() -> list[Requirement]:
    """Return all that Shoal and its extras need to run.

    Raises
    ------
    SystemExit
        If one has no lowest version.
    """
    texts = [
        *PROJECT["dependencies"],
        *(text for extra in EXTRAS for text in PROJECT["optional-dependencies"][extra]),
    ]
    found = [Requirement(text) for text in texts]
    if wrong := [
        str(one) for one in found if not any(limit.operator == ">=" for limit in one.specifier)
    ]:
        raise SystemExit(
            "pyproject.toml: expected NAME>=VERSION or NAME>=VERSION,<VERSION, got"
            f" {', '.join(wrong)}"
        )
    return found


def other_pythons() -> dict[str, str]:
    """Return the program of each declared version of Python on this machine, except the running
    one.
    """
    supported = SpecifierSet(PROJECT["requires-python"])
    programs = {}
    for version in (f"3.{minor}" for minor in range(11, 30)):
        if version in supported and version != f"3.{sys.version_info.minor}":
            pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
            for program in [
                shutil.which(f"python{version}"),
                *sorted(pyenv.glob(f"{version}.*/bin/python")),
            ]:
                # The program may be one that only says which versions pyenv has.
                if (
                    program
                    and subprocess.run(
                        [program, "-c", ""], capture_output=True, check=False
                    ).returncode
                    == 0
                ):
                    programs[version] = str(program)
    return programs


def passes(resolution: str = "highest", python: str = sys.executable, beyond: str = "") -> bool:
    """Install Shoal, and then the package ``beyond`` its bound. Return whether the
    sample passes.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("tests", "docs", "examples", "benchmarks", "README.md", "pyproject.toml"):
            source = ROOT / part
            (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / part)
        (folder / "src").mkdir()
        there = folder / "environment" / "bin" / "python"
        shoal = f"shoal[{','.join(EXTRAS)}] @ {ROOT.as_uri()}"
        install = [UV, "pip", "install", "-q", "--python", there]
        for words in (
            [UV, "venv", "-q", "--python", python, folder / "environment"],
            [
                *install,
                "--resolution",
                "lowest-direct" if resolution == "lowest" else "highest",
                shoal,
            ],
            [*install, *TOOLS],
            *([[*install, beyond]] if beyond else []),
        ):
            if subprocess.run(words, cwd=folder, env=_environment(), check=False).returncode:
                return False
        # Old libraries beside new ones of their own dependencies warn of one another.
        options = [
            "-q",
            "-p",
            "no:cacheprovider",
            "-o",
            "filterwarnings=default",
            "--disable-warnings",
        ]
        tested = subprocess.run(
            [there, "-m", "pytest", *options, *SAMPLE], cwd=folder, env=_environment(), check=False
        )
        return tested.returncode == 0


def _environment() -> dict[str, str]:
    """Return the environment variables without those that would bring in the lock or the sources of
    this checkout.
    """
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in {"PIP_CONSTRAINT", "PYTHONPATH"}
    }
    # Certificates are those of the system; a Python that is not here is not fetched.
    return {**kept, "UV_NATIVE_TLS": "1", "UV_PYTHON_DOWNLOADS": "never"}


def newer_than_bound(one: Requirement) -> str:
    """Return the newest available version of a dependency if its bounds exclude that version, or an
    empty text.
    """
    found = subprocess.run(
        [UV, "pip", "compile", "-q", "--no-deps", "--no-header", "--no-annotate", "-"],
        input=one.name,
        env=_environment(),
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    newest = found.partition("==")[2]
    return "" if newest in one.specifier else newest


def main(words: list[str]) -> int:
    """Return 1 if a sample failed within the declared bounds."""
    failed = []
    bounded = [
        one for one in dependencies() if any(limit.operator == "<" for limit in one.specifier)
    ]
    pythons = other_pythons()
    for word in words or ["lowest", "highest", *pythons]:
        print(
            f"== {f'the {word} declared versions' if word in ('lowest', 'highest') else f'Python {word}'}",
            flush=True,
        )
        if (
            not passes(word)
            if word in ("lowest", "highest")
            else not passes(python=pythons.get(word, word))
        ):
            failed.append(word)
    for one in bounded:
        if newest := newer_than_bound(one):
            print(f"== {one.name} {newest}, which {one.specifier} excludes", flush=True)
            works = passes(beyond=f"{one.name}=={newest}")
            print(
                f"{one.name} {newest}"
                f" {'works: raise the bound' if works else 'fails: keep the bound'}"
            )
        else:
            print(f"{one.name}: no version is newer than its bound ({one.specifier})")
    print("failed: " + ", ".join(failed) if failed else "the declared bounds hold")
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
