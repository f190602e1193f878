"""TIFF files that Pillow does not read exactly, read by tifffile: wide numbers, planes of channels,
and the axes of microscopes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError, import_extra
from shoal.core.gdal import METADATA, NO_DATA, notes_beside, notes_inside
from shoal.core.notices import tell_once
from shoal.swarm.maps.reading import (
    AxisChoices,
    MapOptions,
    check_data,
    check_layers,
    millimetres,
)

LAYERS = "ZQI"
"""Axes of tifffile that count the layers of a map: depth, and pages without a name."""

WHOLE = {8, 16, 32, 64}
"""Numbers of bits that are whole numbers of NumPy."""

SIMPLE = {1, 2, 4, 8, 12, 16}
"""Numbers of bits of a grey pixel that Pillow reads exactly."""


def needs_tifffile(path: Path, tags: Any) -> bool:
    """Return whether Pillow would not read the first page of a TIFF file exactly, or not its axes.

    Parameters
    ----------
    tags : mapping
        The tags of the first page by number, as Pillow returns them.
    """
    bits = tags.get(258, (1,))
    bits = bits if isinstance(bits, tuple) else (bits,)
    description = str(tags.get(270, ""))
    samples, kind = int(tags.get(277, 1)), tags.get(339, (1,))
    kind = kind[0] if isinstance(kind, tuple) else kind
    if description.startswith("ImageJ=") or "<OME" in description[:2000]:
        return True
    if description.startswith('{"shape"') and (
        '"axes"' in description or description.partition("]")[0].count(",") > 2
    ):
        return True
    photometric, planar = int(tags.get(262, 1)), int(tags.get(284, 1))
    if samples == 1:
        exact = (
            (kind == 1 and bits[0] in SIMPLE)
            or (kind == 2 and bits[0] in {16, 32})
            or (kind == 3 and bits[0] == 32)
        )
        return not exact or (photometric == 0 and bits[0] > 8)
    extra = tags.get(338, ())
    extra = extra if isinstance(extra, tuple) else (extra,)
    # samples by photometric interpretation
    plain = {1: 1, 2: 3, 5: 4, 6: 3, 8: 3}.get(photometric, 0)
    standard = samples == plain or (
        samples == plain + 1 and extra and extra[0] in (1, 2) and photometric in (1, 2)
    )
    return max(bits) > 8 or kind != 1 or not standard or (planar == 2 and samples != 3)


def check_notes(path: Path, metadata: Any, no_data: Any) -> float | None:
    """Return the number that stands for a missing one by what GDAL notes of a picture, or None.

    Parameters
    ----------
    path : path
        The picture, beside which GDAL may have written more notes.
    metadata, no_data : str, optional
        The text of the tags `METADATA` and `NO_DATA` (`shoal.core.gdal`).

    Raises
    ------
    InvalidInputError
        Raised if the notes cannot be read, or say that the numbers of the file mean others, by a
        scale or an offset.
    """
    inside = notes_inside(str(metadata), str(path)) if metadata else []
    for notes in (*inside, *notes_beside(path)[0]):
        no_data = no_data or notes.no_data
        for name, number, plain in (("scale", notes.scale, 1), ("offset", notes.offset, 0)):
            if number != plain:
                raise InvalidInputError(
                    f"{path}: expected numbers that mean themselves, got the {name} {number:g} in"
                    " the notes of GDAL; write the file with gdal_translate -unscale"
                )
    return _number(no_data)


def _number(text: Any) -> float | None:
    try:
        return float(str(text).strip(" \0\r\n\t"))
    except ValueError:
        return None


def _tifffile() -> Any:
    needed = "TIFF files of floats, planes, many channels or microscopes need tifffile"
    return import_extra("tifffile", needed, extra="imaging")


def size_of(path: Path) -> tuple[int, int]:
    """Return the columns and rows of the first page of a TIFF file.

    Raises
    ------
    MissingExtraError
        Raised without tifffile, which itself raises many kinds of exceptions for damaged files.
    """
    with _tifffile().TiffFile(path) as file:
        page = file.pages.first
        return int(page.imagewidth), int(page.imagelength)


class Tiff:
    """A TIFF file as pages of the map: each page has the shape (rows, columns) or (rows, columns,
    samples).

    Parameters
    ----------
    path : path
    options : MapOptions
        The options ``channel`` and ``frame`` choose an entry of the file's channel axis and time
        axis.

    Raises
    ------
    InvalidInputError
        Raised if the file has several channels or points in time, and none is chosen, or if it has
        axes that a map does not have.
    MissingExtraError
    """

    def __init__(self, path: Path, options: MapOptions) -> None:
        self.path = path
        self._file = _tifffile().TiffFile(path)
        try:
            self._choose(options)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _choose(self, options: MapOptions) -> None:
        if not self._file.pages:
            raise ValueError("no pages")
        self._all = self._file.series
        self._series = self._all[0]
        # A writer that knows nothing of series writes each page as one; they are the layers of the
        # map.
        alike = {(series.shape, series.dtype, series.axes) for series in self._all}
        if len(self._all) > 1 and (
            len(alike) > 1 or set(self._series.axes) - set("YXS") or self._file.is_ome
        ):
            sizes = " and ".join("x".join(map(str, series.shape)) for series in self._all[:3])
            raise InvalidInputError(
                f"{self.path}: expected pages of one picture, got {len(self._all)} pictures of"
                f" {sizes}"
            )
        page = self._series.keyframe
        self.white_is_zero = page.photometric is not None and int(page.photometric) == 0
        self.photometric = int(page.photometric)
        self.dtype, self.bits = np.dtype(self._series.dtype), int(page.bitspersample)
        if self.dtype.kind not in "biuf":
            raise InvalidInputError(f"{self.path}: expected a picture of numbers, got {self.dtype}")
        self.orientation = int(page.tags.get(274).value) if page.tags.get(274) is not None else 1
        self.extra = tuple(int(sample) for sample in page.extrasamples)
        notes = [page.tags.valueof(tag) for tag in (METADATA, NO_DATA)]
        self.missing = check_notes(self.path, *notes)
        axes, shape = self._series.axes, tuple(int(side) for side in self._series.shape)
        rows, columns = int(page.imagelength), int(page.imagewidth)
        index: list[Any] = []
        self.channels_chosen = False
        self.samples = 1
        depth = len(self._all)
        choices = AxisChoices(self.path, options)
        names = self._channel_names()
        for axis, side in zip(axes, shape, strict=True):
            if axis in "YX":
                index.append(slice(None))
            elif axis == "S":
                index.append(slice(None))
                self.samples = side
            elif axis == "C":
                some = names if len(names) == side else [""] * side
                index.append(choices.index("channel", some))
                self.channels_chosen = side > 1
            elif axis == "T":
                index.append(choices.index("frame", [""] * side))
            elif axis in LAYERS and depth == 1:
                index.append(slice(None))
                depth = side
            elif side == 1:
                index.append(0)
            else:
                raise InvalidInputError(
                    f"{self.path}: expected rows, columns, layers, channels and time, got an axis"
                    f" {axis!r} of {side} (axes {axes})"
                )
        choices.check_used("frame")  # a channel may be one of the samples of a pixel
        check_layers(self.path, depth)
        self.size, self.depth, self._index = (rows, columns), depth, index
        self._spacing(axes)

    def pages(self) -> Iterator[NDArray[Any]]:
        """Return the pages one after the other. Each call starts again with the first page."""
        for series in self._all:
            yield from self._pages_of(series)

    def _pages_of(self, series: Any) -> Iterator[NDArray[Any]]:
        axes = series.axes
        outer = [axis for axis in axes if axis not in "YXS"]
        sides = [
            int(side) for axis, side in zip(axes, series.shape, strict=True) if axis not in "YXS"
        ]
        selection = [
            index for axis, index in zip(axes, self._index, strict=True) if axis not in "YXS"
        ]
        within = tuple(axis for axis in axes if axis in "YXS")
        count = int(np.prod(sides, dtype=np.int64))
        by_page = len(series.pages) == count and not (
            "S" in axes and any(axes.index("S") < axes.index(axis) for axis in outer)
        )
        array = None
        if not by_page:
            check_data(self.path, int(np.prod(series.shape, dtype=np.int64)) * self.dtype.itemsize)
            array = self._decode(series)
            order = [axes.index(axis) for axis in (*outer, *within)]
            array = array.transpose(order).reshape(
                count, *(array.shape[axes.index(axis)] for axis in within)
            )
        numbers = np.arange(count).reshape(sides) if sides else np.zeros((), dtype=np.int64)
        for number in np.atleast_1d(numbers[tuple(selection)] if sides else numbers).ravel():
            if array is not None:
                page = array[number]
            else:
                source = series.pages[int(number)]
                if source is None:
                    raise ValueError(f"page {int(number) + 1} is missing")
                check_data(self.path, int(source.size) * self.dtype.itemsize)
                page = self._decode(source)
                page = page.reshape([series.shape[axes.index(axis)] for axis in within])
            if "S" in within and within[0] == "S":
                page = np.moveaxis(page, 0, -1)
            yield page

    def _decode(self, source: Any) -> NDArray[Any]:
        try:
            return np.asarray(source.asarray())
        except (ValueError, ImportError, NotImplementedError) as error:
            if "imagecodecs" not in str(error):
                raise
            if (page := self._unpack(source)) is not None or (
                page := self._by_pillow(source)
            ) is not None:
                return page
            raise InvalidInputError(
                f"{self.path}: expected a TIFF file without compression or with Deflate or"
                " PackBits, got another compression together with numbers that need tifffile (save"
                " the file without compression)"
            ) from None

    def _unpack(self, source: Any) -> NDArray[Any] | None:
        """Return a page of whole numbers of few or odd bits, which follow each other without a gap
        inside a row.

        Returns None for a page that is not of this kind, or whose compression tifffile does not
        know.
        """
        key = getattr(source, "keyframe", None)
        bits = self.bits
        if (
            key is None
            or self.dtype.kind not in "bu"
            or bits in WHOLE
            or bits > 32
            or key.is_tiled
            or key.predictor not in (0, 1)
        ):
            return None
        if bits == 24 and self._file.byteorder == "<":
            raise InvalidInputError(
                f"{self.path}: expected numbers of at most 16 or of 32 bits, got 24 bits in the"
                " order of bytes II, which programs read in different orders (save the file with"
                " 32 bits)"
            )
        rows, columns = self.size
        planes = self.samples if key.planarconfig == 2 else 1
        width = columns * self.samples // planes
        line = -(-width * bits // 8)
        page = np.empty((planes, rows, width), dtype=self.dtype)
        strip = min(rows, int(key.rowsperstrip) or rows)
        count = -(-rows // strip)
        for number, (data, _) in enumerate(
            self._file.filehandle.read_segments(source.dataoffsets, source.databytecounts)
        ):
            plane, first = number // count, number % count * strip
            if plane >= planes or data is None:
                raise ValueError(f"strip {number + 1} is missing or too much")
            unfold = (
                _tifffile().TIFF.DECOMPRESSORS[key.compression] if key.compression != 1 else bytes
            )
            try:
                packed = np.frombuffer(unfold(data), dtype=np.uint8)
            except (KeyError, ImportError):
                return None
            height = min(strip, rows - first)
            if packed.size < height * line:
                raise ValueError(
                    f"expected {height * line} bytes in strip {number + 1}, got {packed.size}"
                )
            packed = packed[: height * line].reshape(height, line)
            order: Literal["little", "big"] = "little" if key.fillorder == 2 else "big"
            # row by row: the bits of a whole strip need eight times its bytes
            for row, octets in enumerate(packed, start=first):
                samples = np.unpackbits(octets, count=width * bits, bitorder=order).reshape(
                    width, bits
                )
                page[plane, row] = samples @ (1 << np.arange(bits, dtype=np.int64)[::-1])
        shape = (
            (rows, columns)
            if self.samples == 1
            else (planes, rows, columns)
            if planes > 1
            else (rows, columns, self.samples)
        )
        return np.asarray(page.reshape(shape))

    def _by_pillow(self, source: Any) -> NDArray[Any] | None:
        """Return a compressed page by Pillow, which knows more compressions, or None if Pillow
        changes the numbers of the page.
        """
        from PIL import Image, UnidentifiedImageError

        if self.samples != 1 or self.white_is_zero or not hasattr(source, "index"):
            return None
        try:
            with Image.open(self.path, formats=("TIFF",)) as image:
                image.seek(int(source.index))
                page = np.asarray(image)
        except UnidentifiedImageError:  # a compression that Pillow does not know either
            return None
        return (
            page
            if page.dtype == self.dtype and page.shape == self.size and self.orientation == 1
            else None
        )

    def _channel_names(self) -> list[str]:
        """Return the names of the channels of an OME or ImageJ file, if the file contains them."""
        if self._file.is_ome:
            channels = re.findall(r"<(?:\w+:)?Channel\b[^>]*", self._file.ome_metadata or "")
            names = [re.search(r'\bName="([^"]{0,80})"', channel) for channel in channels]
            return [name.group(1) if name else "" for name in names]
        return []

    def _spacing(self, axes: str) -> None:
        """Find the size of a pixel in the metadata of ImageJ or OME. The resolution of other files
        is that of a printer.
        """
        self.spacing: tuple[float | None, float, float] | None = None
        if self._file.is_ome:
            pixels = re.search(r"<(?:\w+:)?Pixels\b[^>]*", self._file.ome_metadata or "")
            sizes = dict(
                re.findall(
                    r'\b(PhysicalSize[XYZ](?:Unit)?)="([^"]{0,40})"',
                    pixels.group(0) if pixels else "",
                )
            )
            sides = [
                self._length(
                    sizes.get(f"PhysicalSize{axis}"), sizes.get(f"PhysicalSize{axis}Unit", "µm")
                )
                for axis in "ZYX"
            ]
        elif self._file.is_imagej:
            metadata = self._file.imagej_metadata or {}
            unit = str(metadata.get("unit", ""))
            within = [self._pixel(tag, unit) for tag in (283, 282)]
            sides = [self._length(metadata.get("spacing"), unit), *within]
        else:
            return
        if sides[1] is not None and sides[2] is not None:
            self.spacing = (sides[0], sides[1], sides[2])
            if sides[0] is None and self.depth > 1:
                tell_once(
                    f"shoal: {self.path}: the file gives the size of a pixel, {sides[1]:g} by"
                    f" {sides[2]:g} mm, but no distance between layers; the map has no size of"
                    " cells (--cell-size)"
                )

    def _pixel(self, tag: int, unit: str) -> float | None:
        entry = self._file.pages[0].tags.get(tag)
        if entry is None:
            return None
        value = entry.value
        count, length = value if isinstance(value, tuple) else (value, 1)
        return self._length(length / count if count else None, unit)

    @staticmethod
    def _length(value: Any, unit: str) -> float | None:
        factor = millimetres(unit)
        try:
            length = float(value) * factor if factor is not None else 0.0
        except (TypeError, ValueError):
            return None
        return length if 0 < length < 1e6 else None
