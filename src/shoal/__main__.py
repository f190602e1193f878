"""Entry point: the command ``shoal``, and ``python -m shoal``."""

from __future__ import annotations

import os
import sys
from typing import NoReturn


def main() -> NoReturn:
    """Run one command and leave with its exit code; Ctrl-C gives one line, also while the command line is being loaded."""
    try:
        from shoal.cli import main as command

        command()
    except KeyboardInterrupt:
        os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, b"shoal: interrupted\n")
        os._exit(130)  # nothing was begun that has to be ended


if __name__ == "__main__":
    main()
