"""The studio's web application, which serves pages, files, answers and jobs, and sends events over
a websocket.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, MutableMapping
from contextlib import asynccontextmanager, suppress
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from shoal.core.checks import check_bool, check_choice, shortened
from shoal.core.errors import InvalidInputError, OutputError, ShoalError
from shoal.core.problem import Problem
from shoal.core.version import __version__
from shoal.parts import PARTS, problem_type
from shoal.studio.answers import QUESTIONS
from shoal.studio.bundle import bundled, script_of, sources_of
from shoal.studio.folder import KINDS as FILE_KINDS
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, checked_seed
from shoal.studio.jobs import JobQueue
from shoal.studio.processes import Preview, StudioError
from shoal.studio.requests import MAYBE_BOOL, check_request, read_json
from shoal.studio.tiles import tile
from shoal.studio.words import LONGEST, FieldError, fault_of
from shoal.studio.work import JOBS

WAITING = 1000
"""Maximum number of messages that may wait for a slow browser.

If more messages are waiting, the studio closes the websocket, and the browser connects again.
"""

_TYPES = {
    ".js": "text/javascript",
    ".css": "text/css",
    ".html": "text/html",
    ".svg": "image/svg+xml",
    ".png": "image/png",
}
_STATIC = {
    "static": resources.files("shoal.studio") / "static",
    "player": resources.files("shoal.views.player"),
}


class JSONResponse(Response):
    """An answer as JSON in ASCII characters: names in a stranger's file may contain half of a pair of
    surrogates, which UTF-8 cannot hold.
    """

    media_type = "application/json"

    def render(self, content: Any) -> bytes:
        """Return the text of the answer."""
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode("ascii")


class _FolderFile(FileResponse):
    """A file of the folder, which somebody may delete before it is sent."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the head of the answer only with its first bytes, when the file is open."""
        head: list[Message] = []
        begun = False

        async def send_opened(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                head.append(message)
                return
            begun = True
            while head:
                await send(head.pop())
            await send(message)

        try:
            await super().__call__(scope, receive, send_opened)
        except (OSError, RuntimeError):  # the latter from Starlette, for a file that is gone
            if begun:
                raise
            await _missing(Path(self.path))(scope, receive, send)


class _Listener:
    """A connected browser: the messages that wait for it, and the jobs that it watches."""

    def __init__(self) -> None:
        self.messages: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.watched: set[int] = set()

    def hear(self, message: dict[str, Any]) -> None:
        """Take a message, unless it is of a job that the browser does not watch yet: it gets the
        pieces so far when it begins to watch.
        """
        if "of" not in message or message["of"] in self.watched:
            self.messages.put_nowait(message)


class Studio:
    """The web application of the studio for one folder.

    Parameters
    ----------
    root : path
    """

    def __init__(self, root: Path) -> None:
        self.folder = Folder(root)
        self._listeners: set[_Listener] = set()
        self.queue = JobQueue(self.folder, self.tell)
        # quick, and slow
        self.previews = {
            False: Preview(str(self.folder.root)),
            True: Preview(str(self.folder.root)),
        }

    def tell(self, message: dict[str, Any]) -> None:
        """Send a message to all connected browsers."""
        for listener in list(self._listeners):
            if listener.messages.qsize() > WAITING:
                self._listeners.discard(listener)
                listener.hear({"lost": True})
            else:
                listener.hear(message)

    async def close(self) -> None:
        """Stop all jobs and all processes of the studio."""
        for listener in self._listeners:
            listener.hear({"lost": True})
        await asyncio.gather(
            *(preview.close() for preview in self.previews.values()), self.queue.close()
        )

    # ---- requests ----

    async def page(self, request: Request) -> Response:
        """Return the HTML page of the studio."""
        page = bundled(_text("static/index.html"), sheet="/studio.css", script="/studio.js")
        return Response(page, media_type="text/html")

    async def sheet(self, request: Request) -> Response:
        """Return all style sheets of the studio's page as one."""
        sheets, _ = sources_of(_text("static/index.html"))
        return Response("".join(map(_text, sheets)), media_type="text/css")

    async def script(self, request: Request) -> Response:
        """Return all modules of the studio's page as one."""
        script = script_of("main.js", lambda name: _text(f"static/{name}"))
        return Response(script, media_type="text/javascript")

    async def static(self, request: Request) -> Response:
        """Return a script or a style sheet of the studio or of the player."""
        return _static(request.url.path.lstrip("/"))

    async def player(self, request: Request) -> Response:
        """Return the HTML page of a player, without an episode, or all its scripts or style sheets
        as one.
        """
        from shoal.views.player import served_page

        part = check_choice(request.path_params["part"], what="part", choices=PARTS)
        asked = request.query_params
        more = ("/static/frame.css", *(["/player/swarm/race.js"] if part == "swarm" else []))
        for name in ("volume", "recorded"):
            if name in asked and part != "swarm":
                raise InvalidInputError(f"{name}: expected the part swarm with it, got {part}")
        page = served_page(
            part,
            volume="volume" in asked,
            recorded="recorded" in asked,
            more=more,
            files="/player/",
        )
        sheets, scripts = sources_of(page)
        what = request.path_params.get("what")
        if what is not None:
            kind = check_choice(what, what="file", choices=("sheet.css", "script.js"))
            sources = sheets if kind == "sheet.css" else scripts
            return Response("".join(map(_text, sources)), media_type=_TYPES[Path(kind).suffix])
        kinds = "&".join(name for name in ("volume", "recorded") if name in asked)
        sheet, script = (f"/play/{part}/{one}?{kinds}" for one in ("sheet.css", "script.js"))
        page = bundled(page, sheet=sheet, script=script)
        return Response(page, media_type="text/html")

    async def start(self, request: Request) -> Response:
        """Return the initial data of the studio's page."""
        initial = {
            "folder": self.folder.root.name,
            "version": __version__,
            "jobs": self.queue.list_jobs(),
        }
        return JSONResponse(
            initial
            | await asyncio.shield(self.forms)
            | await asyncio.to_thread(self.folder.list_files)
        )

    @cached_property
    def forms(self) -> asyncio.Future[dict[str, Any]]:
        """Return the declarations of fields, from which pages make their forms.

        The server computes the declarations of fields during its start, while the browser is
        starting.
        """
        return asyncio.ensure_future(asyncio.to_thread(self._forms))

    def _forms(self) -> dict[str, Any]:
        from shoal.missions.options import MissionOptions
        from shoal.search.flight.vehicle import PRESETS, Vehicle
        from shoal.studio.forms import schema_of
        from shoal.swarm.maps.generators import GENERATORS
        from shoal.swarm.problem import READING

        made = (GENERATORS.get(name) for name in GENERATORS)
        maps = [
            {"name": one.name, "summary": one.summary, "example": one.example, "size": one.size}
            for one in made
        ]
        kinds: list[type[Problem]] = [*map(problem_type, PARTS), Vehicle, MissionOptions]
        schemas = {kind.part: schema_of(kind) for kind in kinds}
        schemas["vehicle"]["presets"] = PRESETS
        schemas["swarm"]["reading"] = [*READING, "largest_component"]
        return {"schemas": schemas, "maps": maps}

    async def files(self, request: Request) -> Response:
        """Return the newest files of the folder, and their number; with ``kind``, ``skip`` and
        ``name``, one page of the others.
        """
        asked = request.query_params
        skip = asked.get("skip", "0")
        if not (skip.isascii() and skip.isdecimal() and len(skip) < 10):
            raise InvalidInputError(
                f"skip: expected a whole number, 0 or more, got {shortened(skip)}"
            )
        kind = (
            check_choice(asked["kind"], what="kind", choices=FILE_KINDS)
            if "kind" in asked
            else None
        )
        found = self.folder.list_files(kind, after=int(skip), name=asked.get("name", ""))
        return JSONResponse(found)

    async def file(self, request: Request) -> Response:
        """Return one file for download or display. A header forbids the browser to run the file as
        a page of the studio.
        """
        path = self.folder.path(request.path_params["name"])
        try:
            found = path.is_file()
        except OSError:  # a name that no file can have
            found = False
        if not found:
            return _missing(path)
        return _FolderFile(
            path,
            filename=path.name,
            headers={"content-security-policy": "sandbox; default-src 'none'"},
        )

    async def tile(self, request: Request) -> Response:
        """Return a map tile of a folder of tiles, or of a PMTiles file."""
        given = request.path_params
        place = given["zoom"], given["column"], given["row"]
        data, kind = await asyncio.to_thread(tile, self.folder, given["name"], *place)
        return Response(data, media_type=kind)

    async def take(self, request: Request) -> Response:
        """Store an uploaded file in the studio's folder."""
        name = await self.folder.take(request.path_params["name"], request.stream())
        self.tell({"files": True})
        return JSONResponse({"file": name})

    async def ask(self, request: Request) -> Response:
        """Answer a question of a page."""
        what, about = request.path_params["what"], await _json(request)
        what = check_choice(what, what="question", choices=QUESTIONS)
        check_request(about, QUESTIONS[what].fields | {"slow": MAYBE_BOOL})
        answer = await self.previews[about.pop("slow", None) is True].ask(what, about)
        if what in ("sketch", "save", "draw", "example"):
            self.tell({"files": True})
        return JSONResponse(answer)

    async def jobs(self, request: Request) -> Response:
        """Return the newest jobs, and the number of jobs in each state."""
        return JSONResponse({"jobs": self.queue.list_jobs(), "counts": self.queue.store.counts()})

    async def add_job(self, request: Request) -> Response:
        """Add a job to the queue. A job that could not begin is refused: a field that is missing or
        has a wrong value.
        """
        given = await _json(request)
        kind, spec = check_choice(given.get("kind"), what="kind", choices=JOBS), given.get("spec")
        if not isinstance(spec, dict):
            raise InvalidInputError(f"spec: expected an object, got {shortened(spec)}")
        check_request(spec, JOBS[kind].fields)
        checked_seed(spec)
        if "problem" in spec:
            try:
                await asyncio.to_thread(
                    checked_problem, spec["problem"], self.folder, part=JOBS[kind].part
                )
            except ShoalError as error:
                raise FieldError(fault_of(error, spec)) from None
        return JSONResponse(
            self.queue.add(kind, spec, urgent=check_bool(given.get("urgent", False), what="urgent"))
        )

    async def cancel_job(self, request: Request) -> Response:
        """Cancel the job whose number the request contains."""
        text = request.path_params["number"]
        if not (text.isascii() and text.isdecimal() and len(text) < 19) or not self.queue.describe(
            int(text)
        ):
            raise InvalidInputError(f"job: expected the number of a job, got {shortened(text)}")
        self.queue.cancel(int(text))
        return JSONResponse({})

    async def live(self, socket: WebSocket) -> None:
        """Send a browser the events of jobs and files, and the pieces of all episodes that the
        browser watches.
        """
        await socket.accept()
        listener = _Listener()
        self._listeners.add(listener)

        async def send() -> None:
            while True:
                message = await listener.messages.get()
                await socket.send_text(json.dumps(message, allow_nan=False))
                if "lost" in message:
                    await socket.close()
                    return

        sending = asyncio.create_task(send())
        try:
            while True:
                number = _watched(await socket.receive())
                if number is not None and number not in listener.watched:
                    listener.watched.add(number)
                    # The earlier pieces, and then the job's current state, with which a browser
                    # has them all. No other message comes between these lines.
                    for nth, piece in enumerate(self.queue.pieces(number)):
                        listener.hear({"piece": piece, "nth": nth, "of": number})
                    listener.hear({"job": self.queue.describe(number), "of": number})
        except WebSocketDisconnect:
            pass
        except ShoalError:
            with suppress(RuntimeError):
                await socket.close(1003, "expected the number of a job to watch")
        finally:
            self._listeners.discard(listener)
            sending.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending


def _watched(message: MutableMapping[str, Any]) -> int | None:
    """Return the number of the job that a browser wants to watch.

    Raises
    ------
    WebSocketDisconnect
    InvalidInputError
        Raised for any other message.
    """
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1000))
    given = read_json((message.get("text") or "").encode("utf-8", "surrogatepass"))
    number = given.get("watch")
    if (
        given.keys() != {"watch"}
        or not isinstance(number, int)
        or isinstance(number, bool)
        or abs(number) >= 2**63
    ):
        raise InvalidInputError(f"watch: expected the number of a job, got {shortened(given)}")
    return number


async def _json(request: Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        raise InvalidInputError(f"content-type: expected application/json, got {shortened(kind)}")
    return read_json(await request.body())


def _text(address: str) -> str:
    room, _, rest = address.lstrip("/").partition("/")
    return _STATIC[room].joinpath(rest).read_text(encoding="utf-8")


def _static(name: str) -> Response:
    room, _, rest = name.partition("/")
    parts = rest.split("/")
    kind = _TYPES.get(Path(rest).suffix)
    if (
        kind is not None
        and len(rest) < 200
        and all(part and not part.startswith(".") and "\0" not in part for part in parts)
    ):
        file = _STATIC[room].joinpath(*parts)
        if file.is_file():
            return Response(file.read_bytes(), media_type=kind)
    return _error(404, f"expected a file of the studio, got {shortened(rest)}")


def _error(status: int, sentence: str) -> Response:
    """Return an answer that is one sentence about what is wrong: one line, also if a name in it has
    several.
    """
    return JSONResponse({"error": " ".join(sentence.split())[:LONGEST]}, status)


def _missing(path: Path) -> Response:
    """Return the answer for a file that the folder has not, or not any more."""
    return _error(
        404, f"file: expected a file of the folder, got no such file: {shortened(path.name)}"
    )


def _refused(
    handler: Callable[[Request], Awaitable[Response]],
) -> Callable[[Request], Awaitable[Response]]:
    """Return a request handler that answers an error with one sentence."""

    async def handled(request: Request) -> Response:
        try:
            return await handler(request)
        except ClientDisconnect:
            return Response(status_code=400)
        except FieldError as error:
            return JSONResponse(error.fault, 422)
        except OutputError as error:
            return _error(507, str(error))
        except ShoalError as error:
            return _error(422, str(error))
        except StudioError as error:
            return _error(500, str(error))

    return handled


async def _unknown(request: Request, error: Exception) -> Response:
    """Answer a request for an address or a method that the studio does not have."""
    assert isinstance(error, HTTPException)
    what = f"{request.method} {shortened(request.url.path)}"
    return JSONResponse(
        {"error": f"expected an address of the studio, got {what}"},
        error.status_code,
        headers=dict(error.headers or {}),
    )


def application_of(studio: Studio) -> Starlette:
    """Return the ASGI application of a studio. `shoal.studio.guard.Guard` must protect the
    application from the network.
    """

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
        ("GET", "/", studio.page),
        ("GET", "/studio.css", studio.sheet),
        ("GET", "/studio.js", studio.script),
        ("GET", "/static/{name:path}", studio.static),
        ("GET", "/player/{name:path}", studio.static),
        ("GET", "/play/{part}", studio.player),
        ("GET", "/play/{part}/{what}", studio.player),
        ("GET", "/api/start", studio.start),
        ("GET", "/api/files", studio.files),
        ("PUT", "/api/files/{name:path}", studio.take),
        ("GET", "/files/{name:path}", studio.file),
        ("GET", "/tiles/{zoom:int}/{column:int}/{row:int}/{name:path}", studio.tile),
        ("POST", "/api/ask/{what}", studio.ask),
        ("GET", "/api/jobs", studio.jobs),
        ("POST", "/api/jobs", studio.add_job),
        ("DELETE", "/api/jobs/{number}", studio.cancel_job),
    )
    routes = [Route(path, _refused(handler), methods=[method]) for method, path, handler in answers]
    return Starlette(
        routes=[*routes, WebSocketRoute("/live", studio.live)],
        lifespan=life,
        exception_handlers={HTTPException: _unknown},
    )
