"""MAVSDK, which nobody here wrote, on the other end: its server receives and tells what we upload,
and what its client uploads to our vehicle is what our station reads.
"""

from __future__ import annotations

import socket
import threading
import time

import pytest
from tests.unit.robots.test_upload import missions, on_board

from shoal.missions import write_missions

pytest.importorskip("pymavlink")
pytest.importorskip("mavsdk")

from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mission_raw import mission_raw
from mavsdk.plugins.mission_raw_server.mission_raw_server import MissionRawServer

from shoal.robots.mavlink import open_link
from shoal.robots.mission_protocol import (
    FENCE,
    MISSION,
    RALLY,
    MissionItem,
    compare_items,
    download_items,
    item_on_air,
)
from shoal.robots.onboard import pair, read_cargos, read_seats
from shoal.robots.simulated import SimulatedVehicle, run_vehicles
from shoal.robots.uploading import open_stations, upload_missions


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def folder(tmp_path):
    write_missions(missions(1), tmp_path, formats=["plan"])
    return tmp_path


@pytest.fixture
def mavsdk_as():
    """Return a function that starts MAVSDK as a component, at an address."""
    started = []

    def start(component, address):
        configuration = Configuration.create_with_component_type(component)
        made = Mavsdk(configuration)
        started.append(made)
        made.add_any_connection(address)
        return made

    yield start
    for made in started:
        made.destroy()


def wait_for(found, seconds=20.0):
    until = time.monotonic() + seconds
    while not found() and time.monotonic() < until:
        time.sleep(0.02)
    return found()


def on_air_item(item):
    """Return an item of MAVSDK as ours."""
    params = item.param1, item.param2, item.param3, item.param4
    return MissionItem(item.frame, item.command, params, item.x, item.y, item.z, item.autocontinue)


def test_its_server_receives_what_we_upload_and_tells_it_back(folder, mavsdk_as):
    port = free_port()
    sdk = mavsdk_as(ComponentType.AUTOPILOT, f"udpout://127.0.0.1:{port}")
    server = MissionRawServer(sdk.server_component_by_type(ComponentType.AUTOPILOT))
    received = []
    server.subscribe_incoming_mission(lambda _result, plan, _data: received.append(plan))
    pairs = pair(read_cargos(folder), read_seats("1=1"))
    with open_stations([f"udpin:127.0.0.1:{port}"]) as stations:
        (made,) = upload_missions(pairs, stations)
    assert (made.status, made.different) == ("equal", 0), made.sentence
    assert wait_for(lambda: len(received) >= 3)  # it tells of them in a thread of its own
    cargo = read_cargos(folder)[1]
    plans = {tuple(one.command for one in plan.mission_items): plan for plan in received}
    for kind in (MISSION, FENCE, RALLY):
        sent = [item_on_air(item) for item in cargo.items[kind]]
        plan = plans[tuple(one.command for one in sent)]
        found = [on_air_item(one) for one in plan.mission_items]
        assert compare_items(kind, sent, found, autopilot=0).different == 0


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_what_its_client_uploads_is_what_we_read_and_what_it_reads_is_ours(
    folder, mavsdk_as, autopilot
):
    to_sdk, to_station = free_port(), free_port()
    vehicle = SimulatedVehicle(1, autopilot=autopilot)
    ended = threading.Event()
    links = [open_link(f"udpout:127.0.0.1:{port}") for port in (to_sdk, to_station)]

    class Both:
        """Two links as one, as a vehicle with two radios has them."""

        def receive(self, timeout):
            return [one for link in links for one in link.receive(timeout / 2)]

        def send(self, data, to=None):
            for link in links:
                link.send(data)

    thread = threading.Thread(
        target=run_vehicles, args=([vehicle], Both()), kwargs={"ended": ended.is_set}
    )
    thread.start()
    try:
        sdk = mavsdk_as(ComponentType.GROUND_STATION, f"udpin://127.0.0.1:{to_sdk}")
        assert wait_for(sdk.get_systems)
        client = mission_raw.MissionRaw(sdk.get_systems()[0])
        data = client.import_qgroundcontrol_mission(str(folder / "robot-01.plan"))
        client.upload_mission(data.mission_items)
        client.upload_geofence(data.geofence_items)
        client.upload_rally_points(data.rally_items)
        if autopilot == "px4":
            assert on_board(folder, vehicle) == {MISSION: 0, FENCE: 0, RALLY: 0}
        with open_stations([f"udpin:127.0.0.1:{to_station}"]) as (station,):
            while 1 not in station.vehicles:
                station.listen(station.now() + 1)
            for kind, read in (
                (MISSION, client.download_mission),
                (FENCE, client.download_geofence),
                (RALLY, client.download_rallypoints),
            ):
                ours = download_items(station, station.vehicles[1], kind)
                theirs = [on_air_item(item) for item in read()]
                assert len(ours) == len(theirs) > 0
                assert compare_items(kind, ours, theirs, autopilot=0).different == 0
    finally:
        ended.set()
        thread.join()
        for link in links:
            link.close()
