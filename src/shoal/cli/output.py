"""Functions for the output of commands: results go to stdout, and everything else goes
to stderr.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from threading import Timer
from typing import Any

from shoal.core.errors import InvalidInputError, OutputError

Advance = Callable[[int], None]


_CONTROLS = (
    *range(9),
    *range(11, 32),
    *range(127, 160),
    *range(0x202A, 0x202F),
    *range(0x2066, 0x206A),
)
_ESCAPED = {code: f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}" for code in _CONTROLS}


def visible(text: str) -> str:
    r"""Return a text in which a code such as ``\x1b`` replaces each control character, because file
    names may be hostile.

    Examples
    --------
    >>> print(visible("a\x1b[31mb"))
    a\x1b[31mb
    """
    return text.translate(_ESCAPED)


def say(text: str) -> None:
    """Print a message on stderr, with control characters made visible."""
    if sys.stderr is not None:  # None would mean stdout for print()
        print(visible(text), file=sys.stderr, flush=True)


def print_json(result: dict[str, Any]) -> None:
    """Print the dict ``result`` as one JSON object on stdout."""
    text = json.dumps(result, ensure_ascii=False, allow_nan=False)
    print(text, file=_stdout[-1] if _stdout else sys.stdout)


_stdout: list[Any] = []  # the stream of the JSON, while other texts go to stderr


@contextmanager
def only_json() -> Iterator[None]:
    """Send to stderr all that Python prints inside the ``with`` block, such as the texts of a user's
    own policy, except the JSON of `print_json`.
    """
    if sys.stdout is None or sys.stderr is None:
        yield
        return
    _stdout.append(sys.stdout)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _stdout.pop()


def print_table(
    rows: list[tuple[str, str]], *, title: str, written: Iterable[Path | str] = ()
) -> None:
    """Print a summary as a table of names and values on stdout, followed by the paths of the
    written files.
    """
    from rich.table import Table

    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="cyan", no_wrap=True)
    table.add_column(overflow="fold")
    for name, value in [*rows, *(("written", str(path)) for path in written)]:
        table.add_row(cell(name), cell(value))
    print_drawn(_titled(title, table))


def print_columns(
    names: list[str], values: list[str], rows: list[list[str]], *, title: str
) -> None:
    """Print a table with named columns on stdout.

    If the table is wider than the terminal, each row becomes a block of lines, because a name that
    is folded to a few characters a line cannot be read.
    """
    from rich.console import Console, Group
    from rich.table import Table
    from rich.text import Text

    columns = [*names, *values]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for number, name in enumerate(columns):
        table.add_column(cell(name), no_wrap=True, style="cyan" if number < len(names) else None)
    for row in rows:
        table.add_row(*map(cell, row))
    widths = [max(map(len, map(visible, entries))) for entries in zip(columns, *rows, strict=True)]
    if sum(widths) + 2 * len(widths) <= Console().width:
        print_drawn(_titled(title, table))
        return
    head = f"{title}: {values[0]}" if len(values) == 1 else title
    print_drawn(
        Group(Text(visible(head), style="bold"), *(_block(names, values, row) for row in rows))
    )


def _block(names: list[str], values: list[str], row: list[str]) -> Any:
    """Return a row of a table that is too wide for the terminal: its names, and its values in the
    lines below, without dashes.
    """
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    named = [f"{name} = {entry}" for name, entry in zip(names, row, strict=False)]
    shown_values = [
        entry if len(values) == 1 else f"{name} {entry}"
        for name, entry in zip(values, row[len(names) :], strict=True)
        if entry != "-"
    ]
    lines = [Text(visible(", ".join(named)), style="cyan")]
    return Group(
        *lines,
        *[Padding(Text(visible(", ".join(shown_values))), (0, 0, 0, 4))] * bool(shown_values),
    )


def _titled(title: str, table: Any) -> Any:
    """Return a table below its title; the title does not wrap even if the table is narrow."""
    from rich.console import Group
    from rich.text import Text

    return Group(Text(visible(title), style="bold"), table)


def cell(text: str) -> str:
    """Return ``text`` for a table cell, changed so that markup and control characters have no
    effect.
    """
    from rich.markup import escape

    return escape(visible(text))


def print_drawn(drawn: Any) -> None:
    """Print an object of the library Rich, such as a table, on stdout."""
    from rich.console import Console

    console = Console(soft_wrap=False)
    with console.capture() as captured:
        console.print(drawn)
    # not by the console, which ends the program itself when a pipe is closed
    print(captured.get(), end="")


@contextmanager
def progress(what: str, total: int, *, shown: bool) -> Iterator[Advance]:
    """Show a progress bar on stderr while the ``with`` block runs.

    The context manager gives the block a function, which the block calls with the amount of
    finished work, from 0 to ``total``.

    If stderr is not a terminal, `progress` prints a line of text after every tenth of the work. If
    ``shown`` is false, `progress` prints nothing.
    """
    if not shown or sys.stderr is None:
        yield lambda _done: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task(what, total=total)
            yield lambda done: bar.update(task, completed=done)
    else:
        tenths = [0]

        def advance(done: int) -> None:
            if done * 10 // max(1, total) > tenths[0]:
                tenths[0] = done * 10 // max(1, total)
                say(f"{what}: {100 * done // max(1, total)} %")

        yield advance


@contextmanager
def patience(text: str, *, after: float = 4.0) -> Iterator[None]:
    """Print ``text`` on stderr if the ``with`` block takes longer than ``after`` seconds."""
    timer = Timer(after, say, [text])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def warnings_said(category: type[Warning]) -> Iterator[None]:
    """Print Python warnings of one category as plain sentences on stderr while the ``with`` block
    runs.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", category)
        warnings.showwarning = lambda message, *_others, **_more: say(f"shoal: warning: {message}")
        yield


def report_moves(what: str, *, every: float = 2.0) -> Callable[[int, int], None]:
    """Return a function that prints the progress of a long episode on stderr: the number of moves
    and of frontier cells.
    """
    last = [time.monotonic()]

    def tell(moves: int, frontier: int) -> None:
        if time.monotonic() - last[0] > every:
            last[0] = time.monotonic()
            say(f"{what}: {moves} moves, {frontier} frontier cells left")

    return tell


def duration_text(seconds: float) -> str:
    """Return an approximate duration as text, in the largest fitting unit.

    Examples
    --------
    >>> duration_text(42), duration_text(400), duration_text(9000)
    ('42 s', '7 min', '2.5 h')
    """
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def check_folder(folder: Path) -> Path:
    """Check, without creating anything, that Shoal can write into an output folder or create it."""
    existing = folder
    try:
        while not existing.exists() and existing != existing.parent:
            existing = existing.parent
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise OutputError(
            f"cannot write into the folder {folder}: {error.strerror or error}"
        ) from None
    return folder


def check_outputs(out: Path | None, film: list[Path] | None) -> None:
    """Raise an error if Shoal cannot write the requested output folder or films.

    Raises
    ------
    InvalidInputError
        If the suffix of a film is not supported.
    OutputError
    """
    if film:
        from shoal.views.drawing.encoding import check_film

        for path in film:
            check_folder(check_film(path).parent)
    if out is not None:
        check_folder(out)


def import_matplotlib() -> None:
    """Import what draws figures, without the help texts that Matplotlib writes for its classes
    meanwhile: no command reads them, and they take as long as the rest of the import.
    """
    if "matplotlib.figure" in sys.modules:
        return
    from matplotlib import artist

    # Private names: without them, the import only takes longer.
    own, kwdoc = vars(artist.Artist).get("_update_set_signature_and_docstring"), artist.kwdoc
    if own is not None:
        artist.Artist._update_set_signature_and_docstring = classmethod(lambda _: None)  # type: ignore[attr-defined]
    artist.kwdoc = lambda artist: ""
    try:
        import matplotlib.backends.backend_agg
        import matplotlib.figure  # noqa: F401
    finally:
        artist.kwdoc = kwdoc
        if own is not None:
            artist.Artist._update_set_signature_and_docstring = own  # type: ignore[attr-defined]


FIGURES: dict[str, dict[str, str | None]] = {
    "steering": {"plan.png": None},
    "search": {"region.png": None, "timeline.png": "timeline"},
}
"""The figures of a steering or search episode: the name of each file, and the kind of its figure
(see `shoal.views.figure`).
"""

SHORT_FILM = 200  # frames; the progress of shorter films is not shown


def write_films(
    episode: Any, paths: list[Path] | None, *, size: str | None = None, rate: int | None = None
) -> list[Path]:
    """Write the films of an episode with progress bars, and return the paths of the films. The
    options are those of `shoal.views.film`.
    """
    for path in paths or []:
        _write_film(episode, path, size, rate)
    return [*(paths or [])]


def write_episode(
    episode: Any, result: dict[str, Any], out: Path | None, film: list[Path] | None
) -> list[Path]:
    """Write the output files that --out and --film request for an episode of steering or search,
    and return their paths.
    """
    written: list[Path] = []
    if out is not None:
        import_matplotlib()
        from shoal.core.files import write_json
        from shoal.views import figure, save_figure

        figures = dict(FIGURES[episode.part])
        if episode.part == "search" and episode.problem.prior:
            figures["success.png"] = "success"
        for name, kind in figures.items():
            save_figure(figure(episode, kind=kind), out / name)
        episode.save(out / "episode.json")
        write_json(out / "summary.json", result)
        names = [*figures, "episode.json", "summary.json"]
        if episode.part == "search":
            episode.save_visits(out / "visits.csv")
            names.append("visits.csv")
        written += [out / name for name in names]
    return written + write_films(episode, film)


def _write_film(episode: Any, path: Path, size: str | None, rate: int | None) -> None:
    from shoal.views import film

    # length of the bar, because the number of frames is known only when the film is being written
    frames = 1000
    with progress(f"film {path.name}", frames, shown=path.suffix.lower() != ".html") as advance:
        film(
            episode,
            path,
            size=size,
            rate=rate,
            on_frame=lambda done, total: (
                advance(frames * done // total) if total > SHORT_FILM else None
            ),
        )


def check_seed(episode_file: Path, wanted: int | None, found: int | None) -> None:
    """Raise an error if the seed of an episode is not the requested seed."""
    if wanted is not None and wanted != found:
        raise InvalidInputError(
            f"{episode_file}: expected an episode of seed {wanted}, got seed {found}"
        )
