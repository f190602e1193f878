"""The studio's web application, which serves pages, files, answers and jobs, and sends events over a websocket."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from shoal.core.checks import check_choice
from shoal.core.errors import InvalidInputError, OutputError, ShoalError
from shoal.core.parts import PARTS, problem_type
from shoal.core.problem import Problem
from shoal.core.version import __version__
from shoal.studio.folder import Folder
from shoal.studio.jobs.queue import JobQueue
from shoal.studio.preview import Preview

WAITING = 1000
"""Maximum number of messages that may wait for a slow browser.

If more messages are waiting, the studio closes the websocket, and the browser connects again.
"""

_TYPES = {".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".svg": "image/svg+xml"}
_STATIC = {"static": resources.files("shoal.studio") / "static", "player": resources.files("shoal.views.player")}


class Studio:
    """The web application of the studio for one folder.

    Parameters
    ----------
    root : path
    """

    def __init__(self, root: Path) -> None:
        self.folder = Folder(root)
        self._listeners: set[asyncio.Queue[dict[str, Any]]] = set()
        self.queue = JobQueue(self.folder, self.tell)
        self.previews = {False: Preview(str(self.folder.root)), True: Preview(str(self.folder.root))}  # quick, and slow

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message to all connected browsers."""
        for listener in list(self._listeners):
            if listener.qsize() > WAITING:
                self._listeners.discard(listener)
                listener.put_nowait({"lost": True})
            else:
                listener.put_nowait(message)

    async def close(self) -> None:
        """Stop all jobs and all processes of the studio."""
        for listener in self._listeners:
            listener.put_nowait({"lost": True})
        await asyncio.gather(*(preview.close() for preview in self.previews.values()), self.queue.close())

    # ---- requests ----

    async def page(self, request: Request) -> Response:
        """Return the HTML page of the studio."""
        return _static("static/index.html")

    async def static(self, request: Request) -> Response:
        """Return a script or a style sheet of the studio or of the player."""
        return _static(request.url.path.lstrip("/"))

    async def player(self, request: Request) -> Response:
        """Return the HTML page of a player, without an episode."""
        from shoal.views.player import served_page

        part = check_choice(request.path_params["part"], what="part", choices=PARTS)
        asked = request.query_params
        more = ("/static/frame.css", *(["/player/swarm/race.js"] if part == "swarm" else []))
        page = served_page(part, volume="volume" in asked, recorded="recorded" in asked, more=more, files="/player/")
        return Response(page, media_type="text/html")

    async def start(self, request: Request) -> Response:
        """Return the initial data of the studio's page."""
        told = {"folder": self.folder.root.name, "version": __version__, "jobs": self.queue.all_told()}
        return JSONResponse(told | await asyncio.shield(self.forms) | {"files": await asyncio.to_thread(self.folder.files)})

    @cached_property
    def forms(self) -> asyncio.Future[dict[str, Any]]:
        """Return the declarations of fields, from which pages make their forms.

        The server computes the declarations of fields during its start, while the browser is starting.
        """
        return asyncio.ensure_future(asyncio.to_thread(self._forms))

    def _forms(self) -> dict[str, Any]:
        from shoal.search.flight.vehicle import PRESETS, Vehicle
        from shoal.search.problem.mission_options import MissionOptions
        from shoal.studio.forms import schema_of
        from shoal.swarm.maps.generators import GENERATORS

        made = (GENERATORS.get(name) for name in GENERATORS)
        maps = [{"name": one.name, "summary": one.summary, "example": one.example, "size": one.size} for one in made]
        kinds: list[type[Problem]] = [*map(problem_type, PARTS), Vehicle, MissionOptions]
        schemas = {kind.part: schema_of(kind) for kind in kinds}
        schemas["vehicle"]["presets"] = PRESETS
        return {"schemas": schemas, "maps": maps}

    async def files(self, request: Request) -> Response:
        """Return the list of files in the studio's folder."""
        return JSONResponse(await asyncio.to_thread(self.folder.files))

    async def file(self, request: Request) -> Response:
        """Return one file for download or display. A header forbids the browser to run the file as a page of the studio."""
        path = self.folder.path(request.path_params["name"])
        if not path.is_file():
            raise InvalidInputError("file: expected a file of the folder, got no such file")
        return FileResponse(path, filename=path.name, headers={"content-security-policy": "sandbox; default-src 'none'"})

    async def take(self, request: Request) -> Response:
        """Store an uploaded file in the studio's folder."""
        name = await self.folder.take(request.path_params["name"], request.stream())
        self.tell({"files": True})
        return JSONResponse({"file": name})

    async def ask(self, request: Request) -> Response:
        """Answer a question of a page."""
        what, about = request.path_params["what"], await _json(request)
        answer = await self.previews[about.get("slow") is True].ask(what, about)
        if what in ("sketch", "save", "draw"):
            self.tell({"files": True})
        return JSONResponse(answer)

    async def jobs(self, request: Request) -> Response:
        """Return the newest jobs, and the number of jobs in each state."""
        return JSONResponse({"jobs": self.queue.all_told(), "counts": self.queue.store.counts()})

    async def add_job(self, request: Request) -> Response:
        """Add a job to the queue."""
        given = await _json(request)
        spec = given.get("spec")
        if not isinstance(spec, dict):
            raise InvalidInputError("spec: expected an object")
        return JSONResponse(self.queue.add(given.get("kind"), spec, urgent=given.get("urgent") is True))

    async def cancel_job(self, request: Request) -> Response:
        """Cancel the job whose number the request contains."""
        self.queue.cancel(int(request.path_params["number"]))
        return JSONResponse({})

    async def live(self, socket: WebSocket) -> None:
        """Send a browser the events of jobs and files, and the pieces of all episodes that the browser watches."""
        await socket.accept()
        listener: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        watched: set[int] = set()
        self._listeners.add(listener)

        async def send() -> None:
            while True:
                message = await listener.get()
                if "of" not in message or message["of"] in watched:
                    await socket.send_text(json.dumps(message, allow_nan=False))
                if "lost" in message:
                    await socket.close()
                    return

        sending = asyncio.create_task(send())
        try:
            while True:
                given = json.loads(await socket.receive_text())
                if isinstance(given, dict) and isinstance(number := given.get("watch"), int):
                    watched.add(number)
                    # The earlier pieces, and the job's current state. No other message is sent between these lines.
                    for piece in self.queue.pieces(number):
                        listener.put_nowait({"piece": piece, "of": number})
                    listener.put_nowait({"job": self.queue.told(number)})
        except (WebSocketDisconnect, ValueError, RuntimeError):
            pass
        finally:
            self._listeners.discard(listener)
            sending.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending


async def _json(request: Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request."""
    if request.headers.get("content-type") != "application/json":
        raise InvalidInputError("expected JSON")
    try:
        given = json.loads(await request.body())
    except (ValueError, RecursionError):
        raise InvalidInputError("expected JSON") from None
    if not isinstance(given, dict):
        raise InvalidInputError("expected a JSON object")
    return given


def _static(name: str) -> Response:
    room, _, rest = name.partition("/")
    parts = rest.split("/")
    kind = _TYPES.get(Path(rest).suffix)
    if kind is None or any(part.startswith(".") or not part for part in parts):
        return PlainTextResponse("expected a file of the studio", 404)
    file = _STATIC[room].joinpath(*parts)
    if not file.is_file():
        return PlainTextResponse("expected a file of the studio", 404)
    return Response(file.read_bytes(), media_type=kind)


def _refused(handler: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """Return a request handler that answers an error with one sentence."""

    async def handled(request: Request) -> Response:
        try:
            return await handler(request)
        except ClientDisconnect:
            return PlainTextResponse("", 400)
        except OutputError as error:
            return PlainTextResponse(str(error), 507)
        except ShoalError as error:
            return PlainTextResponse(str(error), 422)

    return handled


def application_of(studio: Studio) -> Starlette:
    """Return the ASGI application of a studio. `shoal.studio.guard.Guard` must protect the application from the network."""

    @asynccontextmanager
    async def life(_app: Starlette) -> AsyncIterator[None]:
        async def begin() -> None:
            await studio.forms
            studio.queue.go_on()

        beginning = asyncio.create_task(begin())
        yield
        await beginning
        await studio.close()

    answers = (
        ("GET", "/", studio.page), ("GET", "/static/{name:path}", studio.static), ("GET", "/player/{name:path}", studio.static),
        ("GET", "/play/{part}", studio.player), ("GET", "/api/start", studio.start), ("GET", "/api/files", studio.files),
        ("PUT", "/api/files/{name:path}", studio.take), ("GET", "/files/{name:path}", studio.file),
        ("POST", "/api/ask/{what}", studio.ask), ("GET", "/api/jobs", studio.jobs), ("POST", "/api/jobs", studio.add_job),
        ("DELETE", "/api/jobs/{number:int}", studio.cancel_job),
    )  # fmt: skip
    routes = [Route(path, _refused(handler), methods=[method]) for method, path, handler in answers]
    return Starlette(routes=[*routes, WebSocketRoute("/live", studio.live)], lifespan=life)
