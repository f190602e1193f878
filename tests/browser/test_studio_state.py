"""One state a place: what is drawn follows from it, undo and reload restore it, and results of
an older state say so.
"""

from __future__ import annotations

import json
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Page, expect
from tests.browser.studio import Studio, run_and_load, tab
from tests.browser.test_studio_truth import (
    DRAWN,
    FAST,
    MAZE,
    add_zone,
    click_at,
    drawn,
    planned,
    told,
)
from tests.browser.waiting import until

import shoal
from shoal.swarm import SwarmProblem

pytestmark = pytest.mark.browser

WALK = """async ([seed, actions]) => {
    const { Store, dated } = await import("/static/shared/store.js");
    const { MetricCanvas } = await import("/static/places/search/canvas.js");
    const { Drawing } = await import("/static/places/search/drawing.js");
    const random = () => {  // xorshift: the same walk at each run
        seed ^= seed << 13; seed ^= seed >>> 17; seed ^= seed << 5;
        return (seed >>> 0) / 2 ** 32;
    };
    const below = (n) => Math.floor(random() * n);

    // The place: a form's field and a drawing, as the pages keep them.
    let store, robots = 4, live, canvas;
    const whole = () => ({ robots, drawing: live.state });
    const keep = (gesture) => { live.show(); store.act(whole(), gesture); };
    const put = (state) => { robots = state.robots; live.load(state.drawing); keep(); };
    const make = () => {
        store = new Store(put);
        canvas = new MetricCanvas("", {});
        live = new Drawing(canvas, { launched() {}, store, changed({ corner, closed } = {}) {
            if (closed) store.fold((one) => !!one.drawing?.draft);
            keep();
        } });
        dates = dated(() => store.text, stage);
        store.subscribe(() => dates.refresh());
    };
    const stage = document.createElement("div");
    let dates, ran = null;
    make();
    keep();

    // The model: a list of texts, where one is in it, and nothing else.
    let states = [store.text], at = 0, gesture = null;
    const step = (text, word = null, part = null) => {
        while (part && at > 0 && part(JSON.parse(states[at]))) at -= 1;
        if (text === states[at]) return;
        const goesOn = word !== null && word === gesture;
        states.length = at + (goesOn ? 0 : 1);  // what was undone is gone
        if (!goesOn || states.at(-1) !== text) states.push(text);
        states = states.slice(-301);
        at = states.length - 1;
        gesture = at > 0 ? word : null;
    };
    const open = (one) => !!one.drawing?.draft;

    const point = () => [below(400) - 200, below(400) - 200];
    const draw = {
        corner() { live.pick(live.draft?.kind ?? (below(2) ? "parts" : "zones")); live.tap(point()); step(text(), null, live.draft ? null : open); },
        close() {
            if ((live.draft?.points.length ?? 0) < 3) return;
            live.close();
            if (!live.draft) step(text(), null, open);  // else its last side would cross it
        },
        drop() { if (live.draft) { live.drop(); step(text()); } },
        remove() {
            const kind = below(2) ? "parts" : "zones", rings = live.told[kind];
            if (rings.length) { live.edit((all) => all[kind].splice(below(rings.length), 1)); step(text()); }
        },
        moved() {
            const [ring] = live.told.parts;
            if (ring) { live.edit((all) => { all.parts[0][below(ring.length)] = point(); }); step(text()); }
        },
    };
    const text = () => JSON.stringify({ robots, drawing: live.state });
    const others = {
        typed() { robots = below(9); keep("robots"); step(text(), "robots"); },
        left() { store.end(); gesture = null; },
        undo() { if (at > 0) { at -= 1; gesture = null; } store.undo(); },
        redo() { if (at < states.length - 1) { at += 1; gesture = null; } store.redo(); },
        load() { put({ robots: below(9), drawing: { frame: null, parts: [[point(), point(), point()]], zones: [] } }); step(text()); },
        run() { ran = store.text; dates.is(ran); },
        elsewhere() { stage.hidden = !stage.hidden; },
        reload() {
            const saved = JSON.parse(JSON.stringify(store.saved())), was = ran;
            make();
            store.revive(saved);
            if (was) dates.is(was);
            gesture = null;
        },
    };
    const tools = [...Object.values(draw), ...Object.values(draw), ...Object.values(others)];
    let exported = 0, steps = 0;
    const check = (what) => {
        if (store.text !== states[at]) throw new Error(`${what}: ${store.text} is not ${states[at]}`);
        if (store.done.length !== at || store.undone.length !== states.length - 1 - at) throw new Error(`${what}: ${store.done.length} back, ${store.undone.length} forth`);
        made.load(JSON.parse(states[at]).drawing);
        made.show();
        if (live.layer.outerHTML !== made.layer.outerHTML) throw new Error(`${what}: drawn otherwise than anew`);
        if ((ran !== null && ran !== states[at]) !== ("aged" in stage.dataset)) throw new Error(`${what}: the veil`);
        if (dates.fresh) { exported += 1; if (ran !== states[at]) throw new Error(`${what}: exported`); }
    };
    const paper = new MetricCanvas("", {}), nobody = new Store(() => {});
    const made = new Drawing(paper, { changed() {}, launched() {}, store: nobody });
    for (let k = 0; k < actions; k += 1) {
        const act = tools[below(tools.length)];
        act();
        check(act.name);
        steps = Math.max(steps, states.length);
    }
    while (at > 0) { others.undo(); check("all undone"); }
    while (at < states.length - 1) { others.redo(); check("all done again"); }
    return [exported, steps];
}"""


@pytest.mark.forms(0)
def test_what_is_drawn_is_the_state_after_10000_random_actions(page: Page, studio: Studio) -> None:
    """Draw, delete, type, undo, redo, load, run, switch, reload: against a list of texts."""
    studio.open(page, "papers")
    exported, steps = page.evaluate(WALK, [74, 10_000])
    assert exported > 100
    assert steps > 20


@pytest.mark.forms(0)
def test_a_reload_restores_every_place_with_its_film_and_its_steps(
    page: Page, studio: Studio
) -> None:
    drawn(page, studio)
    page.locator("[data-field=robots] input").fill("3")
    page.locator("[data-field=robots] input").press("Tab")
    page.get_by_role("link", name="Steering", exact=True).click()
    page.get_by_role("button", name="Particle 1 at 0.2, 0.3").wait_for()
    page.get_by_role("button", name="Draw a workspace").click()
    box = page.locator(".room").first.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.3 * box["width"], box["y"] + 0.2 * box["height"])
    page.locator(".room .corner").wait_for()
    page.get_by_role("link", name="Vessels", exact=True).click()
    page.evaluate("(hash) => { location.hash = hash }", vessels_hash(MAZE, 3))
    page.locator(".underStage .source", has_text="maze:9x7").wait_for()
    page.locator("[data-field=particles] input").fill("5")
    page.locator("[data-field=particles] input").press("Tab")
    episode = run_and_load(page, studio)
    tab(page, "Compare")
    page.locator("#compareTrials").fill("7")
    tab(page, "Episode")
    page.reload()
    inside = page.frame_locator(".panel:not([hidden]) iframe:not([hidden])")
    inside.locator("#of", has_text=f"of {episode.moves}").wait_for()
    assert (
        page.get_by_role("tab", name="Episode", exact=True).get_attribute("aria-selected") == "true"
    )
    assert page.locator(".frames[data-aged]").count() == 0
    assert page.locator("#compareTrials").input_value() == "7"
    page.locator("[data-field=particles] input").focus()
    page.keyboard.press("Control+z")
    expect(page.locator("[data-field=particles] input")).to_have_value("4")
    expect(page.locator(".frames[data-aged='out of date']:visible")).to_have_count(1)
    page.get_by_role("group", name="Export the earlier episode").wait_for()
    page.keyboard.press("Control+Shift+z")
    expect(page.locator("[data-field=particles] input")).to_have_value("5")
    page.get_by_role("group", name="Export", exact=True).wait_for()
    expect(page.locator(".frames[data-aged]:visible")).to_have_count(0)
    page.get_by_role("link", name="Search", exact=True).click()
    planned(page)
    assert told(page)["problem"]["robots"] == 3
    assert told(page)["drawing"]["parts"] == DRAWN["parts"]
    page.get_by_role("link", name="Steering", exact=True).click()
    page.locator(".room .corner").wait_for()
    assert len(told(page)["corners"]) == 1
    page.keyboard.press("Control+z")
    expect(page.locator(".room .corner")).to_have_count(0)


def vessels_hash(problem: dict[str, object], seed: int) -> str:
    return f"#vessels?{quote(json.dumps({'problem': problem, 'seed': seed}))}"


def test_an_old_plan_under_new_zones_wears_a_veil(page: Page, studio: Studio) -> None:
    drawn(page, studio)
    page.route("**/api/ask/plan", lambda route: None)  # which holds the request
    with page.expect_request("**/api/ask/plan"):
        add_zone(page)  # drawn at once, although no answer has come
        until(page, "document.querySelector('.metric').dataset.aged === 'out of date'")
    page.unroute("**/api/ask/plan")  # which lets it go on
    until(page, "document.querySelector('.metric').dataset.aged === undefined")
    corner = page.get_by_role("button", name="No-go zone 1, corner 1")
    corner.press("Delete")  # the last three corners: the zone goes
    expect(corner).to_have_count(0)
    page.keyboard.press("Control+z")
    corner.wait_for()


@pytest.mark.forms(0)
def test_a_painted_map_is_in_the_folder_and_the_address_names_it(
    page: Page, studio: Studio
) -> None:
    studio.open(page, "vessels", {"problem": {"map": "rectangle:5x5", "particles": 2}, "seed": 0})
    facts = page.locator(".underStage .facts")
    facts.get_by_text("25 free").wait_for()
    page.get_by_role("button", name="Erase").click()
    page.locator(".editor canvas").focus()
    page.keyboard.press("Space")
    until(page, "decodeURIComponent(location.hash).includes('rectangle-painted.png')")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Space")
    facts.get_by_text("13 free").wait_for()
    until(page, "decodeURIComponent(location.hash).includes('rectangle-painted.png')")
    file = studio.folder / "rectangle-painted.png"
    link = told(page)
    page.get_by_role("link", name="Papers", exact=True).click()
    page.get_by_role("link", name="Vessels", exact=True).click()
    until(page, "location.hash.startsWith('#vessels?')")
    assert told(page) == link
    page.locator(".editor canvas").focus()
    page.keyboard.press("Control+z")  # back to one stroke: the file follows
    facts.get_by_text("16 free").wait_for()
    until(page, "decodeURIComponent(location.hash).includes('rectangle-painted.png')")
    assert page.evaluate("document.activeElement.tagName") == "CANVAS"
    assert int(np.asarray(Image.open(file).convert("L")).astype(bool).sum()) == 16
    assert len(list(studio.folder.glob("rectangle-painted*"))) == 1
    episode = run_and_load(page, studio)
    assert episode.workspace.n_free == 16
    assert episode.problem.map == file.name
    before = file.read_bytes()
    tab(page, "Map")
    page.locator(".editor canvas").focus()
    page.keyboard.press("Control+z")
    until(page, "decodeURIComponent(location.hash).includes('rectangle:5x5')")
    page.keyboard.press("Space")
    until(page, "decodeURIComponent(location.hash).includes('rectangle-painted-2.png')")
    assert file.read_bytes() == before  # what a run has used stays as it is
    studio.open(page, "vessels", link)
    facts.get_by_text("16 free").wait_for()


@pytest.mark.forms(0)
def test_an_episode_opened_during_a_run_stays_on_the_stage_with_its_own_exports(
    page: Page, studio: Studio
) -> None:
    episode = shoal.run(SwarmProblem("maze:11x9", particles=3, policy="closest-frontier"), seed=41)
    episode.save(studio.folder / "opened.npz")
    studio.open(page, "vessels", {"problem": MAZE, "seed": 5})
    page.locator(".underStage .facts", has_text="free").wait_for()
    tab(page, "Episode")
    page.evaluate("""async () => {
        const choice = document.querySelector("select[aria-label='Episodes of the folder']");
        [...document.querySelectorAll(".bottom .main")].find((one) => one.textContent === "Run").click();
        await new Promise((done) => setTimeout(done));
        choice.value = "opened.npz";
        choice.dispatchEvent(new Event("change"));
    }""")
    page.locator(".note", has_text="The run is saved as").wait_for()
    inside = page.frame_locator(".panel:not([hidden]) iframe:not([hidden])")
    inside.locator("#of", has_text=f"of {episode.moves}").wait_for()
    chip = page.locator(".panel:not([hidden]) .exports a")
    assert chip.get_attribute("href") == "/files/opened.npz"


@pytest.mark.forms(0)
def test_what_was_deleted_comes_back(page: Page, studio: Studio) -> None:
    drawn(page, studio, DRAWN | {"zones": [[[-20, -20], [20, -20], [20, 15]]]}, launch="-60,30")
    before = told(page)
    page.get_by_role("button", name="Launch point 1").press("Delete")
    page.get_by_role("button", name="No-go zone 1, corner 2").press("Delete")
    page.get_by_role("button", name="Region 1, corner 1").press("Delete")
    click_at(page, (0, 0))
    for _ in range(3):
        page.keyboard.press("Control+z")
    assert told(page) == before
    for _ in range(3):
        page.keyboard.press("Control+Shift+z")
    left = {"parts": [DRAWN["parts"][0][1:]], "holes": [], "zones": []}
    assert told(page)["drawing"] == {"frame": None, **left}
    assert "launch" not in told(page)["problem"]


CANVASES = {
    "vessels": ({"problem": {"map": "rectangle:6x8", "particles": 3}, "seed": 0}, ".editor canvas"),
    "search": ({"problem": FAST, "drawing": DRAWN, "seed": 1}, ".plane"),
    "steering": (None, ".room"),
}


@pytest.mark.forms(3)
@pytest.mark.parametrize("place", CANVASES)
def test_two_fingers_and_keys_zoom_every_canvas(page: Page, studio: Studio, place: str) -> None:
    given, canvas = CANVASES[place]
    studio.open(page, place, given)
    page.locator(".facts, .plan").locator("visible=true").first.wait_for()
    page.wait_for_load_state("networkidle")
    grown = page.evaluate(
        """async (canvas) => {
            const element = document.querySelector(canvas);
            element.setPointerCapture = () => {};  // these fingers are none
            const box = element.getBoundingClientRect();
            const frames = () => new Promise((done) =>
                requestAnimationFrame(() => requestAnimationFrame(done)));
            const seen = async () => {  // a picture of the canvas, or where things are on it
                await frames();
                return element.toDataURL?.() ?? element.getAttribute("viewBox")
                    + element.querySelector("g:nth-of-type(3)")?.getAttribute("transform");
            };
            const touch = (kind, id, x, y) => element.dispatchEvent(new PointerEvent(kind, {
                pointerId: id, bubbles: true, button: 0,
                clientX: box.left + x * box.width, clientY: box.top + y * box.height,
            }));
            const key = (key) => element.dispatchEvent(
                new KeyboardEvent("keydown", { key, bubbles: true }));
            const first = await seen();
            touch("pointerdown", 1, 0.4, 0.5);
            touch("pointerdown", 2, 0.6, 0.5);
            touch("pointermove", 2, 0.8, 0.5);
            touch("pointermove", 2, 0.9, 0.5);
            touch("pointerup", 1, 0.4, 0.5);
            touch("pointerup", 2, 0.9, 0.5);
            const pinched = await seen();
            key("0");
            const whole = await seen();
            key("+");
            const keyed = await seen();
            return [first === pinched, first === whole, whole === keyed];
        }""",
        canvas,
    )
    assert grown == [False, True, False]


@pytest.mark.forms(0)
def test_a_second_finger_takes_the_dab_of_the_first_one_back(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "rectangle:6x8", "particles": 3}, "seed": 0})
    page.locator(".underStage .facts").get_by_text("48 free").wait_for()
    page.get_by_role("button", name="Erase").click()
    page.evaluate("""() => {
        const element = document.querySelector(".editor canvas"), box = element.getBoundingClientRect();
        element.setPointerCapture = () => {};
        for (const [kind, id, x] of [["pointerdown", 1, 0.5], ["pointerdown", 2, 0.6],
            ["pointermove", 2, 0.7], ["pointerup", 1, 0.5], ["pointerup", 2, 0.7]]) {
            element.dispatchEvent(new PointerEvent(kind, { pointerId: id, bubbles: true, button: 0,
                clientX: box.left + x * box.width, clientY: box.top + box.height / 2 }));
        }
    }""")
    assert page.locator(".toolbar").get_by_role("button", name="Undo").first.is_disabled()
    assert told(page)["problem"]["map"] == "rectangle:6x8"
    assert page.locator(".underStage .facts").inner_text().startswith("6 rows × 8 columns, 48 free")
