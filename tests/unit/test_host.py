"""Other people's programs: `import shoal` leaves the program that imports it as it was."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import shoal

# What a program shares with its libraries. Printed before and after the import, in one form.
STATE = """
import os, signal, sys, threading, warnings
def state():
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    try:
        wakeup = signal.set_wakeup_fd(-1)
        signal.set_wakeup_fd(wakeup)
    except ValueError:  # in a thread, or in an interpreter inside the interpreter
        wakeup = None
    return {
        "path": list(sys.path), "signals": [signal.getsignal(number) for number in numbers], "wakeup": wakeup,
        "threads": threading.active_count(), "environment": dict(os.environ), "filters": list(warnings.filters),
        "folder": os.getcwd(), "arguments": list(getattr(sys, "argv", ["none"])), "recursion": sys.getrecursionlimit(),
        "hooks": [sys.excepthook, sys.unraisablehook, threading.excepthook, list(sys.meta_path), list(sys.path_hooks)],
    }
before = state()
import shoal
assert shoal.__version__
RUN
after = state()
changed = [name for name in before if before[name] != after[name]]
assert not changed, (changed, [(before[name], after[name]) for name in changed])
print("unchanged")
"""
ALONE = STATE.replace("RUN", "")
# NumPy changes the warning filters itself.
WITH_RUN = "import numpy\n" + STATE.replace(
    "RUN",
    'assert shoal.run("line:9", particles=3).status.done; shoal.SearchProblem;'
    " shoal.SteeringProblem",
)


def python(*words: str, folder: Path, **more: str) -> subprocess.CompletedProcess[str]:
    sources = str(Path(shoal.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": sources, **more}
    return subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


PROGRAMS = {
    "a script": ("program.py", ALONE),
    "a script that runs": ("program.py", WITH_RUN),
    # the name of a program may be anything, also that of our own command
    "a script named shoal": ("shoal", WITH_RUN),
    "no arguments, as in an embedded interpreter": (
        "program.py",
        f"import sys\ndel sys.argv\n{ALONE}",
    ),
    "empty arguments": ("program.py", f"import sys\nsys.argv[:] = []\n{ALONE}"),
    "arguments of a module being found": (
        "program.py",
        f"import sys\nsys.argv[:] = ['-m', 'map']\n{ALONE}",
    ),
    "a thread": (
        "program.py",
        (
            f"import threading\ncode = {WITH_RUN!r}\nthread = threading.Thread(target=exec,"
            " args=(code, {}))\nthread.start()\nthread.join()"
        ),
    ),
    "an interpreter inside Python": (
        "program.py",
        (
            f"code = {ALONE!r}\ntry:\n    import _interpreters as inner\n"
            "except ImportError:\n    import _xxsubinterpreters as inner\n"
            "failed = inner.run_string(inner.create(), code)\nassert not failed, failed"
        ),
    ),
}


@pytest.mark.parametrize("case", PROGRAMS)
def test_importing_shoal_changes_nothing(case, tmp_path):
    name, code = PROGRAMS[case]
    (tmp_path / name).write_text(code)
    ended = python(str(tmp_path / name), folder=tmp_path)
    assert (ended.returncode, ended.stdout) == (0, "unchanged\n"), ended.stderr
    assert not ended.stderr


PACKAGE = """
import shoal
"""
MAIN = """
import signal, sys, time
assert signal.getsignal(signal.SIGINT) in (signal.default_int_handler, signal.SIG_IGN)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background ignores it
import sibling  # a module beside the package, which `python -m` finds in the current folder
try:
    print("ready", flush=True)
    time.sleep(30)
except KeyboardInterrupt:
    print("interrupted by Python's own rule", flush=True)
finally:
    print("cleaned up", flush=True)
"""


def test_a_package_that_imports_shoal_and_is_started_as_a_module(tmp_path):
    """It keeps its own folder on the path, Ctrl-C raises KeyboardInterrupt, and its
    `finally` runs.
    """
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").write_text(PACKAGE)
    (tmp_path / "package" / "__main__.py").write_text(MAIN)
    (tmp_path / "sibling.py").write_text("")
    environment = {**os.environ, "PYTHONPATH": str(Path(shoal.__file__).parents[1])}
    with subprocess.Popen(
        [sys.executable, "-m", "package"],
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        restore_signals=True,
    ) as process:
        try:
            first = process.stdout.readline()
            assert first == "ready\n", process.stderr.read()
            process.send_signal(signal.SIGINT)
            said, error = process.communicate(timeout=30)
        finally:
            process.kill()
    assert said.splitlines() == ["interrupted by Python's own rule", "cleaned up"]
    assert (process.returncode, error) == (0, "")


def test_a_foreign_test_suite(tmp_path):
    """pytest, with warnings as errors, started as a module: `python -m pytest` has `-m` for its
    name while it is found.
    """
    (tmp_path / "conftest.py").write_text("import shoal\n")
    (tmp_path / "test_foreign.py").write_text(f"def test_state():\n    exec({ALONE!r}, {{}})\n")
    ended = python("-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider", folder=tmp_path)
    assert ended.returncode == 0, ended.stdout + ended.stderr


def test_a_notebook_kernel(tmp_path):
    """A notebook's kernel is started with `-m`, too, has a program's name that ends like ours, and
    runs cells by `exec`.
    """
    (tmp_path / "kernel").mkdir()
    (tmp_path / "kernel" / "__init__.py").write_text("import shoal\n")
    cells = f"import asyncio\ncells = [{WITH_RUN!r}, 'print(shoal.__version__)']\nspace = {{}}\n"
    loop = (
        "async def main():\n    for cell in cells:\n        exec(cell,"
        " space)\nasyncio.run(main())\n"
    )
    (tmp_path / "kernel" / "__main__.py").write_text(cells + loop)
    ended = python("-m", "kernel", "-f", "connection.json", folder=tmp_path)
    assert ended.stdout.splitlines() == ["unchanged", shoal.__version__], ended.stderr


def test_the_current_folder_stays_out_of_the_command(tmp_path):
    """`python -m shoal` itself runs no file of the current folder: from the first import on, also
    for modules of Python.
    """
    # Python's runpy needs none of them
    for name in "signal", "typing", "json", "hashlib", "secrets", "tempfile", "__future__":
        (tmp_path / f"{name}.py").write_text(
            f"import pathlib; pathlib.Path('ran-{name}').touch()\n"
        )
    ended = python("-m", "shoal", "map", "line:9", "-n", "2", "--json", folder=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert not list(tmp_path.glob("ran-*"))
