"""Write docs/cli.md from the commands' own --help. A test fails when it is out of date.

Run: python docs/generate_cli.py
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from shoal.cli import command_names

TARGET = Path(__file__).parent / "cli.md"
WIDTH = "84"  # what fits the page
COLOURED = ("FORCE_COLOR", "PY_COLORS", "GITHUB_ACTIONS", "TTY_COMPATIBLE")  # each would put escape codes into the text
INTRO = """# Commands

Results go to stdout, messages and progress to stderr. Exit codes: 0 done, 1 a check failed (`replay`, `missions check`), 2 bad
input or output (one sentence on stderr, nothing half-written), 130 interrupted.
"""


EACH = """
import sys
from shoal.cli import run
for command in sys.argv[1:]:
    run([*command.split(), "--help"])
    print(end="\\f")
"""


def helps_of(commands: list[str]) -> list[str]:
    """Return the help of each command, as a narrow terminal without colours shows it."""
    environment = {name: value for name, value in os.environ.items() if name not in COLOURED}
    environment |= {"COLUMNS": WIDTH, "TERMINAL_WIDTH": WIDTH, "TERM": "dumb", "NO_COLOR": "1", "PYTHONUTF8": "1"}
    arguments = [sys.executable, "-c", EACH, *commands]
    text = subprocess.run(arguments, env=environment, check=True, capture_output=True, text=True).stdout
    return ["\n".join(line.rstrip() for line in one.strip().splitlines()) for one in text.split("\f")[:-1]]


def page() -> str:
    """Return the text of docs/cli.md."""
    names = ["", *command_names()]
    sections = [
        f"\n## shoal{' ' * bool(name)}{name}\n\n```text\n{text}\n```\n" for name, text in zip(names, helps_of(names), strict=True)
    ]
    return INTRO + "".join(sections)


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
