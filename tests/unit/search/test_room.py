"""Where a fixed wing has room: its departure keeps clear of zones, and what cannot be flown is
refused once for all paths that contain it.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from shoal.search.flight import dubins
from shoal.search.flight.dubins import Airspace, NoRoomError, plan_dubins_path
from shoal.search.flight.flight import Flight
from shoal.search.flight.vehicle import vehicle_of


def random_zones(rng, count, reach):
    corners = rng.uniform(-reach, reach, (count, 2))
    sides = rng.uniform(20, 80, (count, 2))
    return shapely.union_all(shapely.box(*corners.T, *(corners + sides).T))


def test_the_way_from_a_climb_to_the_path_avoids_zones():
    """The straight leg from the end of the climb to the first point was not tested."""
    vehicle, tested = vehicle_of("fixed-wing,turn_radius=40"), 0
    for seed in range(40, 64):
        rng = np.random.default_rng([77, seed])
        zones = random_zones(rng, 25, 300)
        home = rng.uniform(-300, 300, 2)
        first = home + rng.uniform(-80, 80, 2)
        last = first + rng.uniform(-250, 250, 2)
        direct = shapely.linestrings([home, first, last])
        if shapely.dwithin(zones, direct, 5.0):
            continue
        flight = Flight(vehicle, home, ending="loiter", airspace=Airspace(zones))
        try:
            waypoints = flight.waypoints(np.array([first, last]))
        except NoRoomError:
            continue
        tested += 1
        flown = shapely.linestrings(np.vstack([home, waypoints[:, :2]]))
        assert not shapely.intersects(zones.buffer(-0.05), flown), seed
    assert tested >= 6


# a corridor between two walls, too narrow for turns, with rows across it
WALLS = shapely.union_all([shapely.box(-400, 0, 400, 300), shapely.box(-400, -320, 400, -20)])


def zigzag(count, step):
    x = -step * count / 2 + step * np.arange(count)
    return np.column_stack([x, np.where(np.arange(count) % 2, -4.0, -16.0)])


def test_what_cannot_be_flown_is_refused_at_once_the_next_time(monkeypatch):
    airspace = Airspace(WALLS)
    way = np.vstack([[-600.0, -10.0], [-500.0, -10.0], zigzag(16, 12.0), [500.0, -10.0]])
    with pytest.raises(NoRoomError) as first:
        plan_dubins_path(way, 40.0, link=5.0, airspace=airspace)
    assert any(airspace.dead_ends.values())
    longer = np.vstack([[-700.0, 40.0], way, [600.0, 90.0]])

    def planned(*_, **__):
        raise AssertionError("planned again")

    monkeypatch.setattr(dubins, "_shortest_path", planned)
    with pytest.raises(NoRoomError) as second:
        plan_dubins_path(longer, 40.0, link=5.0, airspace=airspace)
    assert str(second.value).split(", got")[0] == str(first.value).split(", got")[0]
    with pytest.raises(AssertionError):  # a wider turn is another question
        plan_dubins_path(longer, 20.0, link=5.0, airspace=airspace)


def flown(way, airspace):
    try:
        return plan_dubins_path(way, 30.0, link=20.0, airspace=airspace)[0]
    except NoRoomError:
        return None


def test_nothing_is_refused_because_of_other_paths():
    """Parts of one path are planned alike in an airspace of their own and in a shared one."""
    refused = 0
    for seed in range(2):
        rng = np.random.default_rng([78, seed])
        zones = random_zones(rng, 30, 250)
        rows = np.array(
            [(x, y) for k, y in enumerate(range(-200, 201, 40)) for x in (-200, 200)[:: (-1) ** k]],
            float,
        )
        way = np.vstack([rows[:1], rows, rows[-1:]])
        shared = Airspace(zones)
        for begin, end in ((0, 14), (6, 20), (8, 16)):
            alone, together = flown(way[begin:end], Airspace(zones)), flown(way[begin:end], shared)
            assert (alone is None) == (together is None), (seed, begin, end)
            if alone is not None:
                np.testing.assert_array_equal(alone, together)
            refused += alone is None
    assert refused > 0
