"""Entry point of Shoal's command line: the command ``shoal``, and ``python -m shoal``."""

from __future__ import annotations

from typing import NoReturn

from shoal.core.interruption import begin


def main() -> NoReturn:
    """Run one command of Shoal, and exit with the command's exit code. After Ctrl-C, print one line and stop."""
    begin()
    from shoal.cli import main as command

    command()


if __name__ == "__main__":
    main()
