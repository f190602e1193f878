"""The fields of an actuation file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from shoal.rigs.packets import Template

LONGEST_PULSE = 60.0  # seconds, if the file states no other limit
Positive = Annotated[float, Field(gt=0)]


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class FieldForm(_Form):
    """The field of a pulse.

    Parameters
    ----------
    magnitude : float
        Strength, in ``unit``.
    unit : str
        "mT", or "mA" if only the current of the coils is known.
    frequency : float, optional
        Turns a second (roll and swim).
    tilt : float, optional
        Angle between the axis of rotation and the z axis, in degrees (roll and swim; 90 if not
        given).
    heading : float
        Angle that is added to the direction of every command, in degrees: how far the apparatus is
        turned, or by how much particles move askew.
    """

    magnitude: Positive
    unit: Literal["mT", "mA"] = "mT"
    frequency: Positive | None = None
    tilt: float | None = Field(default=None, ge=0, le=180)
    heading: float = Field(default=0.0, ge=-360, le=360)


class PulseForm(_Form):
    """The pulse that carries out a command.

    Parameters
    ----------
    seconds : float
        Time that the field is on.
    settle : float
        Time after it until the particles are at rest, in seconds.
    """

    seconds: Positive
    settle: float = Field(default=0.0, ge=0, le=60)


class CommandForm(_Form):
    """What is different for one command.

    Parameters
    ----------
    angle : float, optional
        Direction in degrees, counterclockwise from the x axis.
    seconds : float, optional
        Time that the field is on.
    values : dict, optional
        Values for the templates (kind custom).
    """

    angle: float | None = Field(default=None, ge=-360, le=360)
    seconds: Positive | None = None
    values: dict[str, float] | None = None


class CoilsForm(_Form):
    """The coils.

    Parameters
    ----------
    names : list of str
        Names for the templates.
    matrix : list of list of float
        One row of two or three numbers for each coil: its current (mA) for each unit of the field
        along x, y and z.
    one_sided : bool
        Whether coils attract whatever the sign of their current, so that a negative one is 0.
    polynomial : list of float, or one list for each coil, optional
        Coefficients c0, c1, ... from mA to duty. Without it, templates send mA.
    """

    names: list[str]
    matrix: list[list[float]]
    one_sided: bool = False
    polynomial: list[float] | list[list[float]] | None = None


class LimitsForm(_Form):
    """What must never be exceeded.

    Parameters
    ----------
    field : float, optional
        Strength in mT.
    current : float, optional
        Current of each coil in mA.
    duty : float, optional
        Duty of each coil.
    pulse : float
        Longest pulse in seconds.
    duty_cycle : float, optional
        Largest share of the time that the field may be on: the next pulse waits.
    temperature : float, optional
        Temperature in degrees Celsius that the device reports.
    """

    field: Positive | None = None
    current: Positive | None = None
    duty: Positive | None = None
    pulse: float = Field(default=LONGEST_PULSE, gt=0, le=LONGEST_PULSE)
    duty_cycle: float | None = Field(default=None, gt=0, le=1)
    temperature: float | None = None


class ReplyForm(Template):
    """An answer that is awaited.

    Parameters
    ----------
    when : str
        "begin": the device confirms a packet as soon as it has come. "end": it answers when the
        pulse has ended.
    within : float
        Time in seconds after the packet, or after the end of the pulse, in which the answer must
        come.
    """

    when: Literal["begin", "end"] = "begin"
    within: float = Field(default=1.0, gt=0, le=60)


class AliveForm(Template):
    """A packet that tells a device, while its field is on, that the drive is alive.

    Parameters
    ----------
    every : float
        Time between two of them, in seconds.
    """

    every: float = Field(gt=0, le=60)


class DeviceForm(_Form):
    """The device that supplies the coils.

    Parameters
    ----------
    connection : str
        ``serial:DEVICE[@BAUD]`` or ``tcp:HOST:PORT``.
    packets : str
        "text", "struct" or "cobs" (as pySerialTransfer has them).
    pulse, off : Template
        What turns the field on and off.
    timed : bool
        Whether the device itself ends a pulse after the time in its packet.
    reply, off_reply, error : ReplyForm, Template, optional
        Answers to ``pulse`` and to ``off``, and what the device says if it fails or refuses.
    repeat : int
        How often a pulse without an answer is sent again. The device must not carry out a number
        twice.
    alive : AliveForm, optional
    updates : float, optional
        Packets a second while the field is on, for a device that does not rotate the field itself.
    ready : float
        Time in seconds that the device needs after its connection was opened.
    keep_alive : float, optional
        Time in seconds of silence after which a process of its own turns the field off.
    """

    connection: str
    packets: Literal["text", "struct", "cobs"]
    pulse: Template
    off: Template
    timed: bool = False
    reply: ReplyForm | None = None
    off_reply: ReplyForm | None = None
    error: Template | None = None
    repeat: int = Field(default=0, ge=0, le=100)
    alive: AliveForm | None = None
    updates: float | None = Field(default=None, gt=0, le=1000)
    ready: float = Field(default=0.0, ge=0, le=60)
    keep_alive: float | None = Field(default=None, ge=0.02, le=60)


class ActuationForm(_Form):
    """An actuation file.

    Parameters
    ----------
    name : str
    kind : str
        "pull", "roll", "swim" or "custom".
    field : FieldForm, optional
        Not for kind custom, which states the values of each command.
    pulse : PulseForm
    commands : dict
        Changes for some of the commands l, u, r and d.
    coils : CoilsForm, optional
    limits : LimitsForm
    device : DeviceForm
    """

    name: str = "coils"
    kind: Literal["pull", "roll", "swim", "custom"]
    field: FieldForm | None = None
    pulse: PulseForm
    commands: dict[Literal["l", "u", "r", "d"], CommandForm] = Field(default_factory=dict)
    coils: CoilsForm | None = None
    limits: LimitsForm = Field(default_factory=LimitsForm)
    device: DeviceForm
