"""The papers' figures: every one has a recipe, its data lie beside it, and the errata's checks show
what they say.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.core.registry import Registry
from shoal.lab import Store
from shoal.lab.statistics import Row, estimate
from shoal.papers import Recipe, Settings, Verdict, recipes, reproduce, reproduce_all
from shoal.papers.claims import claim, curve_claim, exponent, order_claim, verdict_of
from shoal.papers.mapping.curves import MAPS
from shoal.papers.recipe import counts_of, function_sweep, measuring, published_curve
from shoal.papers.steering.recipes import random_difference
from shoal.steering import regular_polygon
from shoal.views.drawing.curves import Curve, Labels, Published, frontier_curves, mean_curves

FIGURES = [
    "m-fig1",
    "m-fig3",
    "m-fig4",
    "m-theorem3",
    "m-fig5",
    "m-fig6",
    "m-theorem1",
    "m-adversary",
    "m-smartdfs",
    "m-hardness",
    "m-largest-gap",
    "d-worst-line",
    "m-bicriterion",
    *(f"m-fig{n}" for n in range(7, 12)),
]
FIGURES += [f"w-fig{n}" for n in (4, 8, 9, 14, 15, 16, 5, 6, 7, 11, 12)] + [
    "w-swap",
    *(f"w-fig{n}" for n in (2, 3, 10, 13)),
    "w-many",
    "h-fig5",
    "h-baselines",
    "h-curves",
    "h-markers",
    "h-region",
]
COMPUTED = {
    "m-theorem1",
    "m-adversary",
    "m-smartdfs",
    "m-hardness",
    "m-largest-gap",
    "d-worst-line",
    "m-bicriterion",
    *(f"w-fig{n}" for n in (2, 3, 10, 13)),
    "h-curves",
    "h-markers",
    "h-region",
}  # of which no sweep is played


def test_every_figure_with_numbers_has_a_recipe():
    assert [*recipes()] == FIGURES
    for name in FIGURES:
        recipe = recipes().get(name)
        sweeps = recipe.sweeps(Settings(quick=True, trials=3))
        assert sweeps or name in COMPUTED
        assert all(sweep.trials in {1, 3} for sweep in sweeps)
        assert len({sweep.name for sweep in sweeps}) == len(sweeps)
        for point in (point for sweep in sweeps for point in sweep.points):
            # figures of the paper are of its policies
            assert getattr(point.problem, "policy", "named") != "auto"
    with pytest.raises(UnknownNameError, match="did you mean 'm-fig7'"):
        recipes().get("m-fig77")


def test_published_curves_ship_with_the_package():
    files = [
        file
        for file in resources.files("shoal.papers").joinpath("published").iterdir()
        if file.name != "complex.csv"
    ]
    assert len(files) == 5
    for file in files:
        curve = published_curve(file.name)
        assert curve.x.tolist() == [*range(100, 5001, 100)]
        # with a particle in every cell
        last = 2 if file.name.startswith("line") else 1 if "subset" in file.name else 4
        assert (curve.mean[-1], curve.std[-1]) == (last, 0)
    for _, file in MAPS.values():
        curve = published_curve(file)
        assert curve.x.astype(int).tolist() == counts_of(5000)
    points = published_curve("complex.csv", points=True, task="mapping", policy="elect-particle")
    assert points.mean.tolist() == [2484, 578, 173]
    assert np.isnan(points.std).all()


def test_a_figure_its_data_and_its_summary(tmp_path):
    result = reproduce("m-fig6", tmp_path, quick=True, trials=20, workers=0)
    assert result.outcome.verdict == "differs"  # the caption's n does not hold
    assert [one.verdict for one in result.outcome.claims][1] == "differs"
    assert {path.name for path in result.files} == {
        "m-fig6.png",
        "m-fig6.csv",
        "m-fig6-2.csv",
        "m-fig6.json",
    }
    with (tmp_path / "m-fig6.csv").open() as file:
        rows = [*csv.DictReader(file)]
    assert [row["name"] for row in rows] == ["boundary", "coverage", "printed coverage"]
    assert float(rows[1]["drawn"]) == pytest.approx(float(rows[1]["exact"]), rel=0.01)
    summary = json.loads((tmp_path / "m-fig6.json").read_text())
    assert summary["sentence"] == result.outcome.sentence
    assert summary["verdict"] == "differs"
    assert {*summary["claims"][0]} == {"what", "printed", "ours", "criterion", "verdict"}
    assert summary["sweeps"][0]["trials"] == 20
    again = reproduce(
        "m-fig6", tmp_path, quick=True, trials=2, workers=0
    )  # more are stored: they are used
    assert again.outcome.sentence == result.outcome.sentence
    with Store(tmp_path / "results.sqlite") as store:
        assert store.status("m-fig6").total == 20


TRIALS = {
    "h-fig5": 3,
    "w-many": 1,
    "h-baselines": None,
    "h-markers": None,
    "w-fig7": None,
}  # others: 8


@pytest.mark.parametrize(
    ("name", "answers"),
    [
        ("m-fig1", "nna"),
        ("m-fig3", "aaa"),
        ("m-fig4", "an"),
        ("m-theorem1", "aaaad"),
        ("m-adversary", "aaaaa"),
        ("m-smartdfs", "aaaa"),
        ("m-hardness", "an"),
        ("m-largest-gap", "dndn"),
        ("d-worst-line", "aaa"),
        ("m-bicriterion", "anan"),
        ("m-theorem3", "aaaad"),
        ("m-fig6", "adda"),
        ("w-fig5", "aaa"),
        ("w-fig6", "aa"),
        ("w-fig7", "ada"),
        ("w-fig11", "aad"),
        ("w-fig12", "aaaa"),
        ("w-fig2", "aaa"),
        ("w-fig3", "aaaa"),
        ("w-fig10", "aaa"),
        ("w-fig13", "aaaaaa"),
        ("w-many", "aanaaaan"),
        ("w-swap", "add"),
        ("h-fig5", "nn"),
        ("h-baselines", "aaaaaa"),
        ("h-curves", "aaan"),
        ("h-markers", "aad"),
        ("h-region", "aa"),
    ],
)
def test_figures_theorems_and_instances_have_their_answers(name, answers, tmp_path):
    """By --quick, as a user would first look; a, d, n: agrees, differs, not comparable."""
    result = reproduce(
        name,
        tmp_path,
        quick=True,
        trials=TRIALS.get(name, 8),
        workers=0,
    )
    assert "".join(one.verdict[0] for one in result.outcome.claims) == answers
    assert all(one.criterion and one.printed and one.ours for one in result.outcome.claims)
    assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    assert (tmp_path / f"{name}.csv").read_text().count("\n") > 1


@pytest.mark.parametrize("name", ["m-fig8", "m-fig9", "m-fig10", "m-fig11"])
def test_figures_on_a_map_of_ones_own(name, tmp_path):
    picture = tmp_path / "own.txt"
    picture.write_text("..........\n.#..##.#..\n....#.....\n.##...###.\n..........\n")
    result = reproduce(name, tmp_path / "out", trials=2, on_map=str(picture), workers=0)
    assert str(picture) in result.outcome.sentence
    unlike = [one for one in result.outcome.claims if one.criterion.startswith("another map")]
    # nobody prints numbers of this map
    assert {one.verdict for one in unlike} <= {"not comparable"}
    assert unlike or name in {"m-fig9", "m-fig10", "m-fig11"}  # whose numbers are of more particles
    assert (tmp_path / "out" / f"{name}.png").stat().st_size > 10_000
    assert all(path.exists() for path in result.files)


@pytest.mark.parametrize(
    ("ours", "verdict"),
    [
        (9.7, "agrees"),
        (10.7, "differs"),
        ((9.9, 9.6, 10.2), "agrees"),
        ((10.4, 9.8, 11.0), "not comparable"),
    ],
)
def test_a_claim_agrees_differs_or_cannot_be_compared(ours, verdict):
    found = claim("moves", "10", ours)
    assert found.verdict == verdict
    assert "9.5 to 10.5" in found.criterion
    assert claim("moves", "10", ours, unlike="another map").verdict == "not comparable"
    # of one trial nothing is known
    assert claim("moves", "10", estimate([10.0])).verdict == "not comparable"


def test_a_figure_differs_if_one_claim_does():
    good, bad, open_ = (
        claim("", "1", value, unlike=unlike)
        for value, unlike in ((1, ""), (2, ""), (1, "another map"))
    )
    assert verdict_of([good, open_]) == Verdict.AGREES
    assert verdict_of([good, bad, open_]) == Verdict.DIFFERS
    assert verdict_of([open_]) == verdict_of([]) == Verdict.NOT_COMPARABLE


@pytest.mark.parametrize(
    ("factor", "at_700", "spread", "verdict"),
    [
        (1.05, 1.05, 0.01, "agrees"),
        (1.05, 1.9, 0.01, "differs"),
        (1.2, 1.2, 0.01, "differs"),
        (1.05, 1.05, 4.0, "not comparable"),
    ],
)
def test_a_curve_is_refuted_by_one_n_and_by_all_together(factor, at_700, spread, verdict):
    """That ours agree is measured by ``shoal reproduce m-fig7``, and at five n a map by
    tests/golden.
    """
    published = published_curve(MAPS["htree:5000"][1])
    rows = []
    for n, mean in zip(published.x.astype(int).tolist(), published.mean.tolist(), strict=True):
        middle = mean * (at_700 if n == 700 else factor)
        rows.append(
            Row({"particles": n}, estimate([middle * (1 - spread), middle * (1 + spread)]), 0, 2)
        )
    found = curve_claim("H-tree", rows, published, trials=10, margin=0.15, why="")
    assert found.verdict == verdict
    assert ("at n = 700" in found.ours) == (at_700 != factor)


def test_an_order_needs_most_n_and_a_power_its_interval():
    low, high = (
        {n: estimate([n * f * 0.99, n * f * 1.01] * 5) for n in range(1, 21)} for f in (1, 2)
    )
    assert order_claim("", "fewer", low, high).verdict == "agrees"
    assert order_claim("", "fewer", high, low).verdict == "differs"
    mixed, others = (
        {n: (a if n > 2 else b)[n] for n in low} for a, b in ((low, high), (high, low))
    )
    assert order_claim("", "fewer", mixed, others).verdict == "differs"  # at two n of twenty
    assert exponent([1, 2, 4, 8], [3, 12, 48, 192]) == pytest.approx((2, 2, 2))


@measuring("value")
def failing(*, seed: int, at: int) -> dict[str, int]:
    if at == 2:
        raise ValueError("the second point")
    return {"value": at}


@pytest.mark.parametrize("sides", [3, 4, 8])
def test_random_starts_are_differences_of_two_points(sides):
    """Of lengths uniform in 0.1 to 0.8 some lay outside the differences of a triangle, and the
    trial failed.
    """
    workspace, rng = regular_polygon(sides), np.random.default_rng(0)
    starts = np.array([random_difference(rng, workspace) for _ in range(500)])
    assert workspace.differences.contains(starts).all()
    assert np.hypot(*starts.T).min() < 0.1


def test_one_figure_that_fails_takes_no_other_along(tmp_path, monkeypatch, capsys):
    def broken(store, sweeps, settings):
        raise RuntimeError("no such drawing")

    good = recipes().get("w-fig9")
    some: Registry[Recipe] = Registry("figure")

    def trials(settings):
        return [function_sweep("bad", failing, {"at": [1, 2]}, 1, settings)]

    some.add("bad", Recipe("bad", "paper W, Fig. 0", "Its trials fail", trials, broken))
    some.add("worse", Recipe("worse", "paper W, Fig. 0", "Its view fails", lambda s: [], broken))
    some.add("w-fig9", good)
    module = sys.modules["shoal.papers.reproduce"]  # the name in the package is the function
    monkeypatch.setattr(module, "recipes", lambda: some)
    monkeypatch.setattr(module, "check_errata", list)
    assert command(["reproduce", "--all", "--workers", "0", "--out", str(tmp_path), "--json"]) == 1
    captured = capsys.readouterr()
    bad, worse, fine = json.loads(captured.out)["figures"]
    assert (
        "1 of 2 failed, the first at at = 2, trial 0: ValueError: the second point" in bad["error"]
    )
    assert worse["error"] == "RuntimeError: no such drawing"
    assert (bad["verdict"], fine["verdict"], fine["error"]) == (None, "agrees", None)
    assert "could not reproduce bad: " in captured.err
    page = (tmp_path / "index.html").read_text()
    assert page.count("This figure could not be made: ") == 2
    assert "data:image/png;base64," in page
    with pytest.raises(InvalidInputError, match="nothing-here"):
        reproduce_all(tmp_path, on_map="nothing-here.png")


def test_refusals(tmp_path):
    with pytest.raises(
        InvalidInputError, match="expected a figure that is computed on the complex map, got w-fig8"
    ):
        reproduce("w-fig8", tmp_path, on_map="maze:9x7")
    with pytest.raises(
        InvalidInputError, match="trials: expected a whole number, 1 or more, got 0"
    ):
        reproduce("h-fig5", tmp_path, trials=0)
    assert command(["reproduce", "h-fig5", "--all"]) == 2
    assert command(["reproduce", "nothing", "--out", str(tmp_path)]) == 2


def test_command(tmp_path, capsys):
    assert command(["reproduce", "--json"]) == 0
    assert [figure["name"] for figure in json.loads(capsys.readouterr().out)["figures"]] == FIGURES
    assert command(["reproduce", "w-fig9", "--workers", "0", "--out", str(tmp_path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["figures"][0]["verdict"] == "agrees"
    assert result["figures"][0]["claims"][0]["printed"] == "6.3"
    assert [Path(file).name for file in result["figures"][0]["files"]] == [
        "w-fig9.png",
        "w-fig9.csv",
        "w-fig9-2.csv",
        "w-fig9.json",
    ]


def test_curves_and_frontiers_of_nothing_are_refused():
    with pytest.raises(InvalidInputError, match="at least one curve, got none"):
        mean_curves([], Labels("", "", ""))
    with pytest.raises(InvalidInputError, match="at least one trial per group"):
        frontier_curves({"a": []}, title="")


def test_published_curves_lie_behind_ours():
    x = np.array([1.0, 2, 3])
    curve = Curve("ours", x, x, x - 0.1, x + 0.1, Published(x, 2 * x, x / 5))
    axes = mean_curves([curve], Labels("title", "n", "moves")).axes[0]
    orders = {
        tuple(line.get_ydata()): line.get_zorder() for line in axes.lines if len(line.get_xdata())
    }
    assert orders[tuple(2 * x)] < orders[tuple(x)]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "ours",
        "95 % interval of the mean",
        "published",
        "± one standard deviation",
    ]


def test_the_benchmark_of_published_means_needs_no_tools_of_developers():
    """The README names it; ``make install`` installs no pytest."""
    tools = ("pytest", "hypothesis", "tests")
    hidden = f"import sys; sys.modules.update(dict.fromkeys({tools}));"
    subprocess.run(
        [sys.executable, "-c", f"{hidden} import benchmarks.published"],
        check=True,
        cwd=Path(__file__).parents[3],
    )
