"""Entry point: the command ``shoal``, and ``python -m shoal``."""

from __future__ import annotations

from typing import NoReturn

from shoal.core.interruption import begin


def main() -> NoReturn:
    """Run one command and exit with its code. Ctrl-C prints one line, even while modules are loading."""
    begin()
    from shoal.cli import main as command

    command()


if __name__ == "__main__":
    main()
