"""Heights and times of missions, as the studio draws them."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.missions import MissionOptions, MissionSet
from shoal.missions.profile import height_profiles
from shoal.search import SearchProblem

PROBLEM = SearchProblem("square:100", robots=2, footprint=20, vehicle="multirotor,endurance=2")


@pytest.mark.parametrize("terrain", [False, True])
def test_a_profile_is_the_height_of_the_vehicle_at_each_time(tmp_path, terrain):
    options = {}
    if terrain:  # from 100 m in the west to 110 m in the east
        rows = "\n".join(" ".join(f"{100 + k / 2:g}" for k in range(21)) for _ in range(21))
        head = "ncols 21\nnrows 21\nxllcorner -100\nyllcorner -100\ncellsize 10\n"
        (tmp_path / "slope.asc").write_text(f"{head}{rows}\n")
        options = {"terrain": str(tmp_path / "slope.asc"), "altitude_frame": "ground"}
    made = MissionSet.from_problem(PROBLEM, MissionOptions(**options), seed=1)
    profiles = height_profiles(made)
    assert [(one.robot, one.sortie) for one in profiles] == [
        (one.robot, one.sortie) for one in made.missions
    ]
    assert len(profiles) > 2
    for mission, one in zip(made.missions, profiles, strict=True):
        assert one.times[0] == mission.start
        lasting = mission.duration(made.plan.vehicle)
        assert one.times[-1] - one.times[0] == pytest.approx(lasting)
        assert one.heights[0] == one.heights[-1] == 0 if not terrain else one.heights[0] == 0
        assert (one.ground is None) != terrain
        if terrain:
            high = (one.times > one.times[0] + 30) & (one.times < one.times[-1] - 30)
            above = (one.heights - one.ground)[high]
            assert np.abs(above - made.plan.vehicle.height).max(initial=0) < 3
        else:
            assert one.heights.max() == mission.altitude
