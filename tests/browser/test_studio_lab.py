"""The studio's lab, used as people use it, and every page as people with other needs find it."""

from __future__ import annotations

import csv
import sqlite3
from pathlib import Path
from typing import Any

import axe_playwright_python
import pytest
from playwright.sync_api import Page, Route, expect
from tests.browser.studio import FORMS, Studio, tab, tab_to, wear, written_by
from tests.browser.waiting import until

import shoal
from shoal.lab import Store, Sweep, run_sweep
from shoal.lab.statistics import compare_along, summarise
from shoal.lab.sweep import as_toml
from shoal.search import SearchProblem
from shoal.steering import SteeringProblem
from shoal.swarm import SwarmProblem

pytestmark = pytest.mark.browser
POLICIES = ["closest-frontier", "greedy-classify"]


def small(name: str, trials: int = 4, **more: Any) -> dict[str, Any]:
    problem = {"kind": "swarm", "map": "maze:9x7", "particles": 3}
    return {
        "name": name,
        "trials": trials,
        "seed": 1,
        "paired": ["policy"],
        "problem": problem,
        "axes": {"policy": POLICIES} | more,
    }


def run_from_the_form(page: Page, studio: Studio, sweep: dict[str, Any]) -> None:
    studio.open(page, "lab", {"tab": "new", "toml": as_toml(sweep)})
    page.locator(".drafting [role=status]", has_text="trials").wait_for()
    file, text = page.locator(".drafting .file"), page.locator(".drafting .file textarea")
    assert text.evaluate("one => one.clientWidth") > 0.8 * file.evaluate("one => one.clientWidth")
    page.get_by_role("button", name="Run the sweep").click()
    complete(page, sweep["name"])


def complete(page: Page, name: str) -> None:
    page.locator(".sweepCard[aria-current]", has=page.get_by_text(name, exact=True)).get_by_text(
        "complete"
    ).wait_for(timeout=90_000)
    page.locator(".sweep > [role=status]", has_text="complete").wait_for()
    page.locator(".sweep .chip.done").wait_for()


def shown_table(page: Page, name: str) -> list[list[str]]:
    rows = page.get_by_role("region", name=name, exact=True).locator("tbody tr").all()
    return [row.locator("th, td").all_inner_texts() for row in rows]


@pytest.fixture(scope="module")
def mazes(studio: Studio) -> str:
    """A store in the folder, as a command makes it, and an episode."""
    shoal.run(SwarmProblem("maze:9x7", particles=2, policy="closest-frontier"), seed=1).save(
        studio.folder / "episode.npz"
    )
    run_sweep(Sweep(**small("mazes", particles=[2, 4])), studio.folder / "mazes.sqlite", workers=0)
    return "mazes.sqlite"


def test_a_sweep_from_the_form_answers_which_policy_is_better(page: Page, studio: Studio) -> None:
    studio.open(page, "lab", {"tab": "new"})
    page.get_by_text("2 points, 40 trials").wait_for()
    page.get_by_label("Name").fill("better")
    page.get_by_label("Trials per point").fill("4")
    page.get_by_label("Values").fill("closest-frontier")
    page.get_by_label("greedy-classify").check()
    page.get_by_label("map", exact=True).fill("maze:9x7")
    # the file follows while the field has the focus
    until(page, "document.getElementById('sweepToml').value.includes('map = \"maze:9x7\"')")
    page.get_by_text("2 points, 8 trials").wait_for()
    page.get_by_role("button", name="Run the sweep").click()
    complete(page, "better")
    assert page.locator(".sweep .settings").inner_text() == "map maze:9x7, particles 20"
    with Store(studio.folder / "better.sqlite") as store:
        rows, ((_, _, _, found),) = (
            summarise(store, "better", "moves"),
            compare_along(store, "better", "moves", "policy"),
        )
    assert [cells[1] for cells in shown_table(page, "Means")] == [
        f"{row.estimate.mean:.4g}" for row in rows if row.estimate
    ]
    assert found is not None
    assert shown_table(page, "Comparisons")[0][2] == f"{found.difference.mean:.4g}"
    # the numbers of a row stand in it while the pointer is there
    names = "[...document.querySelectorAll('.chartArea .name')].map((name) => name.getBBox().x)"
    assert min(page.evaluate(names)) >= 0  # none is cut off
    row = page.locator(".chartArea .row").first
    assert not row.locator(".value").is_visible()
    row.hover()
    assert row.locator(".value").is_visible()
    estimate = rows[0].estimate
    assert estimate is not None
    assert row.locator(".value").text_content() == (
        f"{estimate.mean:.4g} ({estimate.low:.4g} to {estimate.high:.4g})"
    )
    told = (
        "do not differ clearly"
        if found.difference.low <= 0 <= found.difference.high
        else "than for"
    )
    assert told in page.locator(".verdict").inner_text()
    assert Sweep.load(studio.folder / "better.toml").problem["map"] == "maze:9x7"
    # the store has the name now: nothing else is run under it
    tab(page, "New sweep")
    page.get_by_label("map", exact=True).fill("maze:7x7")
    page.get_by_label("map", exact=True).press("Tab")
    page.get_by_text("better.sqlite holds another sweep of this name").wait_for()
    assert page.get_by_role("button", name="Run the sweep").is_disabled()
    episodes = [
        shoal.run(SwarmProblem("maze:9x7", particles=20, policy=name), seed=0) for name in POLICIES
    ]
    assert all(episodes)


def test_a_new_sweep_of_each_kind_is_a_question_with_a_free_name(
    page: Page, studio: Studio
) -> None:
    run_sweep(Sweep(**small("crashes", trials=1)), studio.folder / "crashes.sqlite", workers=0)
    studio.open(page, "lab", {"tab": "new"})
    page.get_by_text("2 points, 40 trials").wait_for()
    kind, said = page.get_by_label("Kind of problem"), page.locator(".drafting [role=status]")
    for name in kind.locator("option").all_inner_texts():
        kind.select_option(name)
        until(page, f"document.getElementById('sweepToml').value.includes('kind = \"{name}\"')")
        said.get_by_text("2 points, 40 trials").wait_for()
    kind.select_option("swarm")
    page.get_by_label("What varies").select_option("particles")
    page.get_by_label("Values").fill("5, 15")
    said.get_by_text("Results go to particles.sqlite").wait_for()  # no longer of policies
    kind.select_option("search")
    said.get_by_text("Results go to crashes-2.sqlite").wait_for()
    page.locator(".axis .help", has_text="Number of robots that crash").wait_for()
    page.get_by_label("region", exact=True).fill("square:60")
    page.get_by_label("region", exact=True).press("Tab")
    page.get_by_label("Trials per point").fill("3")
    said.get_by_text("6 trials").wait_for()
    page.get_by_role("button", name="Run the sweep").click()
    complete(page, "crashes-2")
    with Store(studio.folder / "crashes-2.sqlite") as store:
        ((_, _, _, found),) = compare_along(store, "crashes-2", "makespan", "crashes")
    assert found is not None
    verdict = page.locator(".verdict").inner_text()
    assert "crashes 1" in verdict
    assert "crashes 0" in verdict
    assert shown_table(page, "Comparisons")[0][2] == f"{found.difference.mean:.4g}"


def test_the_file_and_the_form_follow_each_other(page: Page, studio: Studio) -> None:
    studio.open(page, "lab", {"tab": "new"})
    text = page.get_by_label("The same as a file")
    page.get_by_text("2 points, 40 trials").wait_for()
    text.fill(as_toml(small("other", particles={"from": 2, "to": 8, "step": 2})))
    page.get_by_text("8 points, 32 trials").wait_for()
    assert page.get_by_label("Name").input_value() == "other"
    assert page.get_by_label("Values").last.input_value() == "2 to 8 step 2"
    # a name becomes a part of a file's name: blanks are hyphens
    name = page.get_by_label("Name")
    name.fill("how many moves")
    page.locator(".drafting [role=status]", has_text="how-many-moves.sqlite").wait_for()
    name.press("Tab")
    expect(name).to_have_value("how-many-moves")
    assert 'name = "how-many-moves"\n' in text.input_value()
    page.get_by_label("Values").last.fill("1 to 100 in 3 values log")
    page.get_by_text("6 points, 24 trials").wait_for()
    assert 'particles = { from = 1, to = 100, count = 3, scale = "log" }' in text.input_value()
    text.fill(text.input_value().replace("seed = 1", f"seed = {2**62 + 1}"))
    until(page, f"document.getElementById('sweepSeed').value === '{2**62 + 1}'")
    page.get_by_label("Trials per point").fill("5")
    page.get_by_text("6 points, 30 trials").wait_for()
    assert f"seed = {2**62 + 1}\n" in text.input_value()
    text.fill(text.input_value().replace("maze:9x7", 'maze:9x7"\nmpa = "x'))
    page.locator(".drafting .warning", has_text="line 9: problem").wait_for()
    assert page.get_by_role("button", name="Run the sweep").is_disabled()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("maze:9x7", "../../etc/passwd"), "expected a name inside the folder"),
        (('"greedy-classify"', '"os:system"'), "runs the code of the Python module"),
        (('kind = "swarm"', 'kind = "function"\nfunction = "os:system"'), "runs your own code"),
    ],
)
def test_a_sweep_from_a_page_names_no_code_and_no_file_elsewhere(
    page: Page, studio: Studio, change: Any, words: str
) -> None:
    studio.open(page, "lab", {"tab": "new"})
    page.get_by_text("2 points, 40 trials").wait_for()
    page.get_by_label("The same as a file").fill(as_toml(small("bad")).replace(*change))
    page.locator(".drafting .warning", has_text=words).wait_for()
    asked = page.evaluate(
        """async (toml) => {
          const job = await (await fetch('/api/jobs', {method: 'POST', headers: {'content-type': 'application/json'},
            body: JSON.stringify({kind: 'sweep', spec: {toml, store: 'bad.sqlite', sweep: 'bad'}})})).json();
          for (;;) {
            const {jobs} = await (await fetch('/api/jobs')).json(), now = jobs.find((one) => one.id === job.id);
            if (now.state === 'failed') return now.result.error;
            await new Promise((resolve) => setTimeout(resolve, 30));
          }
        }""",
        as_toml(small("bad")).replace(*change),
    )
    assert words in asked
    assert not (studio.folder / "bad.sqlite").exists()


def test_a_sweep_of_the_command_is_found_and_exported(
    page: Page, studio: Studio, mazes: str
) -> None:
    studio.open(page, "lab", {"store": mazes, "sweep": "mazes", "measure": "scans"})
    page.locator(".sweep h2", has_text="mazes").wait_for()
    assert page.get_by_label("Measure").input_value() == "scans"
    page.get_by_label("Measure").select_option("moves")
    chart = page.get_by_label("moves against particles")
    chart.locator("canvas").wait_for()
    chart.get_by_text("Bars: their 95 % intervals").wait_for()
    compared, *_, told_95 = shown_table(page, "Comparisons")[0]
    assert compared == "greedy-classify minus closest-frontier"
    assert told_95 in ("higher", "lower", "no clear difference")
    with Store(studio.folder / mazes) as store:
        rows = [row for row in summarise(store, "mazes", "moves") if row.estimate]

    def values() -> list[str]:
        return chart.locator(".u-series .u-value").all_inner_texts()

    # at the pointer, the mean and the interval of each line
    over = chart.locator(".u-over")
    box = over.bounding_box()
    assert box is not None
    over.hover(position={"x": box["width"] * 0.9, "y": 20})
    told = [
        f"{row.estimate.mean:.4g} ({row.estimate.low:.4g} to {row.estimate.high:.4g})"
        for row in rows
        if row.estimate and row.values["particles"] == 4
    ]
    assert values() == ["4", *told]
    # a drag zooms in, a double click shows all
    assert chart.locator(".u-axis").count() == 2
    for drag in (True, False):
        if drag:
            page.mouse.down()
            over.hover(position={"x": box["width"] * 0.6, "y": 20})
            page.mouse.up()
        else:
            over.dispatch_event("dblclick")  # with Firefox, Playwright sends two single clicks
        over.hover(position={"x": 3, "y": 20})
        shown = chart.locator(".u-series .u-value").first
        expect(shown).to_have_text("4" if drag else "2")
    with Store(studio.folder / mazes) as store:
        expected = [[str(value) for value in row] for row in store.rows("mazes")]
        means = [
            f"{row.estimate.mean:.4g}" for row in summarise(store, "mazes", "moves") if row.estimate
        ]
    assert [cells[1] for cells in shown_table(page, "Means")] == means
    table = written_by(page, studio, "Table as CSV")
    assert list(csv.reader(table.read_text().splitlines()))[1:] == expected
    assert written_by(page, studio, "Figure as PNG").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.chromium("bodies of requests")
@pytest.mark.parametrize(
    ("ends", "said"),
    [
        (
            [(2, 4)] * 4,
            "greedy-classify against closest-frontier: mean moves are higher at all 4 points (with 95 %",
        ),
        (
            [(2, 4), (-4, -2), (-1, 1), (1, 3)],
            "are lower at 1 of 4 points, higher at 2 and not clearly different at 1 (with 95 %",
        ),
        ([(-1, 1)] * 4, "closest-frontier: mean moves do not differ clearly at any of 4 points."),
    ],
)
def test_many_comparisons_are_one_sentence(
    page: Page, studio: Studio, mazes: str, ends: list[tuple[int, int]], said: str
) -> None:
    def many(route: Route) -> None:
        answer = route.fetch()
        found = answer.json()
        one = found["comparisons"][0]
        found["comparisons"] = [
            one | {"comparison": {"difference": {"low": low, "high": high, "mean": 0, "count": 4}}}
            for low, high in ends
        ]
        route.fulfill(response=answer, json=found)

    page.route("**/api/ask/sweep", many)
    studio.open(page, "lab", {"store": mazes, "sweep": "mazes", "measure": "moves"})
    page.locator(".verdict", has_text=said).wait_for()
    page.unroute_all(behavior="ignoreErrors")


def test_a_sweep_as_python_gives_the_same_means(
    page: Page,
    studio: Studio,
    mazes: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    studio.open(page, "lab", {"store": mazes, "sweep": "mazes"})
    page.locator(".sweep").get_by_role("button", name="As Python").click()
    page.wait_for_selector(".sheet[open]")
    script = page.locator(".code").last.inner_text()
    tab(page, "As file")
    (tmp_path / "mazes.toml").write_text(page.locator(".sheet .code").inner_text())
    tab(page, "As command")
    assert (
        page.locator(".sheet .code")
        .inner_text()
        .startswith("shoal sweep run mazes.toml --store mazes.sqlite")
    )
    page.keyboard.press("Escape")
    monkeypatch.chdir(tmp_path)
    exec(script, {})
    with Store(studio.folder / mazes) as store:
        assert capsys.readouterr().out.splitlines() == [
            f"{row.values} {row}" for row in summarise(store, "mazes", "moves")
        ]


def test_the_first_trial_of_a_point_is_watched(page: Page, studio: Studio, mazes: str) -> None:
    studio.open(page, "lab", {"store": mazes, "sweep": "mazes"})
    page.get_by_role(
        "link", name="Watch the first trial at policy greedy-classify, particles 4"
    ).click()
    page.locator(".panel:not([hidden]) .stageHead .exports").wait_for()  # the sweep has its own
    episode: Any = shoal.load(
        max(studio.folder.glob("maze-9x7-greedy*.npz"), key=lambda path: path.stat().st_mtime)
    )
    with Store(studio.folder / mazes) as store:
        row = next(row for row in store.rows("mazes") if row[:3] == ("greedy-classify", 4, 0))
    assert (episode.seed, episode.moves) == (row[3], row[5])


def test_a_sweep_is_extended(page: Page, studio: Studio) -> None:
    run_from_the_form(page, studio, small("grows", trials=2))
    page.get_by_role("button", name="Extend").click()
    page.get_by_text("grows.sqlite is there").wait_for()
    page.get_by_label("Trials per point").fill("3")
    page.get_by_text("2 points, 6 trials").wait_for()
    page.get_by_role("button", name="Run the sweep").click()
    page.locator(".sweepCard[aria-current]", has_text="6 trials, complete").wait_for()
    with Store(studio.folder / "grows.sqlite") as store:
        assert store.status("grows").done == 6


def test_a_sweep_pauses_and_goes_on_to_the_same_rows(page: Page, studio: Studio) -> None:
    sweep = small("pauses", trials=20_000) | {
        "problem": {"kind": "swarm", "map": "maze:31x31", "particles": 3}
    }
    studio.open(page, "lab", {"tab": "new", "toml": as_toml(sweep)})
    page.get_by_text("2 points, 40,000 trials").wait_for()
    page.get_by_role("button", name="Run the sweep").click()
    page.get_by_role("button", name="Pause", exact=True).click()
    page.get_by_role("button", name="Resume").wait_for()
    with Store(studio.folder / "pauses.sqlite") as store:
        assert not store.status("pauses").complete
    page.get_by_role("button", name="Resume").click()
    page.get_by_role("button", name="Pause", exact=True).wait_for()
    page.get_by_role("button", name="Pause", exact=True).click()
    page.get_by_role("button", name="Resume").wait_for()


def test_a_damaged_store_is_said_and_the_others_are_shown(
    page: Page, studio: Studio, mazes: str
) -> None:
    (studio.folder / "broken.sqlite").write_bytes(b"no store at all")
    with sqlite3.connect(studio.folder / "notes.sqlite") as other:
        other.execute("CREATE TABLE notes (text)")
    studio.open(page, "lab", {"store": mazes, "sweep": "mazes"})
    page.locator(".sweepCard", has_text="broken.sqlite").click()
    page.locator(".sweep .warning", has_text="broken.sqlite").wait_for()
    assert page.locator(".sweepCard", has_text="cannot be read").count() == 2
    page.locator(".sweepCard", has=page.get_by_text("mazes", exact=True)).click()
    page.locator(".sweep h2", has_text="mazes").wait_for()
    for name in ("broken.sqlite", "notes.sqlite"):
        (studio.folder / name).unlink()


@pytest.mark.forms(0)
def test_no_sweep_is_shown_under_the_mark_of_another(
    page: Page, studio: Studio, mazes: str
) -> None:
    """While the chosen sweep is read, which takes long on a busy machine, the one
    before is gone.
    """
    run_sweep(Sweep(**small("others", 1)), studio.folder / "others.sqlite", workers=0)
    studio.open(page, "lab", {"tab": "sweeps", "store": mazes, "sweep": "mazes"})
    page.locator(".sweep h2", has_text="mazes").wait_for()
    held: list[Route] = []
    page.route("**/api/ask/sweep", lambda route: held.append(route))  # noqa: PLW0108 - its argument is inspected
    page.locator(".sweepCard", has_text="others").click()
    page.locator(".sweepCard[aria-current]", has_text="others").wait_for()
    page.locator(".sweep [role=status]", has_text="Opening others").wait_for()
    assert page.locator(".sweep h2").count() == 0
    page.unroute("**/api/ask/sweep")  # which lets the held requests go on
    page.locator(".sweep h2", has_text="others").wait_for()
    # and no page says that there is none before it knows
    page.route("**/api/ask/sweeps", lambda _: None)
    studio.open(page, "lab", {"tab": "sweeps", "store": mazes, "sweep": "mazes"})
    page.locator(".sweep [role=status]", has_text="Opening mazes").wait_for()
    page.unroute("**/api/ask/sweeps")
    page.locator(".sweep h2", has_text="mazes").wait_for()


def test_a_comparison_goes_on_in_the_lab(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "maze:9x7", "particles": 5}, "seed": 3})
    tab(page, "Compare")
    page.get_by_role("button", name="Over more settings").click()
    page.get_by_text("2 points, 20 trials").wait_for()
    text = page.get_by_label("The same as a file").input_value()
    assert 'map = "maze:9x7"' in text
    assert "seed = 3" in text


def test_the_gallery_shows_episodes_and_plays_them(page: Page, studio: Studio) -> None:
    episode = shoal.run(SwarmProblem("maze:9x7", particles=4, policy="closest-frontier"), seed=9)
    episode.save(studio.folder / "shelf.npz")
    studio.open(page, "lab", {"tab": "episodes"})
    card = page.locator(".card", has_text="shelf.npz")
    card.get_by_text(episode.sentence).wait_for()
    assert (
        card.locator("img").evaluate("image => image.decode().then(() => image.naturalWidth)") > 100
    )
    card.click()
    frame = page.frame_locator(".watching iframe:not([hidden])")
    frame.locator("#of", has_text=f"of {episode.moves}").wait_for()


@pytest.mark.forms(0)
def test_episodes_of_all_parts_play_at_once_with_their_buttons_in_sight(
    page: Page, studio: Studio
) -> None:
    shoal.run(SteeringProblem(planner="greedy"), seed=9).save(studio.folder / "pair.json")
    shoal.run(SearchProblem("square:60", robots=5, footprint=20.0)).save(
        studio.folder / "five.json"
    )
    page.emulate_media(reduced_motion="no-preference")
    for name in ("pair.json", "five.json"):
        studio.open(page, "lab", {"tab": "episodes", "episode": name})
        until(
            page,
            "document.querySelector('.watching iframe:not([hidden])')?.contentWindow.shoalPlayer?.time"
            " > 0",
        )
        frame = page.frame_locator(".watching iframe:not([hidden])")
        for button in (frame.locator("#play"), frame.locator("#robots li, #moves li").first):
            box = button.bounding_box()
            assert box is not None
            assert box["y"] + box["height"] <= 800
    side = frame.locator(".side").evaluate("side => side.getBoundingClientRect().bottom")
    assert (
        frame.locator("#robots li").last.evaluate("robot => robot.getBoundingClientRect().bottom")
        <= side
    )
    studio.open(page, "steering", {"problem": {"workspace": "square", "planner": "greedy"}})
    page.locator(".plan[aria-checked=true]", has_text="moves").wait_for()
    page.get_by_role("button", name="Play", exact=True).click()
    until(
        page,
        "document.querySelector('.panel:not([hidden]) iframe:not([hidden])')?.contentWindow"
        ".shoalPlayer?.time > 0",
    )


def test_a_sweep_is_run_by_keys_alone(page: Page, studio: Studio) -> None:
    studio.open(page, "lab", {"tab": "new", "toml": as_toml(small("keys", trials=2))})
    page.get_by_text("2 points, 4 trials").wait_for()
    tab_to(page, "Run the sweep")
    page.keyboard.press("Enter")
    complete(page, "keys")


def test_a_sweep_stays_chosen_when_an_answer_is_older_than_its_run(
    page: Page, studio: Studio, mazes: str
) -> None:
    studio.open(page, "lab", {"tab": "new", "toml": as_toml(small("late", trials=1))})
    page.get_by_text("2 points, 2 trials").wait_for()
    before = page.evaluate("""fetch("/api/ask/sweeps", {
        method: "POST", headers: {"content-type": "application/json"}, body: "{}"
    }).then((answer) => answer.text())""")
    held: list[Route] = []
    page.route("**/api/ask/sweeps", lambda route: held.append(route), times=1)  # noqa: PLW0108 - its argument is inspected
    page.get_by_role("button", name="Run the sweep").click()
    while not held:
        page.wait_for_timeout(20)
    until(page, "document.querySelector('#busy').hidden")  # the run has ended
    held[0].fulfill(body=before, content_type="application/json")
    complete(page, "late")


AXE = (Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text()
STATES: dict[str, tuple[str, dict[str, Any], str]] = {
    "vessels": (
        "vessels",
        {"problem": {"map": "maze:9x7", "particles": 3}, "seed": 0},
        ".underStage .facts:has-text('free')",
    ),
    "steering": ("steering", {}, ".reach >> nth=0"),
    "search": ("search", {}, ".fleet .soft:has-text('at')"),
    "sweeps": ("lab", {"store": "mazes.sqlite", "sweep": "mazes"}, ".verdict"),
    "new sweep": ("lab", {"tab": "new"}, ".drafting [role=status]:has-text('trials')"),
    "episodes": ("lab", {"tab": "episodes"}, ".card img >> nth=0"),
    "papers": ("papers", {}, ".paper >> nth=0"),
}


@pytest.mark.parametrize("state", STATES)
def test_pages_have_no_serious_fault_in_four_forms(
    studio_page: Page, studio: Studio, mazes: str, state: str
) -> None:
    """Axe finds none, of the frames inside neither, and a narrow page scrolls one way only."""
    page, (place, given, there) = studio_page, STATES[state]
    studio.open(page, place, given)
    page.wait_for_selector(there, state="attached")
    for frame in page.frames:
        frame.evaluate(AXE)
    for theme, width, height in FORMS:
        wear(page, theme, width, height)
        # Of all rules, those of contrast alone depend on the theme.
        rules = {} if theme == "light" else {"runOnly": ["color-contrast", "link-in-text-block"]}
        found = page.evaluate(
            "rules => axe.run(document, {resultTypes: ['violations'], ...rules})", rules
        )["violations"]
        faults = [
            f"{one['id']}: {one['nodes'][0]['target']}"
            for one in found
            if one["impact"] in ("serious", "critical")
        ]
        assert faults == [], (theme, width)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert (
            page.evaluate(
                "document.querySelector('nav a:last-child').getBoundingClientRect().right"
            )
            <= width
        )
        assert (
            page.evaluate("document.querySelector('main').firstElementChild.scrollWidth") <= width
        )
