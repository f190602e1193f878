"""Chromium, and a function that opens an episode in the player."""

from __future__ import annotations

import os
import re
import shutil
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright
from tests.browser.studio import FORMS, HOSTILE, Form, Studio, wear

from shoal.views.player import render

OpenPlayer = Callable[..., Page]
FIREFOX = os.environ.get("SHOAL_BROWSER") == "firefox"
ARGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Browser tests come last: while Playwright is open, asyncio.run() fails in every
    other test.
    """
    items.sort(key=lambda item: item.get_closest_marker("browser") is not None)
    for item in items if FIREFOX else ():
        if missing := item.get_closest_marker("chromium"):
            item.add_marker(pytest.mark.skip(f"Firefox's protocol has no {missing.args[0]}"))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Each flow of the studio has one of the four forms, or those that it names; with
    SHOAL_FORMS=all it has all.
    """
    named = metafunc.definition.get_closest_marker("forms")
    if "form" in metafunc.fixturenames and (named or os.environ.get("SHOAL_FORMS") == "all"):
        forms = (
            FORMS
            if os.environ.get("SHOAL_FORMS") == "all" or named is None
            else [FORMS[k] for k in named.args]
        )
        metafunc.parametrize("form", forms, indirect=True, ids=lambda form: f"{form[0]}-{form[1]}")


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """The browser: the Chromium of the system, or else Playwright's own; with
    SHOAL_BROWSER=firefox the system's Firefox (``make test-firefox``).
    """
    with sync_playwright() as playwright:
        if FIREFOX:
            browser = playwright.firefox.launch(
                channel="moz-firefox",
                executable_path=shutil.which("firefox-esr") or "firefox",
                firefox_user_prefs={
                    "dom.events.testing.asyncClipboard": True,
                    "browser.download.alwaysOpenPanel": False,  # which takes the focus
                },
            )
        else:
            # without the parts for windows, the tests take a third less of the processor
            found = shutil.which("chromium-headless-shell") or shutil.which("chromium")
            browser = playwright.chromium.launch(executable_path=found, args=ARGS)
        yield browser
        browser.close()


class Visitor:
    """Opens files in pages, and notes what the pages ask for and write to the console."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser
        self.requests: list[str] = []
        self.messages: list[str] = []
        self.contexts: list[BrowserContext] = []
        # serves every test that needs no special context: a new one costs 0.4 s
        self.plain = self.page()

    def page(self, **options: Any) -> Page:
        context = self.browser.new_context(
            **{"viewport": {"width": 1280, "height": 800}, **options}
        )
        self.contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(5000)
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("console", lambda message: self.messages.append(message.text))
        page.on("pageerror", lambda error: self.messages.append(error.stack or str(error)))
        return page


@pytest.fixture(scope="session")
def visitor(chromium: Browser) -> Iterator[Visitor]:
    """One visitor for all tests."""
    visitor = Visitor(chromium)
    yield visitor
    visitor.plain.context.close()


@pytest.fixture
def open_player(visitor: Visitor, tmp_path: Path) -> Iterator[OpenPlayer]:
    """Open an episode, its data or the text of its page. That may load nothing else and must leave
    the console empty.
    """
    files: list[str] = []
    visitor.requests.clear()
    visitor.messages.clear()

    def open_(data: dict[str, object] | str, **options: Any) -> Page:
        file = tmp_path / f"player-{len(files)}.html"
        file.write_text(data if isinstance(data, str) else render("swarm", data), encoding="utf-8")
        files.append(file.as_uri())
        page = visitor.page(**options) if options else visitor.plain
        if FIREFOX:  # where no field of a page behind another one has the focus
            page.bring_to_front()
        page.mouse.move(0, 0)
        page.goto(files[-1])
        return page

    yield open_
    for context in visitor.contexts[1:]:
        context.close()
    del visitor.contexts[1:]
    # Firefox does not tell of the files themselves
    assert {url for url in visitor.requests if not url.startswith("data:")} <= {*files}
    assert visitor.messages == []


@pytest.fixture(scope="session")
def studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studio]:
    """One studio for all tests of a process."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / f"{HOSTILE}.txt").write_text("..#\n...\n")
    made = Studio(folder)
    yield made
    made.end()


@pytest.fixture(scope="session")
def console() -> list[str]:
    """What the studio's page has written to its console: nothing."""
    return []


@pytest.fixture(scope="session")
def studio_page(studio: Studio, chromium: Browser, console: list[str]) -> Iterator[Page]:
    """A page on it, which may ask nobody else and whose console must stay empty."""
    context = chromium.new_context(viewport={"width": 1280, "height": 800}, reduced_motion="reduce")
    if not FIREFOX:  # which has no such permissions
        context.grant_permissions(["clipboard-read", "clipboard-write"])
    opened = context.new_page()
    opened.set_default_timeout(30_000)
    opened.on(
        "console", lambda message: "status of 422" in message.text or console.append(message.text)
    )  # a refusal is shown
    opened.on("pageerror", lambda error: console.append(error.stack or str(error)))
    opened.on("dialog", lambda dialog: console.append(dialog.message))
    asked: list[str] = []
    opened.on("request", lambda request: asked.append(request.url))
    opened.goto(studio.address)
    opened.wait_for_selector("body[data-ready]")
    yield opened
    context.close()
    assert console == []
    assert [
        url for url in asked if not re.match(r"http://127\.0\.0\.1:\d+/|data:|blob:", url)
    ] == []


@pytest.fixture
def form(request: pytest.FixtureRequest) -> Form:
    """Light or dark, wide or narrow: the same at each run of a test, dealt over the tests."""
    dealt: Form = getattr(
        request, "param", FORMS[zlib.crc32(request.node.nodeid.encode()) % len(FORMS)]
    )
    return dealt


@pytest.fixture
def page(studio_page: Page, studio: Studio, form: Form, console: list[str]) -> Iterator[Page]:
    """The page in one of the four forms; what a test writes into the folder is gone after it."""
    there = set(studio.folder.rglob("*"))
    wear(studio_page, *form)
    if FIREFOX:
        studio_page.bring_to_front()
        for other in studio_page.context.pages[1:]:  # files that it shows after a download
            other.close()
    yield studio_page
    studio_page.unroute_all(behavior="ignoreErrors")
    for path in sorted(set(studio.folder.rglob("*")) - there, reverse=True):
        path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)
    written, console[:] = console[:], []
    assert written == []  # here, where the test that caused it is known
