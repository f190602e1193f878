"""Closed-loop control of a real or simulated rig: send commands, and receive the positions of particles.

A *rig* is a real or simulated device that moves particles and observes the particles' positions. Every policy works with every rig.
"""

from __future__ import annotations

from shoal.swarm.rigs.checks import KINDS, Alarm, Rate, Trust
from shoal.swarm.rigs.driving import Drive, DriveError, DriveInterrupted, drive, load_drive_kernels, replay_log
from shoal.swarm.rigs.log import DriveLog, RecordedRig, read_log
from shoal.swarm.rigs.messages import PROTOCOL, decode_message, encode_message
from shoal.swarm.rigs.protocol import Rig
from shoal.swarm.rigs.remote import LinkCounts, RemoteRig, open_rig
from shoal.swarm.rigs.simulated import NoisyRig, SimulatedRig
from shoal.swarm.rigs.transports import (
    ConnectionCutError,
    ProcessTransport,
    SerialTransport,
    TcpTransport,
    Transport,
    open_transport,
)

__all__ = [
    "KINDS",
    "PROTOCOL",
    "Alarm",
    "ConnectionCutError",
    "Drive",
    "DriveError",
    "DriveInterrupted",
    "DriveLog",
    "LinkCounts",
    "NoisyRig",
    "ProcessTransport",
    "Rate",
    "RecordedRig",
    "RemoteRig",
    "Rig",
    "SerialTransport",
    "SimulatedRig",
    "TcpTransport",
    "Transport",
    "Trust",
    "decode_message",
    "drive",
    "encode_message",
    "load_drive_kernels",
    "open_rig",
    "open_transport",
    "read_log",
    "replay_log",
]
