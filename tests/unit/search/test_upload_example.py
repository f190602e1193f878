"""examples/upload_mission.py sends an autopilot what a file holds: here one that asks for item
after item over no wire.
"""

from __future__ import annotations

import json
import runpy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from shoal.missions import missions_of, write_missions
from shoal.missions.fence import Fence
from shoal.search import LocalFrame

EXAMPLE = runpy.run_path(str(Path(__file__).parents[3] / "examples" / "upload_mission.py"))
AROUND, ZONE = (
    np.array([(8.4, 47.3), (8.6, 47.3), (8.6, 47.5), (8.4, 47.5)]),
    np.array([(8.51, 47.41), (8.52, 47.41), (8.52, 47.42)]),
)


class Autopilot:
    """Asks for one item after the other, and then tells its verdict."""

    target_system = target_component = 1

    def __init__(self, verdict=0):
        self.mav, self.got, self.verdict = self, [], verdict

    def mission_count_send(self, system, component, count, kind):
        self.wanted, self.kind = count, kind

    def mission_item_int_send(self, *item):
        self.got.append(item)

    def recv_match(self, **_):
        name = "MISSION_ACK" if len(self.got) == self.wanted else "MISSION_REQUEST_INT"
        return SimpleNamespace(
            get_type=lambda: name, mission_type=self.kind, type=self.verdict, seq=len(self.got)
        )


@pytest.fixture
def plan(tmp_path):
    (mission,) = missions_of(
        [(0, 0), (90, 0), (90, 20)], LocalFrame(8.5, 47.4), robot=1, vehicle="multirotor"
    )
    mission = replace(mission, fence=Fence(AROUND, (ZONE,)), rally=((8.5, 47.4),))
    (path,) = write_missions([mission], tmp_path, formats=["plan"])
    return json.loads(path.read_text())


@pytest.mark.parametrize("with_home", [True, False])
def test_the_items_of_a_file_are_sent_in_their_order(plan, with_home):
    found = EXAMPLE["items_of"](plan, with_home=with_home)
    autopilot = Autopilot()
    EXAMPLE["upload"](autopilot, found["mission"], 0)
    sent = [(item[2], item[4], item[11:14]) for item in autopilot.got]
    home = [(16, (474000000, 85000000, 0.0))] * with_home
    written = [(item["command"], item["params"][4:]) for item in plan["mission"]["items"]]
    expected = [
        *home,
        *((command, (round(y * 1e7), round(x * 1e7), z)) for command, (y, x, z) in written),
    ]
    assert sent == [(number, command, place) for number, (command, place) in enumerate(expected)]


def test_fence_and_rally_points_are_sent_with_their_commands(plan):
    found = EXAMPLE["items_of"](plan, with_home=False)
    assert [(command, params[0]) for _, command, params in found["fence"]] == [(5001, 4)] * 4 + [
        (5002, 3)
    ] * 3
    assert [(command, params[4:6]) for _, command, params in found["rally"]] == [
        (5100, [47.4, 8.5])
    ]


def test_a_refusal_is_told(plan):
    with pytest.raises(SystemExit, match="MAV_MISSION_RESULT 4"):
        EXAMPLE["upload"](
            Autopilot(verdict=4), EXAMPLE["items_of"](plan, with_home=False)["mission"], 0
        )
