"""shoal studio: the graphical user interface of Shoal in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from shoal.cli.output import say
from shoal.core.checks import check_integer
from shoal.core.errors import MissingExtraError

EXAMPLE = "Example: shoal studio figures"


def studio(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder for all files of the studio.")
    ] = Path(),
    port: Annotated[
        int | None,
        typer.Option(
            "--port",
            help="Port of the studio's server. Default: 8790, or a free port if 8790 is in use.",
        ),
    ] = None,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the studio in a browser.")
    ] = True,
) -> None:
    """Open the studio (Shoal's browser interface) to find vessels, place particles, compare
    policies and steer by hand.

    The studio's server refuses connections from other machines. The address of the studio contains
    a secret. All data of the studio stays in one folder.
    """
    if port is not None:
        check_integer(port, what="port", least=1, most=65535)
    from shoal.studio.jobs import warm_up

    warm_up("shoal.studio.server")  # at the same time as the following, because its end is awaited
    try:
        from shoal.studio.server import serve
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in (
            "starlette",
            "uvicorn",
            "websockets",
            "h11",
        ):
            raise
        raise MissingExtraError(
            "expected Starlette and uvicorn for the studio: run pip install 'shoal[studio]'"
        ) from None
    serve(folder, port=port, browser=browser, say=say)
