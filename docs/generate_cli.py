"""Write docs/cli.md from the commands' own --help. A test fails when it is out of date.

Run: python docs/generate_cli.py
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TARGET = Path(__file__).parent / "cli.md"
COMMANDS = ("", "map", "cover", "maps", "replay", "demo")
INTRO = """# Commands

Results go to stdout, messages and progress to stderr. Exit codes: 0 done, 1 a check failed (`replay`), 2 bad input or output (one
sentence on stderr, nothing half-written), 130 interrupted.
"""


def help_of(command: str) -> str:
    """Return a command's help, as a terminal of 100 columns without colours shows it."""
    environment = dict(os.environ, COLUMNS="100", TERM="dumb", NO_COLOR="1", TERMINAL_WIDTH="100", PYTHONUTF8="1")
    arguments = [sys.executable, "-c", "from shoal.cli import main; main()", *filter(None, [command]), "--help"]
    text = subprocess.run(arguments, env=environment, check=True, capture_output=True, text=True).stdout
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def page() -> str:
    """Return the text of docs/cli.md."""
    sections = (f"\n## shoal{' ' * bool(command)}{command}\n\n```text\n{help_of(command)}\n```\n" for command in COMMANDS)
    return INTRO + "".join(sections)


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
