"""Units of length in map files, in millimetres."""

from __future__ import annotations

_MILLIMETRES = {
    "nm": 1e-6, "nanometer": 1e-6, "nanometre": 1e-6,
    "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "\\u00b5m": 1e-3, "micron": 1e-3, "microns": 1e-3, "micrometer": 1e-3, "micrometre": 1e-3,
    "mm": 1.0, "millimeter": 1.0, "millimetre": 1.0,
    "cm": 10.0, "centimeter": 10.0, "centimetre": 10.0,
    "m": 1000.0, "meter": 1000.0, "metre": 1000.0,
    "inch": 25.4, "in": 25.4,
}  # fmt: skip


def millimetres(unit: str) -> float | None:
    """Return a unit of length in millimetres, or None for a text that is no unit of length, such as "pixel".

    Examples
    --------
    >>> millimetres("micron"), millimetres("µm"), millimetres("pixel")
    (0.001, 0.001, None)
    """
    return _MILLIMETRES.get(unit.strip().lower())
