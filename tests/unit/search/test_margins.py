"""Margins: ways keep them, and all that can be seen from inside of them is seen, as judged by
Shapely alone.
"""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
import shapely

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.search.problem import SearchProblem
from shoal.search.regions.margin import with_default_margin, with_margin
from shoal.search.regions.region import region_of
from shoal.search.run import run

FIELD = shapely.Polygon([(0, 0), (200, 20), (230, 120), (120, 180), (20, 130)])
ZONE = shapely.Polygon([(90, 60), (130, 70), (110, 100)])


def visible(area, margin, footprint, angle):
    """Return what squares see whose centres are so far inside: the centres' area, swept along its
    border.
    """
    free = area.buffer(-margin, quad_segs=32)
    way = np.radians(angle + np.array([45.0, 135.0, 225.0, 315.0]))
    square = footprint / np.sqrt(2) * np.stack([np.cos(way), np.sin(way)], axis=1)
    seen = [free]
    for ring in shapely.get_rings(shapely.get_parts(free)):
        points = shapely.get_coordinates(ring)
        ends = pairwise(points)
        seen += [
            shapely.convex_hull(shapely.multipoints(np.vstack([one + square, other + square])))
            for one, other in ends
        ]
    return shapely.intersection(shapely.union_all(seen), area)


@pytest.mark.parametrize(
    ("margin", "footprint", "tour", "angle"),
    [
        (4, 20, "spanning-tree", 0.0),
        (10, 20, "boustrophedon", 30.0),
        (14, 20, "boustrophedon", 0.0),
    ],
)
def test_ways_keep_the_margin_and_see_all_that_can_be_seen(margin, footprint, tour, angle):
    region = region_of(FIELD, no_go=ZONE)
    problem = SearchProblem(
        region, robots=2, footprint=footprint, margin=margin, tour=tour, angle=angle, simulate=False
    )
    episode = run(problem, seed=1)
    ways = shapely.union_all([shapely.linestrings(route.points) for route in episode.routes])
    assert shapely.distance(ways, region.area.boundary) > margin * (1 - 1e-3)
    assert shapely.distance(ways, ZONE) > margin * (1 - 1e-3)
    legs = shapely.linestrings(
        np.concatenate(
            [np.stack([way.points[:-1], way.points[1:]], axis=1) for way in episode.routes]
        )
    )
    half = footprint / 2
    turned = shapely.affinity.rotate(shapely.geometrycollections(legs), -angle, origin=(0, 0))
    square = shapely.get_coordinates(shapely.box(-half, -half, half, half))[:4]
    swept = [
        shapely.convex_hull(
            shapely.multipoints((shapely.get_coordinates(leg)[:, None] + square).reshape(-1, 2))
        )
        for leg in shapely.get_parts(turned)
    ]
    could = shapely.affinity.rotate(
        visible(region.area, margin, footprint, angle), -angle, origin=(0, 0)
    )
    assert could.difference(shapely.union_all(swept)).area < 1e-6 * could.area
    told = episode.report()["region"]
    assert told["margin_m"] == margin
    assert told["unseen_m2"] == pytest.approx(
        region.area_m2 - could.area, abs=1e-3 * region.area_m2
    )


def test_a_region_that_falls_apart_under_the_margin_is_refused_in_one_sentence_or_searched_in_parts():
    region = region_of(
        shapely.union_all(
            [shapely.box(0, 0, 60, 60), shapely.box(60, 25, 80, 35), shapely.box(80, 0, 140, 60)]
        )
    )
    problem = SearchProblem(region, robots=2, footprint=20, margin=8, simulate=False)
    with pytest.raises(InvalidInputError, match="with a margin of 8 m: expected one part"):
        run(problem)
    episode = run(problem.replaced(transit=True), seed=2)
    assert len(episode.plan.grid.region.parts) == 2
    assert episode.coverage.uncovered_m2 < 1e-6
    with pytest.raises(
        InvalidInputError, match="margin: expected a margin that leaves some area of the region"
    ):
        with_margin(region, 40)


def test_a_speck_that_vanishes_does_not_hide_that_the_margin_divides_the_rest():
    rooms = shapely.union_all(
        [shapely.box(0, 0, 50, 50), shapely.box(54, 0, 104, 50), shapely.box(50, 20, 54, 24)]
    )
    speck = shapely.box(104.5, 0, 105, 0.5)
    region = region_of(shapely.union_all([rooms, speck]))
    kept = with_default_margin(region, 3.0, footprint=20.0)
    assert (kept.margin, len(kept.parts)) == (1.5, 1)  # the corridor is 4 m wide


def test_the_check_of_missions_measures_what_a_margin_lets_be_seen(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ring = [
        [8.5, 47.4],
        [8.504, 47.4],
        [8.504, 47.402],
        [8.502, 47.4005],
        [8.5, 47.402],
        [8.5, 47.4],
    ]
    (tmp_path / "field.json").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))

    def told(line):
        command([*line.split(), "--json"])
        return json.loads(capsys.readouterr().out)

    planned = told(
        "search field.json --robots 2 --footprint 20 --margin 5 --missions m --format plan"
    )["region"]
    seen = told("missions check m field.json --footprint 20 --margin 5")
    assert seen["covered_fraction"] > 0.9999
    assert seen["outside_m"] == 0
    # the rows are narrower than the footprint, as a reserve for errors
    assert 0 < seen["unseen_m2"] < planned["unseen_m2"]
    assert seen["unseen_m2"] > 1
    assert told("missions check m field.json --footprint 20 --margin 6")["outside_m"] > 1
