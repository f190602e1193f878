"""Closed-loop control of a real or simulated rig: send commands, and receive the positions of
particles.

A *rig* is a real or simulated device that moves particles and observes the particles' positions.
Every policy works with every rig.
"""

from __future__ import annotations

from shoal.rigs.checks import KINDS, Alarm, Trust
from shoal.rigs.driving import (
    Drive,
    DriveError,
    DriveInterrupted,
    drive,
    load_drive_kernels,
    replay_log,
)
from shoal.rigs.log import DriveLog, RecordedRig, read_log
from shoal.rigs.monitor import Rate
from shoal.rigs.physics import PhysicsRig, Plant, PlantProperties
from shoal.rigs.ports import (
    Actuator,
    BenchRig,
    Calibration,
    Frame,
    GridCalibration,
    PlantPorts,
    Sensor,
    open_actuator,
    open_sensor,
)
from shoal.rigs.protocol import PROTOCOL, decode_message, encode_message
from shoal.rigs.remote import LinkCounts, RemoteRig, open_rig
from shoal.rigs.rig import NoisyRig, Rig, SimulatedRig
from shoal.rigs.transports import (
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
    "Actuator",
    "Alarm",
    "BenchRig",
    "Calibration",
    "ConnectionCutError",
    "Drive",
    "DriveError",
    "DriveInterrupted",
    "DriveLog",
    "Frame",
    "GridCalibration",
    "LinkCounts",
    "NoisyRig",
    "PhysicsRig",
    "Plant",
    "PlantPorts",
    "PlantProperties",
    "ProcessTransport",
    "Rate",
    "RecordedRig",
    "RemoteRig",
    "Rig",
    "Sensor",
    "SerialTransport",
    "SimulatedRig",
    "TcpTransport",
    "Transport",
    "Trust",
    "decode_message",
    "drive",
    "encode_message",
    "load_drive_kernels",
    "open_actuator",
    "open_rig",
    "open_sensor",
    "open_transport",
    "read_log",
    "replay_log",
]
