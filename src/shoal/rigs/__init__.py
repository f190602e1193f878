"""Closed-loop control of a real or simulated rig: send commands, and receive the positions of
particles.

A *rig* is a real or simulated device that moves particles and observes the particles' positions.
Every policy works with every rig.
"""

from __future__ import annotations

from shoal.rigs.calibration import BenchCalibration, Responses
from shoal.rigs.cameras import CameraSensor, MicroManagerSource, OpenCVSource, Vision, open_camera
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
from shoal.rigs.measuring import calibrate
from shoal.rigs.monitor import Rate
from shoal.rigs.physics import PhysicsRig, Plant, PlantProperties
from shoal.rigs.ports import (
    Actuator,
    BenchRig,
    Calibration,
    GridCalibration,
    PlantPorts,
    Sensor,
    open_actuator,
    open_sensor,
)
from shoal.rigs.protocol import PROTOCOL, decode_message, encode_message
from shoal.rigs.records import write_frames
from shoal.rigs.registration import Tie, tie_by_map, tie_by_marks
from shoal.rigs.remote import LinkCounts, LoggedSession, RemoteRig, open_rig
from shoal.rigs.resume import rebuild
from shoal.rigs.rig import Frame, NoisyRig, Rig, SimulatedRig
from shoal.rigs.steering_bench import SteeringBench
from shoal.rigs.transports import (
    ConnectionCutError,
    ProcessTransport,
    SerialTransport,
    TcpTransport,
    Transport,
    open_transport,
)
from shoal.rigs.trim import PulseTrim

__all__ = [
    "KINDS",
    "PROTOCOL",
    "Actuator",
    "Alarm",
    "BenchCalibration",
    "BenchRig",
    "Calibration",
    "CameraSensor",
    "ConnectionCutError",
    "Drive",
    "DriveError",
    "DriveInterrupted",
    "DriveLog",
    "Frame",
    "GridCalibration",
    "LinkCounts",
    "LoggedSession",
    "MicroManagerSource",
    "NoisyRig",
    "OpenCVSource",
    "PhysicsRig",
    "Plant",
    "PlantPorts",
    "PlantProperties",
    "ProcessTransport",
    "PulseTrim",
    "Rate",
    "RecordedRig",
    "RemoteRig",
    "Responses",
    "Rig",
    "Sensor",
    "SerialTransport",
    "SimulatedRig",
    "SteeringBench",
    "TcpTransport",
    "Tie",
    "Transport",
    "Trust",
    "Vision",
    "calibrate",
    "decode_message",
    "drive",
    "encode_message",
    "load_drive_kernels",
    "open_actuator",
    "open_camera",
    "open_rig",
    "open_sensor",
    "open_transport",
    "read_log",
    "rebuild",
    "replay_log",
    "tie_by_map",
    "tie_by_marks",
    "write_frames",
]
