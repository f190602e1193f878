"""Driving a real or simulated rig in a closed loop: commands out, positions in.

A *plant* is whatever moves particles and sees them: a simulation, or a laboratory's rig behind a line. Any policy drives any plant.
"""

from __future__ import annotations

from shoal.swarm.plant.driving import Drive, drive
from shoal.swarm.plant.lines import ChildLine, Line, LineCutError, SerialLine, TcpLine, open_line
from shoal.swarm.plant.log import DriveLog, RecordedPlant, read_log, replay_log
from shoal.swarm.plant.messages import PROTOCOL, seal, unseal
from shoal.swarm.plant.protocol import Plant, open_plant
from shoal.swarm.plant.remote import LinkCounts, RemotePlant
from shoal.swarm.plant.simulated import SimulatedPlant

__all__ = [
    "PROTOCOL",
    "ChildLine",
    "Drive",
    "DriveLog",
    "Line",
    "LineCutError",
    "LinkCounts",
    "Plant",
    "RecordedPlant",
    "RemotePlant",
    "SerialLine",
    "SimulatedPlant",
    "TcpLine",
    "drive",
    "open_line",
    "open_plant",
    "read_log",
    "replay_log",
    "seal",
    "unseal",
]
