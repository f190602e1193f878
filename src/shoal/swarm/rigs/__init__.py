"""Driving a real or simulated rig in a closed loop: commands out, positions in.

A *rig* is whatever moves particles and sees them: a simulation, or a laboratory's rig behind a line. Any policy drives any rig.
"""

from __future__ import annotations

from shoal.swarm.rigs.driving import Drive, drive
from shoal.swarm.rigs.log import DriveLog, RecordedRig, read_log, replay_log
from shoal.swarm.rigs.messages import PROTOCOL, seal, unseal
from shoal.swarm.rigs.protocol import Rig, open_rig
from shoal.swarm.rigs.remote import LinkCounts, RemoteRig
from shoal.swarm.rigs.simulated import SimulatedRig
from shoal.swarm.rigs.transports import ChildLine, Line, LineCutError, SerialLine, TcpLine, open_line

__all__ = [
    "PROTOCOL",
    "ChildLine",
    "Drive",
    "DriveLog",
    "Line",
    "LineCutError",
    "LinkCounts",
    "RecordedRig",
    "RemoteRig",
    "Rig",
    "SerialLine",
    "SimulatedRig",
    "TcpLine",
    "drive",
    "open_line",
    "open_rig",
    "read_log",
    "replay_log",
    "seal",
    "unseal",
]
