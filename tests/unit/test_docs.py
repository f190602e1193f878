"""The documentation is true: its commands run, its links lead somewhere, its generated page is
fresh.

The `>>>` examples of all pages are collected by pytest itself (--doctest-glob).
"""

from __future__ import annotations

import importlib.util
import itertools
import json
import pydoc
import re
import runpy
import shlex
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from docs.make_house_image import words
from markdown.extensions.toc import slugify
from matplotlib.figure import Figure
from PIL import Image

import shoal
import shoal.envs
import shoal.lab
import shoal.search
import shoal.steering
import shoal.swarm
import shoal.views
from shoal.cli import run
from shoal.cli.commands import COMMANDS, command
from shoal.lab import workers as worker_pools
from shoal.missions import FORMATS
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.tours import TOURS
from shoal.steering import PLANNERS
from shoal.steering.planners import annealing, pressing, sampling
from shoal.swarm import POLICIES, GridWorkspace, GridWorld
from shoal.views.drawing import stage
from shoal.views.drawing.encoding import LONGEST

ROOT = Path(__file__).parents[2]
PAGES = sorted([*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])
TO_RUN = [page for page in PAGES if re.search("^(```console|<!-- runs:)", page.read_text(), re.M)]
LONGEST_PAGE = 1500  # words without a picture or a table
PACKAGES = [shoal, shoal.envs, shoal.lab, shoal.search, shoal.steering, shoal.swarm, shoal.views]


def commands_of(text: str) -> list[tuple[str, int]]:
    """Return the commands of a page and their exit codes: 0, unless a comment before them (<!-- exit
    code: 1 -->) says another.
    """
    blocks = re.findall(r"(?:<!-- exit code: (\d+) -->\n)?```console\n(.*?)```", text, re.S)
    return [
        (line[2:], int(code or 0))
        for code, block in blocks
        for line in block.splitlines()
        if line.startswith("$ ")
    ]


def output_lines_of(text: str) -> list[str]:
    """Return the lines that a page shows of what its commands print: a label, two spaces or more,
    and a value.
    """
    blocks = re.findall(r"```text\n(.*?)```", text, re.S)
    return [
        line
        for block in blocks
        for line in block.splitlines()
        if re.match(r"[a-z]+ {2,}[^ #]", line)
    ]


def write_files_of(text: str) -> list[str]:
    """Write what a page asks its reader to have.

    That is files it shows (title="NAME"), sweeps with three trials, photographs (<!-- needs: NAME -->) and what a script
    makes (<!-- runs: NAME -->).
    """
    shown = re.findall(r'```python title="(\w+)\.py"\n(.*?)```', text, re.S)
    for name, content in shown:
        Path(f"{name}.py").write_text(content)
    for name, content in re.findall(r'```toml title="(\w+\.toml)"\n(.*?)```', text, re.S):
        Path(name).write_text(re.sub(r"^trials = \d+", "trials = 3", content, flags=re.M))
    for name, content in re.findall(r'```text title="(\w+\.(?:asc|csv))"\n(.*?)```', text, re.S):
        Path(name).write_text(content)
    for name, content in re.findall(r'```json title="(\w+\.json)"\n(.*?)```', text, re.S):
        Path(name).write_text(content)
    for script in re.findall(r"<!-- runs: (\S+) -->", text):
        runpy.run_path(script)
    for photograph in re.findall(r"<!-- needs: (\S+) -->", text):
        data = pytest.importorskip("skimage.data")  # an extra
        from PIL import Image

        Image.fromarray(data.retina()).resize((160, 160)).save(photograph)
    return [name for name, _ in shown]


@pytest.fixture
def in_short(monkeypatch, tmp_path):
    """Let commands run in a folder of their own, films have few frames, figures few pixels,
    sweeps no processes, and plans of particles few changes. See also `run_in_short`.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(mpl.rcParams, "savefig.dpi", 50)
    for suffix in LONGEST:
        monkeypatch.setitem(LONGEST, suffix, 10)
    monkeypatch.setattr(worker_pools, "Processes", lambda _: worker_pools.InProcess())
    for name, size in stage.SIZES.items():
        monkeypatch.setitem(stage.SIZES, name, (size[0] // 2, size[1] // 2))
    monkeypatch.setattr(pressing, "CHANGES", 80)
    monkeypatch.setattr(pressing, "ROUNDS", 6_000)
    monkeypatch.setattr(sampling, "MORE_TREES", 3)
    monkeypatch.setattr(annealing, "STAGES", ((4, 500), (2, 2000)))


def run_in_short(line):
    """Run a command with three trials at most. Only commands that are there for figures draw them:
    the figures beside an episode are drawn in tests/unit/views.
    """
    name, *arguments = shlex.split(re.sub(r"--trials \d+", "--trials 3", line))
    assert name == "shoal"
    with pytest.MonkeyPatch.context() as patch:
        if arguments[0] not in ("figure", "reproduce"):
            patch.setattr(Figure, "savefig", lambda _figure, path, **_options: path.touch())
        return run(arguments)


@pytest.mark.usefixtures("in_short")
@pytest.mark.parametrize("page", TO_RUN, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_scripts_of_a_page_run(page, tmp_path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(tmp_path)
    for module in write_files_of(page.read_text()):
        monkeypatch.delitem(sys.modules, module, raising=False)
    printed = ""
    for line, expected in commands_of(page.read_text()):
        code = run_in_short(line)
        output = capsys.readouterr()
        assert code == expected, f"{line}: {output.err}"
        printed += output.out
    assert [line for line in output_lines_of(page.read_text()) if line not in printed] == []


@pytest.mark.usefixtures("in_short")
def test_examples_of_help_run():
    """Each command's --help ends with an example. That of demo is what `make demo` runs: it takes
    ten seconds.

    That of studio serves until somebody ends it: tests/browser/test_studio.py runs it. Those of
    missions start, watch and flown, and that of rehearse, need vehicles: tests/unit/robots has some.
    """
    # what replay's example replays
    assert run(["map", "maze:9x7", "-n", "3", "--out", "result"]) == 0
    write_files_of((ROOT / "docs" / "concepts" / "steering.md").read_text())  # steer's problem.json
    write_files_of((ROOT / "docs" / "how-to" / "sweeps.md").read_text())  # sweep run's sweep.toml
    # the search that robot's example is prepared for
    assert run(["search", "square:30", "--robots", "2", "--prepare", "field"]) == 0
    # the missions that missions check looks over
    write_files_of((ROOT / "docs" / "concepts" / "missions.md").read_text())
    for name in COMMANDS:
        example = command(name).epilog.removeprefix("Example: ")
        assert f"{example} ".startswith(f"shoal {name} ")
        if name not in (
            "demo",
            "studio",
            "rehearse",
            *(f"missions {verb}" for verb in ("start", "watch", "flown")),
        ):
            assert run_in_short(example) == 0, example


def test_reference_pages_are_fresh():
    spec = importlib.util.spec_from_file_location(
        "generate_reference", ROOT / "docs" / "generate_reference.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, made in module.PAGES.items():
        assert made() == (module.TARGET / name).read_text(), (
            "run: python docs/generate_reference.py"
        )


def test_the_page_of_the_package_lists_its_names():
    listed = re.findall(r"^\| `(\w+)`", (ROOT / "docs" / "api" / "shoal.md").read_text(), re.M)
    assert sorted(listed) == sorted(shoal.__all__)


def test_the_first_page_leads_to_every_other():
    pages = set(re.findall(r": (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.M))
    assert pages == {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    linked = set(re.findall(r"\]\((\S+\.md)\)", (ROOT / "docs" / "index.md").read_text()))
    assert {page for page in pages if not page.startswith("adr/")} - linked == {"index.md"}


def test_library_pages_tell_how_to_read_descriptions_in_a_checkout():
    for page in (ROOT / "docs/api").glob("*.md"):
        text = page.read_text()
        if listed := re.search(r"^::: (\S+)", text, re.M):
            assert f'help("{listed[1]}")' in text, page.name
            assert "`make docs`" in text, page.name


def test_library_pages_cover_what_packages_offer():
    directives = re.findall(
        r"^::: (shoal\.\S+)",
        "\n".join(page.read_text() for page in (ROOT / "docs/api").glob("*.md")),
        re.M,
    )
    for directive in directives:
        assert pydoc.locate(directive) is not None, (
            f"docs/api names {directive}, which is not there"
        )
    for package in PACKAGES:
        for name in package.__all__:
            home = getattr(getattr(package, name), "__module__", None)
            covered = home is None or any(
                f"{home}.{name}.".startswith(f"{directive}.") for directive in directives
            )
            assert covered, f"docs/api has nothing of {home}.{name}"


def test_contributors_find_the_files_and_names_of_the_tables():
    rows = re.findall(r"^\|.*\|$", (ROOT / "CONTRIBUTING.md").read_text(), re.M)
    paths = [path for row in rows for path in re.findall(r"`((?:\w+/)+[\w.]*)`", row)]
    assert len(paths) > 40
    for path in paths:
        assert found_in_tree(path).exists(), path
    places = re.findall(r"`(\w+)` (?:in|of) `((?:\w+/)+\w+\.\w+)`", "\n".join(rows))
    assert len(places) > 20
    for name, path in places:
        defined = rf"^\s*(?:(?:def|class|const) )?{name}(?: = |: .* = |\(|:|\.| \{{)"
        assert re.search(defined, found_in_tree(path).read_text(), re.M), f"{path} has no {name}"


def found_in_tree(path: str) -> Path:
    return ROOT / path if (ROOT / path).exists() else ROOT / "src/shoal" / path


def test_the_picture_of_the_layers_is_new():
    with Image.open(ROOT / "docs/images/house.png") as picture:
        assert json.loads(picture.text["layers"]) == words(), "run: python docs/make_house_image.py"


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("concepts/policies.md", POLICIES),
        ("concepts/tours.md", TOURS),
        ("concepts/allocation.md", ALLOCATORS),
        ("concepts/steering/planners.md", PLANNERS),
        ("concepts/missions.md", FORMATS),
    ],
)
def test_tables_list_all_names_of_a_registry(page, names):
    text = (ROOT / "docs" / page).read_text()
    firsts = re.findall(r"^\| (`[^|]*) \|", text, re.M)
    listed = {name for first in firsts for name in re.findall(r"`([\w-]+)", first)}
    assert {*names} - listed == set(), f"a table of docs/{page} needs a row for each of these"


def prose_of(page: Path) -> str:
    return re.sub(r"```.*?```", "", page.read_text(), flags=re.S)


def headings_of(page: Path) -> set[str]:
    return {slugify(heading, "-") for heading in re.findall(r"^#+ (.+)$", prose_of(page), re.M)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_are_built_as_readers_expect(page):
    """One title, no heading that skips a level, a text for each picture, and no long page without a
    picture or a table.
    """
    prose = prose_of(page)
    levels = [len(marks) for marks in re.findall(r"^(#+) ", prose, re.M)]
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels)), (
        "a heading skips a level"
    )
    assert all(len(text.split()) > 1 for text in re.findall(r"!\[(.*?)\]\(", prose, re.S)), (
        "a picture without a text"
    )
    assert len(prose.split()) <= LONGEST_PAGE or "![" in prose or "\n|---" in prose, (
        "a long page without a picture or a table"
    )


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    assert "://" not in page.read_text(), f"{page.name} names the network"
    for target, anchor in re.findall(r"\]\(([^)#]*)#?([^)]*)\)", page.read_text()):
        file = page.parent / target if target else page
        assert file.exists(), f"{page.name}: no {target}"
        assert not anchor or anchor in headings_of(file), (
            f"{page.name}: no heading {anchor} in {file.name}"
        )


def test_text_pictures_of_the_move_rules_are_what_the_world_does():
    rule, command, checked = "", "", 0
    for line in (ROOT / "docs/concepts/world.md").read_text().splitlines():
        rule = next(iter(re.findall(r"^\*\*(\w+)\*\*", line)), rule)
        command = next(iter(re.findall(r"After `(\w)`", line)), command)
        pictures = (
            re.findall(r"(?<=\s)[.o\d]+(?=\s|$)", line)
            if "->" in line and line.startswith("    ")
            else []
        )
        for before, after in itertools.pairwise(pictures):
            world = GridWorld(GridWorkspace(np.ones((1, len(before)))), rule)
            moved = world.step(world.initial(particles_of(before)), command)
            assert moved.cells.tolist() == particles_of(after), f"{rule}: {line.strip()}"
            checked += 1
    assert checked == 6


def particles_of(picture: str) -> list[list[int]]:
    """Return a cell for each particle: o is one, a digit so many, a dot none."""
    digits = picture.replace(".", "0").replace("o", "1")
    return [[0, column] for column, count in enumerate(digits) for _ in range(int(count))]


def test_page_of_files_describes_an_episode_file(tmp_path):
    text = (ROOT / "docs/concepts/files.md").read_text()
    described = dict(re.findall(r"^\| `(\w+)` \| (\w+)", text, re.M))
    shoal.run(shoal.open_map("line:3"), particles=1, task="coverage").save(tmp_path / "episode.npz")
    with np.load(tmp_path / "episode.npz") as archive:
        assert {name: str(archive[name].dtype) for name in archive.files} == described
        header = archive["header"].tobytes().decode()
    for field in re.findall(r'"(\w+)":', header):
        assert re.search(rf"\b{field}\b|map name", text), (
            f"docs/concepts/files.md does not name the field {field}"
        )


def test_programs_of_the_repository_have_a_help():
    """One of them took --help as the name of a folder, others began their work."""
    programs = [path for name in ("docs", "benchmarks") for path in (ROOT / name).rglob("*.py")]
    texts = {path: path.read_text() for path in programs}
    assert [
        path
        for path, text in texts.items()
        if '__name__ == "__main__"' in text and "ArgumentParser(" not in text
    ] == []
