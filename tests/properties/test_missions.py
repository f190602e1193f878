"""Any mission survives its files; merging and splitting keep the way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.missions import missions_of
from tests.reference.missions import READERS, distance_to_way
from tests.soak import often

from shoal.core.errors import InvalidInputError
from shoal.missions import FORMATS, Mission, lint, read_mission, write_missions
from shoal.search import LocalFrame
from shoal.search.flight.legs import merge_straight_legs
from shoal.search.flight.vehicle import Vehicle

PLACES = st.tuples(st.floats(-180, 180), st.floats(-85, 85))


@st.composite
def missions(draw, geographic=True):
    east, north = draw(st.floats(-179, 179)), draw(st.floats(-84, 84))
    near = st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)).map(
        lambda step: (east + step[0], north + step[1])
    )
    kind = draw(st.sampled_from(["multirotor", "fixed-wing", "rover"]))
    return Mission(
        draw(st.lists(near, min_size=1, max_size=12)),
        draw(near),
        robot=draw(st.integers(1, 300)),
        sortie=draw(st.integers(1, 30)),
        kind=kind,
        autopilot=draw(st.sampled_from(["px4", "ardupilot"])),
        altitude=0.0 if kind == "rover" else draw(st.floats(1, 500)),
        speed=draw(st.floats(0.1, 50)),
        geographic=geographic,
    )


@settings(max_examples=40)
@given(missions())
def test_every_format_keeps_a_mission(tmp_path_factory, mission):
    folder = tmp_path_factory.getbasetemp() / "kept"
    paths = write_missions([mission], folder)
    assert {path.suffix for path in paths} == set(READERS)
    for path in paths:
        home, points = READERS[path.suffix](path)
        assert np.abs(np.asarray(points) - mission.waypoints).max() <= 1e-8
        assert np.abs(np.asarray(home) - mission.home).max() <= 1e-8
        ours = read_mission(path)
        assert np.array_equal(ours.waypoints, np.asarray(points))
        assert ours.home == tuple(home)
        assert (ours.name, ours.kind, ours.geographic) == (mission.name, mission.kind, True)
        assert (ours.speed, ours.altitude) == pytest.approx(
            (mission.speed, mission.altitude), abs=1e-8
        )
        # which does not say
        assert ours.autopilot == mission.autopilot or path.suffix == ".waypoints"
    assert not {diagnostic.rule for diagnostic in lint(folder) if diagnostic.severity == "error"}


@given(missions(geographic=False))
def test_metres_keep_in_csv(tmp_path_factory, mission):
    (path,) = write_missions([mission], tmp_path_factory.getbasetemp() / "metres")
    read = read_mission(path)
    assert not read.geographic
    assert np.abs(read.waypoints - mission.waypoints).max() <= 1e-8


@st.composite
def ways(draw):
    """A way with straight runs, noise, repeats and turns back."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    corners = rng.integers(-20, 21, (draw(st.integers(1, 9)), 2)) * draw(
        st.sampled_from([1.0, 10.0, 9.7])
    )
    runs = [
        np.linspace(one, two, int(rng.integers(1, 8)), endpoint=False)
        for one, two in pairwise(corners)
    ]
    way = np.vstack([*runs, corners[-1:]])
    return way + rng.normal(0, draw(st.sampled_from([0.0, 1e-10, 1e-4, 0.1])), way.shape)


@settings(max_examples=150)
@given(ways(), st.sampled_from([0.0, 0.001, 0.5]))
def test_merging_keeps_the_way(way, tolerance):
    fewer = merge_straight_legs(way, tolerance)
    assert np.array_equal(fewer[0], way[0])
    assert np.array_equal(fewer[-1], way[-1]) or len(np.unique(way, axis=0)) == 1
    assert distance_to_way(way, fewer) <= tolerance + 1e-9
    assert distance_to_way(fewer, way) <= 1e-9
    # Some of the points, in their order; what lies between two of them is passed by the leg between
    # these two, without a turn back.
    places, begin = [], 0
    for point in fewer:
        begin += int(np.argmax((way[begin:] == point).all(axis=1)))
        assert np.array_equal(way[begin], point)
        places.append(begin)
    for one, two in pairwise(places):
        assert distance_to_way(way[one : two + 1], way[[one, two]]) <= tolerance + 1e-9
        along = np.hypot(*(way[one : two + 1] - way[one]).T)
        assert (np.diff(along) >= -1e-9).all()


@settings(max_examples=often(60, 150))
@given(ways(), st.integers(5, 12), st.floats(20, 3000), st.booleans())
def test_splitting_keeps_the_way_and_its_limits(way, cap, limit, fly):
    home = way[0] + (3.0, -4.0)
    reach = 2 * np.hypot(*(way - home).T).max()
    vehicle = Vehicle(
        preset="ideal" if fly else "rover", turn_time=0.0, endurance=limit / 60, reserve=0.0
    )
    call = {"home": home, "vehicle": vehicle, "cap": cap + fly, "tolerance": 0.0}
    try:
        parts = missions_of(way, None, **call)
    except InvalidInputError:
        assert limit < reach + 1, "every point can be reached"
        return
    for part in parts:
        assert part.n_items <= cap + fly
        assert part.length <= limit * (1 + 1e-9)
        assert part.home == tuple(home)
    assert [part.sortie for part in parts] == list(range(1, len(parts) + 1))
    for one, two in pairwise(parts):
        assert np.array_equal(one.waypoints[-1], two.waypoints[0])
    joined = np.vstack([parts[0].waypoints, *(part.waypoints[1:] for part in parts[1:])])
    whole = merge_straight_legs(way, 0.0)
    assert np.hypot(*np.diff(joined, axis=0).T).sum() == pytest.approx(
        np.hypot(*np.diff(whole, axis=0).T).sum()
    )
    assert distance_to_way(joined, way) <= 1e-9
    kept = {tuple(point) for point in joined}
    assert all(tuple(point) in kept for point in whole)


@settings(max_examples=25)
@given(ways(), st.floats(-170, 170), st.floats(-80, 80))
def test_missions_on_earth_lie_where_the_route_does(way, longitude, latitude):
    frame = LocalFrame(longitude, latitude)
    (mission,) = missions_of(way, frame)
    # metres: the last decimal of a file's degrees, rounded in both directions
    half = 0.5e-8 * 111_700 * 2**0.5
    assert distance_to_way(frame.to_metres(mission.waypoints), way) <= half
    # a file loses nothing more
    assert np.abs(mission.waypoints - np.round(mission.waypoints, 8)).max() <= 1e-11
    assert (
        shapely.hausdorff_distance(*map(line_of, (way, frame.to_metres(mission.waypoints))))
        <= 0.0011
    )


def line_of(way):
    return shapely.linestrings(way) if len(way) > 1 else shapely.points(way[0])


GOOD = Mission([(8.5, 47.4), (8.501, 47.4), (8.501, 47.401)], (8.5, 47.4))


@settings(max_examples=200)
@given(st.sampled_from(list(FORMATS)), st.data())
def test_damaged_files_are_refused_in_one_sentence_or_read(tmp_path_factory, name, data):
    form = FORMATS.get(name)
    content = bytearray(form.write(GOOD).encode())
    for _ in range(data.draw(st.integers(1, 4))):
        low = data.draw(st.integers(0, len(content) - 1))
        content[low : low + data.draw(st.integers(0, 6))] = data.draw(
            st.one_of(
                st.binary(max_size=4),
                st.sampled_from(
                    [b"1e999", b"-", b"[", b"]", b'"', b"null", b"\n", b",", b"<", b"&", b"\t"]
                ),
            )
        )
        content = content or bytearray(b" ")
    path = tmp_path_factory.getbasetemp() / f"damaged{form.suffix}"
    path.write_bytes(bytes(content))
    diagnostics = lint(path)
    said = complaint(path)
    assert "\n" not in said
    assert not said or any(diagnostic.severity == "error" for diagnostic in diagnostics)


def complaint(path):
    """Return what is said of a file that is refused; nothing of one that is read."""
    try:
        read_mission(path)
    except InvalidInputError as error:
        return str(error)
    return ""
