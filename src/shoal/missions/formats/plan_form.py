"""The expected structure of a ``.plan`` file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictInt

_Numbers = Annotated[float, Field(strict=True)]


class _Form(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class ItemForm(_Form):
    """The expected structure of a mission item in a ``.plan`` file."""

    type: Literal["SimpleItem"]
    command: StrictInt
    frame: StrictInt
    params: Annotated[list[_Numbers | None], Field(min_length=7, max_length=7)]
    auto_continue: StrictBool = Field(alias="autoContinue")
    do_jump_id: StrictInt = Field(alias="doJumpId")


class MissionForm(_Form):
    """The expected structure of the mission in a ``.plan`` file."""

    version: Literal[2]
    firmware_type: StrictInt = Field(alias="firmwareType")
    vehicle_type: StrictInt = Field(alias="vehicleType")
    cruise_speed: _Numbers = Field(alias="cruiseSpeed")
    hover_speed: _Numbers = Field(alias="hoverSpeed")
    altitude_mode: StrictInt = Field(alias="globalPlanAltitudeMode")
    home: Annotated[
        list[_Numbers | None], Field(min_length=3, max_length=3, alias="plannedHomePosition")
    ]
    items: list[ItemForm]


_Latitude = Annotated[float, Field(strict=True, ge=-90, le=90)]
_Longitude = Annotated[float, Field(strict=True, ge=-180, le=180)]


class PolygonForm(_Form):
    """The expected structure of a fence polygon in a ``.plan`` file."""

    version: Literal[1]
    inclusion: StrictBool
    polygon: Annotated[list[tuple[_Latitude, _Longitude]], Field(min_length=3)]


class RoundForm(_Form):
    """The expected structure of a circle itself."""

    center: tuple[_Latitude, _Longitude]
    radius: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]


class CircleForm(_Form):
    """The expected structure of a fence circle in a ``.plan`` file."""

    version: Literal[1]
    inclusion: StrictBool
    circle: RoundForm


class FenceForm(_Form):
    """The expected structure of the fence in a ``.plan`` file."""

    version: Literal[2]
    circles: list[CircleForm]
    polygons: list[PolygonForm]


class RallyForm(_Form):
    """The expected structure of the rally points in a ``.plan`` file."""

    version: Literal[2]
    points: list[tuple[_Latitude, _Longitude, _Numbers]]


class PlanForm(_Form):
    """The expected structure of a whole ``.plan`` file."""

    file_type: Literal["Plan"] = Field(alias="fileType")
    version: Literal[1]
    ground_station: str = Field(alias="groundStation")
    mission: MissionForm
    fence: FenceForm = Field(alias="geoFence")
    rally: RallyForm = Field(alias="rallyPoints")
