"""What a request must not say: on every route, each bad body gets one sentence with a status of the
client, and no traceback.
"""

from __future__ import annotations

import asyncio
import json
import re
import socket
from contextlib import closing

import pytest
from PIL import Image, ImageDraw
from starlette.responses import FileResponse
from tests.unit.studio.test_guard import Served

import shoal
from shoal.core.errors import ShoalError
from shoal.parts import problem_type
from shoal.robots.tasks import write_task
from shoal.search import SearchProblem
from shoal.search.run import run
from shoal.studio import guard as guard_module
from shoal.studio.answers import QUESTIONS, answer
from shoal.studio.application import Studio, application_of
from shoal.studio.processes import StudioError
from shoal.studio.work import JOBS
from shoal.swarm import SwarmProblem


def free_port():
    """Return a port of the loopback interface that is free at the moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


SWARM = {"kind": "swarm", "map": "line:9", "particles": 2}
STEERING = {
    "kind": "steering",
    "workspace": "square",
    "start": [[0.2, 0.3], [0.5, 0.35]],
    "goal": [[0.8, 0.2], [0.3, 0.75]],
}
SEARCH = {"kind": "search", "region": "square:40", "robots": 2, "footprint": "20"}
DRAWING = {"frame": None, "parts": [[[0, 0], [30, 0], [30, 30]]], "zones": []}
CELLS = {"shape": [1, 8], "free": "/w=="}
TOML = (
    'name = "s"\ntrials = 2\n[problem]\nkind = "line"\ncells = 9\nparticles = 2\nplacements = 2\n'
)
PLACED = {"problem": SEARCH, "drawing": DRAWING, "frame": [8.5, 47.4], "seed": 1}
GOOD = {
    "page": {"file": "a.npz"},
    "settings": {"file": "a.npz"},
    "picture": {"file": "a.npz"},
    "copies": {"problem": SWARM, "seed": 1},
    "save": {"problem": SWARM, "seed": 1, "name": "x"},
    "map": {"problem": SWARM, "cells": CELLS, "seed": 1},
    "photograph": {"file": "a.png"},
    "vessels": {"problem": SWARM | {"map": "a.png", "vessels": True}, "exact": False},
    "sketch": CELLS | {"name": "x", "over": "x-painted.png"},
    "steer": {"problem": STEERING | {"planner": "greedy"}, "seed": 1},
    "workspace": {"problem": STEERING, "seed": 1},
    "reach": {"problem": STEERING, "moves": 2, "seed": 1},
    "plan": PLACED | {"missions": {}},
    "simulate": {k: PLACED[k] for k in ("problem", "drawing", "seed")} | {"missions": {}},
    "outlines": {k: PLACED[k] for k in ("problem", "drawing", "frame")},
    "draw": {"problem": SEARCH, "drawing": DRAWING},
    "earth": {"frame": [8.5, 47.4]},
    "tiles": {"file": "town"},
    "watch": {
        "task": "task.json",
        "radio": f"udp:127.0.0.1:{free_port()},127.0.0.1:9",
        "places": True,
    },
    "example": {"name": "race"},
    "open": {"file": "a.npz"},
    "papers": {},
    "lab-forms": {},
    "sweeps": {},
    "sweep": {"store": "a.sqlite", "sweep": "s", "measure": "moves"},
    "new-sweep": {"toml": TOML},
}
"""A request for each question; the files that some of them name are made by the fixture."""

GOOD_JOBS = {
    "play": {"problem": SWARM, "seed": 1},
    "compare": {"problem": SWARM, "policies": ["best", "closest-frontier"], "trials": 2},
    "export": {"episode": "a.npz", "format": "png", "width": 60, "font_size": 7, "at": 1},
    "reproduce": {"name": "m-theorem1", "quick": True},
    "sweep": {"toml": TOML, "store": "s.sqlite", "sweep": "s"},
    "table": {"store": "a.sqlite", "measure": "moves", "format": "png"},
    "missions": {"problem": SEARCH, "missions": {}, "seed": 1},
}

DEEP = "[" * 60 + "]" * 60
BAD = [
    "NaN",
    "-Infinity",
    "1e999",
    "9" * 401,
    DEEP,
    '"\\ud800"',
    "-1",
    "1.5",
    '"x"',
    "[]",
    "{}",
    "[null]",
    "null",
    "true",
    '{"kind": []}',
    "[1e300, 1e300]",
]
"""Values in place of each field, as they are written in JSON."""

NEVER = [
    "",
    "{",
    "[]",
    "null",
    "NaN",
    '"x"',
    "\xff",
    DEEP,
    '{"a": 1, "a": 2}',
    '{"a": NaN}',
    '{"a": 1e999}',
    "[" * 100_000,
]
"""Bodies that no question has."""


class Answered:
    """In place of a process for quick answers: the same code in this process."""

    def __init__(self, folder):
        self.folder = folder

    async def ask(self, what, about):
        word, value = answer(self.folder, what, about)
        if word == "error":
            raise ShoalError(value)
        if word == "broken":
            raise StudioError(value)
        return value

    async def close(self):
        pass


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    folder = tmp_path_factory.mktemp("folder")
    shoal.run(SwarmProblem("line:9", particles=2), seed=1).save(folder / "a.npz")
    picture = Image.new("L", (60, 40), 200)
    ImageDraw.Draw(picture).line([(5, 20), (55, 22)], fill=70, width=5)
    picture.save(folder / "a.png")
    (folder / "town/14/8578").mkdir(parents=True)
    picture.save(folder / "town/14/8578/5736.png")
    (folder / "a.sqlite").write_bytes(b"no store")
    write_task(run(SearchProblem("square:40", robots=2, footprint=20), seed=1), folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        made = Studio(folder)
        made.previews = dict.fromkeys((False, True), Answered(made.folder))
        patch.setattr(made.queue, "go_on", lambda: None)  # jobs are accepted, and not begun
        yield made
        made.queue.store.close()
        answer(made.folder, "watch", GOOD["watch"] | {"ends": True})


def ask(studio, method, path, body=b"", kind=b"application/json", query=b""):
    """Return the status and the body of the studio's answer, without a server."""
    told = {"status": 0, "body": b""}
    bodies = iter([body])

    async def receive():
        for one in bodies:
            return {"type": "http.request", "body": one}
        return await asyncio.Event().wait()  # nobody hangs up

    async def send(message):
        told["status"] = message.get("status", told["status"])
        told["body"] += message.get("body", b"")

    headers = [(b"host", b"x"), *([(b"content-type", kind)] if kind else [])]
    scope = {
        "type": "http",
        "method": method,
        "path": path,
        "query_string": query,
        "headers": headers,
        "http_version": "1.1",
    }
    asyncio.run(application_of(studio)(scope, receive, send))
    return told["status"], told["body"]


def refused(answered, what):
    """Assert that an answer is one sentence of the kind "expected ..., got ...", with a status of
    the client.
    """
    status, body = answered
    assert 400 <= status < 500, (what, status, body[:300])
    sentence = json.loads(body)["error"]
    assert sentence == " ".join(sentence.split())
    assert 5 < len(sentence) < 600
    assert not re.search(
        r"\w+(Error|Exception)\b|Traceback|NoneType|'(int|str|list|dict|float)'", sentence
    ), (what, sentence)
    return sentence


def changed(good, name, value):
    """The JSON of a request with another value for a field, which may be inside another one."""
    first, _, rest = name.partition(".")
    inside = {**good[first], rest: "@"} if rest else "@"
    return json.dumps({**good, first: inside}).replace('"@"', value)


def fields_of(good):
    for name, value in good.items():
        yield name
        if isinstance(value, dict):
            yield from (f"{name}.{inner}" for inner in value)


def test_every_question_and_job_is_in_the_tables():
    assert QUESTIONS.keys() == GOOD.keys()
    assert JOBS.keys() == GOOD_JOBS.keys()


@pytest.mark.parametrize("what", GOOD)
def test_no_question_takes_what_it_cannot_use(studio, what):
    path, good = f"/api/ask/{what}", GOOD[what]
    if what != "sweep":
        assert ask(studio, "POST", path, json.dumps(good).encode())[0] == 200
    for name in fields_of(good):
        for value in BAD:
            answered = ask(
                studio, "POST", path, changed(good, name, value).encode("utf-8", "surrogatepass")
            )
            if answered[0] != 200:
                refused(answered, (what, name, value))
    for name in [name for name, field in QUESTIONS[what].fields.items() if field.required]:
        body = json.dumps({key: value for key, value in good.items() if key != name}).encode()
        assert refused(ask(studio, "POST", path, body), name).startswith(f"{name}: expected")
    assert "'typo'" in refused(
        ask(studio, "POST", path, json.dumps(good | {"typo": 1}).encode()), what
    )


@pytest.mark.parametrize("kind", GOOD_JOBS)
def test_no_job_is_taken_that_cannot_begin(studio, kind):
    good = GOOD_JOBS[kind]
    there = studio.queue.store.counts().get("queued", 0)
    assert (
        ask(studio, "POST", "/api/jobs", json.dumps({"kind": kind, "spec": good}).encode())[0]
        == 200
    )
    for name in JOBS[kind].fields:
        for value in (
            DEEP,
            "NaN",
            "9" * 401,
            "[1]" if name != "policies" else "{}",
            "5" if name not in ("seed", "trials", "width", "font_size", "at", "rate") else "{}",
        ):
            body = json.dumps({"kind": kind, "spec": good | {name: "@"}}).replace('"@"', value)
            refused(ask(studio, "POST", "/api/jobs", body.encode()), (kind, name, value))
        if JOBS[kind].fields[name].required:
            body = json.dumps(
                {"kind": kind, "spec": {key: value for key, value in good.items() if key != name}}
            )
            refused(ask(studio, "POST", "/api/jobs", body.encode()), (kind, name))
    assert studio.queue.store.counts()["queued"] == there + 1


def test_wrong_values_are_said_with_their_field(studio):
    for name, value, said in (
        ("particles", -1, "Expected a whole number from 1 to 268435456, got -1."),
        ("particles", "x", "Expected a whole number from 1 to 268435456, got 'x'."),
        ("mpa", 1, "mpa: expected no such field"),
        ("map", "../x", "expected a name inside the folder"),
        ("policy", "model:../x.onnx", "expected a name inside the folder"),
        ("policy", "model:/etc/passwd", "expected a name inside the folder"),
    ):
        body = json.dumps({"kind": "play", "spec": {"problem": SWARM | {name: value}}}).encode()
        assert said in refused(ask(studio, "POST", "/api/jobs", body), name)
    body = json.dumps({"problem": STEERING, "seed": 1}).encode()
    assert "Expected the kind swarm, got steering" in refused(
        ask(studio, "POST", "/api/ask/map", body), "another part"
    )


WRONG = [
    -1,
    1.5,
    0,
    10**18,
    1e300,
    -1e300,
    1e-300,
    None,
    True,
    "",
    "x",
    "9" * 401,
    "1e999",
    "nan",
    "-inf",
    "²",
    "\n",
    "a" * 5000,
    "1,2;3",
    [],
    {},
    [None],
    [1e300, 1e300],
    [[1, 2], [3]],
    ["x", "y"],
    {"kind": []},
]


@pytest.mark.parametrize("good", [SWARM, STEERING, SEARCH], ids=lambda good: good["kind"])
def test_no_field_of_a_problem_breaks_the_studio(studio, good):
    for name in problem_type(good["kind"]).declarations():
        for value in WRONG:
            word, told = answer(studio.folder, "copies", {"problem": good | {name: value}})
            assert word in ("answer", "error"), (name, value, told)
            if word == "answer":
                json.dumps(told, allow_nan=False)


@pytest.mark.parametrize("body", NEVER)
@pytest.mark.parametrize(
    "path", ["/api/ask/map", "/api/ask/papers", "/api/jobs", "/api/ask/nothing"]
)
def test_bodies_that_are_no_request(studio, path, body):
    refused(ask(studio, "POST", path, body.encode("latin-1")), (path, body[:20]))


@pytest.mark.parametrize(
    ("method", "path", "query"),
    [
        ("POST", "/api/jobs", b""),
        ("GET", "/play/nothing", b""),
        ("GET", "/static/none.js", b""),
        ("GET", "/static/..%2f", b""),
        ("GET", "/static/" + "x" * 300 + ".js", b""),
        ("GET", "/static/a\0.js", b""),
        ("GET", "/player/none.css", b""),
        ("GET", "/files/none.png", b""),
        ("GET", "/files/" + "x" * 400, b""),
        ("GET", "/files/a\0", b""),
        ("GET", "/files/../x", b""),
        ("GET", "/files//etc/passwd", b""),
        ("DELETE", "/api/jobs/" + "9" * 5000, b""),
        ("DELETE", "/api/jobs/-1", b""),
        ("DELETE", "/api/jobs/x", b""),
        ("DELETE", "/api/jobs/999999", b""),
        ("PUT", "/api/files/x.exe", b""),
        ("PUT", "/api/files/" + "x" * 5000, b""),
        ("GET", "/api/files", b"skip=-1"),
        ("GET", "/api/files", b"kind=none"),
        ("GET", "/api/files", b"skip=" + b"9" * 401),
        ("PATCH", "/api/jobs", b""),
        ("GET", "/nothing", b""),
        ("POST", "/api/ask/map", b""),
    ],
)
def test_addresses_that_lead_nowhere(studio, method, path, query):
    refused(ask(studio, method, path, kind=b"text/plain", query=query), path)


@pytest.mark.parametrize("when", ["before the question", "before the head", "before it is opened"])
def test_a_file_that_goes_while_it_is_asked_for(studio, monkeypatch, when):
    file = studio.folder.root / "gone.txt"
    file.write_text("..#\n")
    assert ask(studio, "GET", "/files/gone.txt") == (200, b"..#\n")
    if when == "before the question":
        file.unlink()
    else:
        names = {"before the head": "__call__", "before it is opened": "_open_file"}
        plain = getattr(FileResponse, names[when])

        def without(response, *given):
            file.unlink()
            return plain(response, *given)

        monkeypatch.setattr(FileResponse, names[when], without)
    status, body = ask(studio, "GET", "/files/gone.txt")
    assert status == 404
    assert "no such file: 'gone.txt'" in refused((status, body), when)


def test_the_number_of_a_job_to_watch(studio):
    sent = []

    def told(*texts):
        messages = iter(
            [
                {"type": "websocket.connect"},
                *({"type": "websocket.receive", **text} for text in texts),
            ]
        )
        sent.clear()

        async def receive():
            return next(messages, {"type": "websocket.disconnect", "code": 1000})

        async def send(message):
            sent.append(message)

        scope = {
            "type": "websocket",
            "path": "/live",
            "query_string": b"",
            "headers": [],
            "subprotocols": [],
        }
        asyncio.run(application_of(studio)(scope, receive, send))
        return [one["type"] for one in sent], [
            one.get("code") for one in sent if one["type"] == "websocket.close"
        ]

    assert told({"text": '{"watch": 1}'})[1] == []
    for bad in (
        NEVER[1],
        '{"watch": 1e999}',
        '{"watch": ' + "9" * 401 + "}",
        '{"watch": true}',
        '{"watch": "1"}',
        DEEP,
        "[" * 60_000,
    ):
        assert told({"text": bad})[1] == [1003], bad
    assert told({"bytes": b"\0"})[1] == [1003]


# ---- bodies that are too large or that stop coming, over a real connection to the studio's own
# application ----


@pytest.fixture(scope="module")
def served(studio):
    made = Served(application_of(studio))
    yield made
    made.server.should_exit = True
    made.thread.join(5)


def sent(served, head, *pieces):
    """Send a request by hand, and return the whole answer."""
    with closing(served.raw()) as line:
        line.sendall(
            f"{head}\r\nHost: 127.0.0.1:{served.port}\r\nCookie: {served.cookie}\r\n".encode()
        )
        for piece in pieces:
            line.sendall(piece)
        came = b""
        while more := line.recv(65536):
            came += more
    return came


def is_answer(came, status, said):
    head, _, body = came.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 %d " % status), came[:200]
    assert came.count(b"HTTP/1.1") == 1
    assert said in json.loads(body)["error"]


JSON_HEAD = b"Content-Type: application/json\r\n"


def test_a_body_over_the_limit_is_413(served, monkeypatch, capfd):
    monkeypatch.setattr(guard_module, "LARGEST_BODY", 2**16)
    whole = b"x" * 2**20
    length = b"Content-Length: %d\r\n\r\n" % len(whole)
    is_answer(
        sent(served, "POST /api/jobs HTTP/1.1", JSON_HEAD, length, whole),
        413,
        "expected at most 65536 bytes",
    )
    chunks = [b"%x\r\n" % 2**14 + b"x" * 2**14 + b"\r\n"] * 64 + [b"0\r\n\r\n"]
    chunked = b"Transfer-Encoding: chunked\r\n\r\n"
    for path in ("/api/jobs", "/api/ask/map"):
        is_answer(
            sent(served, f"POST {path} HTTP/1.1", JSON_HEAD, chunked, *chunks),
            413,
            "expected at most 65536 bytes",
        )
    monkeypatch.setattr(guard_module, "LARGEST_UPLOAD", 2**16)
    is_answer(
        sent(served, "PUT /api/files/large.txt HTTP/1.1", chunked, *chunks),
        413,
        "expected at most 65536 bytes",
    )
    assert "Traceback" not in capfd.readouterr().err
    assert served.well()


def test_a_body_that_stops_coming_is_408(served, studio, monkeypatch, capfd):
    monkeypatch.setattr(guard_module, "SLOWEST", 0.2)
    for head in (
        "POST /api/jobs HTTP/1.1",
        "POST /api/ask/map HTTP/1.1",
        "PUT /api/files/slow.txt HTTP/1.1",
    ):
        came = sent(served, head, JSON_HEAD, b"Content-Length: 9\r\n\r\n", b"{")
        is_answer(came, 408, "expected the next piece within 0.2 s")
    with closing(served.raw()) as line:
        line.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n".encode())
        came = b""
        while more := line.recv(65536):
            came += more
    is_answer(came, 408, "expected all its headers within 0.2 s")
    assert "Traceback" not in capfd.readouterr().err
    assert not list(studio.folder.root.glob("*slow*"))
    assert served.well()
