"""Entry point of Shoal's command line: the command ``shoal``, and ``python -m shoal``."""

import gc
import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # `python -m shoal` puts the current folder first on the search path, where a file could replace
    # a module of Python.
    del sys.path[0]

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import NoReturn


def main() -> "NoReturn":
    """Run one command of Shoal, and exit with the command's exit code. After Ctrl-C, print one line
    and stop.
    """
    # signal takes some milliseconds, in which Ctrl-C would print a traceback
    import _signal  # type: ignore[import-not-found]

    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    from shoal.core.interruption import begin

    begin()
    # imported objects stay: scanning them again for garbage takes a sixth of a start
    gc.set_threshold(200_000)
    from shoal.cli import main as command

    command()


if __name__ == "__main__":
    main()
