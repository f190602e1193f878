"""What GDAL notes of the numbers of a raster, inside a TIFF file or in a file beside it."""

from __future__ import annotations

from math import isfinite, nan
from pathlib import Path

from shoal.core.checks import read_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.xml import Element, XmlError, parse_xml

METADATA, NO_DATA = 42112, 42113
"""Tags of a TIFF file: the notes as XML, and the number that stands for a missing one."""

LARGEST_NOTES = 10_000_000  # bytes

_NAMES = {"Scale": "scale", "Offset": "offset", "UnitType": "unittype", "NoDataValue": "none"}


@dataclass(frozen=True)
class Notes:
    """What is noted of one band: a number in the file means number x scale + offset.

    Parameters
    ----------
    scale, offset : float
    unit : str
        Unit of the numbers, or "" if it is not stated.
    no_data : str
        The number in the file that stands for a missing one, or "".
    """

    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""
    no_data: str = ""


def notes_inside(text: str, where: str) -> list[Notes]:
    """Return the notes of all bands in the text of the tag `METADATA`; first those of band 1.

    Raises
    ------
    InvalidInputError
        If the text is not XML, or a scale or an offset is no number, or a scale is 0.
    """
    tree = _parse(text[:LARGEST_NOTES], where, root="GDALMetadata")
    said: dict[str, dict[str, str]] = {"0": {}}
    for item in tree.children:
        if item.tag == "Item":
            band = said.setdefault(item.attributes.get("sample", "0").strip(), {})
            band[item.attributes.get("role", "").lower()] = item.text.strip()
    return [_notes(band, where) for band in said.values()]


def notes_beside(source: Path) -> tuple[list[Notes], Path]:
    """Return the notes of all bands in the file that GDAL writes beside another one, first those of
    band 1, and its path; no notes if there is no such file. Errors as in `notes_inside`.
    """
    beside = source.with_name(f"{source.name}.aux.xml")
    if not beside.is_file():
        return [], beside
    text = read_text(beside, what="file with the notes of GDAL", most=LARGEST_NOTES)
    tree = _parse(text, str(beside), root="PAMDataset")
    said: dict[str, dict[str, str]] = {"1": {}}
    for band in tree.children:
        if band.tag == "PAMRasterBand":
            notes = said.setdefault(band.attributes.get("band", "1").strip(), {})
            notes |= {
                _NAMES[one.tag]: one.text.strip() for one in band.children if one.tag in _NAMES
            }
    return [_notes(band, str(beside)) for band in said.values()], beside


def _parse(text: str, where: str, *, root: str) -> Element:
    try:
        return parse_xml(text.strip(" \0\r\n\t"), root=root)
    except XmlError as error:
        raise InvalidInputError(
            f"{where}: expected what GDAL notes of the numbers of a raster, got a text that cannot be"
            f" read: {error}"
        ) from None


def _notes(said: dict[str, str], where: str) -> Notes:
    numbers: dict[str, float] = {}
    for name, default in (("scale", 1.0), ("offset", 0.0)):
        try:
            number = float(said.get(name, default))
        except ValueError:
            number = nan
        if not isfinite(number) or (name == "scale" and number == 0):
            expected = "a scale that is not 0" if name == "scale" else "an offset"
            raise InvalidInputError(f"{where}: expected {expected}, got {shortened(said[name])}")
        numbers[name] = number
    return Notes(
        numbers["scale"], numbers["offset"], said.get("unittype", ""), said.get("none", "")
    )
