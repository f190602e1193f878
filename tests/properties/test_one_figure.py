"""A search with vehicles has one time and one coverage: of its plan, its simulation and its written missions."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from shoal.search.episode import duration_text
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.missions import check_missions
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import MissionOptions
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import region_of
from shoal.views.search.mission_folder import MissionFolder
from shoal.views.search.timeline import timeline_figure

VEHICLES = ("multirotor", "multirotor,cruise_speed=8", "rover", "fixed-wing,turn_radius=30,altitude=60")
CAMERA = "altitude=60,sensor_width=13.2,sensor_height=8.8,focal_length=8.8,front_overlap=0.7,side_overlap="


def random_problem(rng, kind):
    """Return a problem with a random region, number of robots, launch points, margin, wind, camera and battery."""
    angles = np.sort(rng.uniform(0, 2 * np.pi, 8))
    radii = rng.uniform(0.6, 1.0, 8) * rng.uniform(110, 190)
    outline = shapely.Polygon(radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])).convex_hull
    zone = shapely.affinity.translate(shapely.box(-9, -6, 9, 6), *rng.uniform(-30, 30, 2))
    area = outline.difference(zone) if rng.random() < 0.5 else outline
    region = region_of(area, frame=LocalFrame(8.5, 47.4), name="field")
    robots = int(rng.integers(1, 4))
    vehicle, footprint = VEHICLES[kind], float(rng.choice([25, 40]))
    if kind < 2 and rng.random() < 0.5:
        vehicle, footprint = f"{vehicle},{CAMERA}{rng.choice([0, 0.2, 0.4])}", None
    if kind == 0 and rng.random() < 0.5:
        vehicle += ",endurance=7,recharge=2"
    if kind != 2 and rng.random() < 0.4:
        vehicle += f",wind_speed=3,wind_from={rng.integers(360)}"
    options = {"margin": 5.0} if rng.random() < 0.5 else {}
    if kind != 2:
        options["launch"] = [(-200.0 - 15 * robot, 0.0) for robot in range(robots)]
    return SearchProblem(region, robots=robots, footprint=footprint, vehicle=vehicle, **options)


@pytest.mark.parametrize("seed", range(8))
def test_plan_simulation_timeline_and_missions_agree(seed, tmp_path):
    rng = np.random.default_rng([41, seed])
    problem = random_problem(rng, seed % 4)
    folder = MissionFolder(tmp_path, problem, MissionOptions(format=("plan", "csv")))
    episode = folder.run(problem, seed=seed)
    folder.write(episode.plan)
    vehicle = vehicle_of(problem.vehicle)
    check = check_missions(tmp_path, problem.place, problem.chosen_footprint, vehicle=vehicle)
    starts = {one.name: one.start for one in check.missions}
    back = max(starts[flight["mission"]] + flight["duration_s"] for flight in check.flights)
    report = episode.report()
    for time in (report["makespan_s"], report["planned_s"], episode.clock(episode.trace.covered_at), episode.makespan):
        assert time == pytest.approx(back, rel=0.02)
    compared = [one.seconds for one in episode.plan.compared if one.allocation is not None]
    assert not compared or min(compared) == compared[0]
    assert check.coverage.covered_fraction == pytest.approx(episode.coverage.covered_fraction, abs=2e-4)
    assert check.coverage.covered_fraction > 0.999
    assert not check.errors
    assert not {one.rule for one in check.diagnostics} - {"transit", "homes-near"}


def test_the_timeline_ends_at_the_headline(tmp_path):
    problem = random_problem(np.random.default_rng(5), 1)
    episode = MissionFolder(tmp_path, problem, MissionOptions()).run(problem, seed=1)
    words = " ".join(text.get_text() for text in timeline_figure(episode).axes[0].texts)
    assert "all searched" in words
    assert duration_text(episode.makespan) in episode.reason
    assert duration_text(episode.makespan) in words or duration_text(episode.clock(max(episode.trace.declared.values()))) in words
