"""Pictures as pages of numbers: PNG, TIFF, BMP, JPEG and GIF files, read by Pillow, or by tifffile
where Pillow would change the numbers.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import one_line
from shoal.core.errors import InvalidInputError, MissingExtraError, ShoalError
from shoal.core.gdal import METADATA, NO_DATA
from shoal.swarm.maps import tiff
from shoal.swarm.maps.reading import (
    LARGEST_PICTURE,
    MAX_CELLS,
    MAX_LAYERS,
    PIECE,
    AxisChoices,
    MapOptions,
    Mask,
    check_data,
    check_size,
    index_of,
    reading,
)
from shoal.swarm.maps.resampling import MOST_COUNTED
from shoal.swarm.maps.values import in_pieces

if TYPE_CHECKING:
    from PIL.Image import Image

PICTURES = {
    ".png": "PNG",
    ".tif": "TIFF",
    ".tiff": "TIFF",
    ".bmp": "BMP",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".gif": "GIF",
}
"""Suffixes of pictures, and the names of their formats in Pillow."""

LARGEST_FILE = 2**31  # bytes
ORIENTATION = 0x0112  # EXIF tag
COLOURS = {
    "RGB": ["red", "green", "blue"],
    "RGBA": ["red", "green", "blue", "alpha"],
    "LA": ["grey", "alpha"],
    "CMYK": ["cyan", "magenta", "yellow", "black"],
    "LAB": ["lightness", "a", "b"],
}
"""Names of the channels of colour pictures, by Pillow's name of the mode."""


class Page(NamedTuple):
    """A page of a picture, or some of its rows: large pages come in bands, so that no page is in
    memory twice.

    Attributes
    ----------
    numbers : ndarray, shape (H, W) or (H, W, channels)
        The numbers of the file.
    names : list of str
        Names of the channels.
    white : float, optional
        Number of white, or None for numbers without a natural white, such as floats.
    white_is_zero : bool
        Whether small numbers are bright.
    palette : ndarray of uint8, shape (entries, 4), optional
        Red, green, blue and opacity of each number of a picture with a palette.
    reduced : int
        Number of bits in the file if the numbers have fewer, or 0.
    numbered : bool
        Whether the entries of a palette are numbers of their own. A GIF file of greys has them only
        because the format needs a palette, and writers number them as they like.
    first_row : int
        The first row of the band.
    rows : int
        Number of rows of the whole page, or 0 if the band is the whole page.
    """

    numbers: NDArray[Any]
    names: list[str]
    white: float | None
    white_is_zero: bool = False
    palette: NDArray[np.uint8] | None = None
    reduced: int = 0
    numbered: bool = True
    first_row: int = 0
    rows: int = 0

    def __repr__(self) -> str:
        return one_line(self)


class Picture:
    """An open picture: its pages, the size of a pixel, whether a channel was chosen by an axis of
    the file, and the number that stands for a missing one, if the file names one.
    """

    def __init__(
        self,
        pages: Iterator[Page],
        *,
        spacing: Any = None,
        channels_chosen: bool = False,
        missing: float | None = None,
    ) -> None:
        self._pages, self.spacing, self.channels_chosen = pages, spacing, channels_chosen
        self.missing = missing

    def __iter__(self) -> Iterator[Page]:
        return self._pages


@contextmanager
def _any_size() -> Iterator[None]:
    """Let Pillow open pictures of any size, because their size is checked here, with an error of
    one sentence.
    """
    from PIL import Image

    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = limit


@contextmanager
def open_picture(path: Path, options: MapOptions, *, most: int | None = None) -> Iterator[Picture]:
    """Open a picture by Pillow, or by tifffile if Pillow would change its numbers.

    The argument ``most`` is the maximum number of bytes of a decoded page (by default,
    `LARGEST_PICTURE`).
    """
    from PIL import Image, UnidentifiedImageError

    gif = path.suffix.lower() == ".gif"
    formats = ("GIF",) if gif else ("PNG", "TIFF", "BMP", "JPEG")
    with _any_size(), path.open("rb") as file, reading(path, "a picture"):
        begin = file.read(8)
        file.seek(0)
        is_tiff = begin[:4] in {b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"}
        try:
            image = Image.open(file, formats=formats)
        except UnidentifiedImageError:
            if is_tiff:
                with _by_tifffile(path, options) as picture:
                    yield picture
                return
            words = "a GIF picture" if gif else "a PNG, TIFF, BMP or JPEG picture"
            raise InvalidInputError(
                f"{path}: expected {words}, got a damaged or other file (it begins with {begin!r})"
            ) from None
        with image:
            if image.format == "TIFF" and tiff.needs_tifffile(path, image.tag_v2):  # type: ignore[attr-defined]
                _check_pixels(path, image, options, most)
                with _by_tifffile(path, options) as picture:
                    yield picture
                return
            _check_colours_of_tiff(path, image)
            if image.format == "BMP":
                _mend_palette_of_bmp(image, file)
            depth = _bits_of_png(file) if image.format == "PNG" else 0
            tags: Any = image.tag_v2 if image.format == "TIFF" else {}  # type: ignore[attr-defined]
            missing = tiff.check_notes(path, tags.get(METADATA), tags.get(NO_DATA))
            yield Picture(_pages(path, image, options, most, png_depth=depth), missing=missing)


def _check_colours_of_tiff(path: Path, image: Any) -> None:
    """Refuse what Pillow before 13 takes for subsampled, and for truncated: YCbCr colours without
    JPEG compression.
    """
    from PIL import __version__ as version

    if image.format != "TIFF" or int(version.split(".")[0]) >= 13:
        return
    colours, compression = image.tag_v2.get(262), image.tag_v2.get(259, 1)
    if colours == 6 and compression not in {6, 7}:  # YCbCr; the old and the new JPEG
        raise InvalidInputError(
            f"{path}: expected Pillow 13 or newer for a TIFF picture of plain YCbCr colours, got"
            f" Pillow {version}"
        )


def _bits_of_png(file: io.BufferedReader) -> int:
    """Return the number of bits for each channel in the header of a PNG file."""
    place = file.tell()
    file.seek(24)
    depth = file.read(1)
    file.seek(place)
    return depth[0] if depth else 8


def _mend_palette_of_bmp(image: Image, file: io.BufferedReader) -> None:
    """Make Pillow read a BMP file with a palette of greys as what it is: Pillow takes entries of 4
    or 8 bits for 1 or 8 bits.
    """
    from PIL import ImagePalette

    place = file.tell()
    file.seek(28)
    bits = int.from_bytes(file.read(2), "little")
    file.seek(place)
    assumed_bits = {"1": 1, "L": 8}.get(image.mode, bits)
    if bits not in {4, 8} or bits == assumed_bits:
        return
    greys = [0, 255] if image.mode == "1" else range(16)
    codec, box, offset, args = image.tile[0]  # type: ignore[attr-defined]
    image._mode = "P"
    image.palette = ImagePalette.raw("RGB", np.repeat(np.array(greys, dtype=np.uint8), 3).tobytes())
    raw = ("P;4" if bits == 4 and codec == "raw" else "P", *args[1:])
    image.tile = [(codec, box, offset, raw)]  # type: ignore[attr-defined]


def _pages(
    path: Path, image: Image, options: MapOptions, most: int | None, *, png_depth: int
) -> Iterator[Page]:
    """Return the pages of a picture that Pillow reads. The size of a page is checked before the
    page is decoded.
    """
    film = (
        image.format == "GIF"
        or int(getattr(image, "n_frames", 1) if image.format == "PNG" else 1) > 1
    )
    if film:
        _check_pixels(path, image, options, most)  # before counting the frames, which decodes them
        image.seek(_frame_of_film(path, image, options))
    else:
        AxisChoices(path, options).check_used("frame")
    for page in range(MAX_LAYERS + 1):
        if page:
            # one page after the other, because counting the pages first would read all their
            # directories
            try:
                image.seek(page)
            except EOFError:
                return
        _check_pixels(path, image, options, most, page + 1)
        if not film:  # a frame of a film may contain only what changes
            _check_tiles(path, image)
        yield from _bands(image, png_depth)
        if image.format != "TIFF":
            return


def _frame_of_film(path: Path, image: Image, options: MapOptions) -> int:
    """Return the index of the chosen frame of a film, whose frames are points in time and no
    layers.
    """
    count = 1
    while count <= MAX_LAYERS:
        try:
            image.seek(count)
        except EOFError:
            break
        count += 1
    return index_of([""] * count, options.frame, where=str(path), axis="frame")


def _check_pixels(
    path: Path, image: Image, options: MapOptions, most: int | None, page: int = 1
) -> None:
    """Refuse a page of too many pixels. The limit of cells counts after scaling, that of bytes
    before.
    """
    height, width = (max(1, round(side * options.scale)) for side in (image.height, image.width))
    check_size(path, *([page] if page > 1 else []), height, width)
    pixels = image.width * image.height
    if pixels > MAX_CELLS and options.scale < 1 and image.format == "JPEG":
        image.draft(image.mode, (width, height))
        pixels = image.width * image.height
    wide = {"1": 1, "L": 1, "P": 1, "I;16": 2}.get(image.mode, 4)
    # A turned picture is in memory twice, and for the ground of transparent pixels a picture is
    # read twice at the same time.
    second_copy = image.has_transparency_data or _is_turned(image)
    check_data(
        path, pixels * wide * (1 + second_copy), most=LARGEST_PICTURE if most is None else most
    )


def _check_tiles(path: Path, image: Image) -> None:
    """Refuse a picture whose file lacks data for some pixels, because the library Pillow would read
    missing pixels as black.
    """
    tiles: list[Any] = getattr(image, "tile", [])
    pixels = sum((right - left) * (low - high) for _, (left, high, right, low), *_ in tiles)
    if tiles and pixels < image.width * image.height:
        raise InvalidInputError(
            f"{path}: expected data for {image.width}x{image.height} pixels, got data for only"
            f" {pixels}"
        )


def _bands(image: Image, png_depth: int) -> Iterator[Page]:
    """Return the rows of a page that Pillow reads, turned as its EXIF orientation says,
    in bands.
    """
    from PIL import ImageOps

    # The tags of a TIFF page are read before the page is decoded: Pillow turns the page and changes
    # its tags.
    tags: Any = image.tag_v2 if image.format == "TIFF" else {}  # type: ignore[attr-defined]
    bits = tags.get(258, (8,))
    bits = png_depth or int(bits[0] if isinstance(bits, tuple) else bits)
    white_is_zero = bool(tags) and int(tags.get(262, 1)) == 0
    palette = None
    image.load()
    if image.mode in {"P", "PA"}:
        palette = _palette_of(image)
    upright = ImageOps.exif_transpose(image) if _is_turned(image) else image
    step = max(1, PIECE // max(1, upright.width))
    for first in range(0, upright.height, step):
        band = upright.crop((0, first, upright.width, min(upright.height, first + step)))
        yield _decode(band, bits, white_is_zero, palette, gif=image.format == "GIF")._replace(
            first_row=first, rows=upright.height
        )


def _is_turned(image: Image) -> bool:
    """Return whether Shoal turns a picture as its EXIF orientation says. Pillow itself turns TIFF
    pages.
    """
    return image.format != "TIFF" and image.getexif().get(ORIENTATION, 1) != 1


def _decode(
    band: Image, bits: int, white_is_zero: bool, palette: NDArray[np.uint8] | None, *, gif: bool
) -> Page:
    """Return the numbers of a band of a page."""
    if palette is not None:
        entries = np.asarray(band if band.mode == "P" else band.getchannel(0))
        return Page(
            entries,
            [""],
            255.0,
            palette=palette,
            numbered=not gif or bool((palette[:, :3] != palette[:, :1]).any()),
        )
    if band.mode in {"CMYK", "YCbCr", "LAB", "HSV", "RGBX", "RGBa", "La"}:
        band = band.convert({"La": "LA", "RGBa": "RGBA"}.get(band.mode, "RGB"))
    elif "transparency" in band.info and band.mode == "RGB":  # one colour stands for "nothing here"
        band = band.convert("RGBA")
    numbers, nothing = np.asarray(band), band.info.get("transparency")
    if band.mode.startswith("I") and isinstance(nothing, int):
        opacity = np.where(numbers == nothing, 0, 65535)
        return Page(np.stack([numbers, opacity], axis=-1).astype(np.uint16), COLOURS["LA"], 65535.0)
    if band.mode == "1":
        page = Page(~numbers if white_is_zero else numbers, [""], 1.0, white_is_zero)
        return page if nothing is None else _with_opacity(page, numbers != bool(nothing))
    white = {"u1": 255.0, "u2": 4095.0 if bits == 12 else 65535.0}.get(numbers.dtype.str[1:])
    if numbers.ndim == 2 and numbers.dtype == np.uint8:
        if bits in {1, 2, 4}:  # Pillow spreads few bits over the range of 8 bits
            white = float(2**bits - 1)
            numbers = numbers // np.uint8(255 // (2**bits - 1))
        if isinstance(nothing, int):  # in the bits of the file, as the numbers are now
            return _with_opacity(Page(numbers, [""], white), numbers != nothing)
        if white_is_zero:
            numbers = np.uint8(white or 0) - numbers
    return Page(
        numbers,
        COLOURS.get(band.mode, [""]),
        white,
        white_is_zero,
        reduced=16 * (bits == 16 and numbers.ndim == 3),
    )


def _with_opacity(page: Page, opaque: Mask) -> Page:
    """Return a grey page in which some pixels are transparent, with two channels."""
    white = np.uint8(page.white or 1)
    numbers = np.stack([page.numbers.astype(np.uint8), opaque * white], axis=-1)
    return page._replace(numbers=numbers, names=COLOURS["LA"])


def _palette_of(image: Image) -> NDArray[np.uint8]:
    """Return the colours and the opacity of the numbers of a picture with a palette."""
    colours = image.getpalette("RGBA") or []
    palette = np.zeros((256, 4), dtype=np.uint8)
    palette[:, 3] = 255
    palette[: len(colours) // 4] = np.reshape(colours[:1024], (-1, 4))
    nothing = image.info.get("transparency")
    if isinstance(nothing, bytes):  # an opacity for each of the first numbers
        palette[: len(nothing), 3] = np.frombuffer(nothing, dtype=np.uint8)[:256]
    elif isinstance(nothing, int):
        palette[nothing, 3] = 0
    return palette


def _orient(numbers: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return an array of pixels as its EXIF orientation says that the picture is seen."""
    if orientation >= 5:
        numbers = numbers.swapaxes(0, 1)
    if orientation in {3, 4, 7, 8}:
        numbers = numbers[::-1]
    if orientation in {2, 3, 6, 7}:
        numbers = numbers[:, ::-1]
    return numbers


@contextmanager
def _by_tifffile(path: Path, options: MapOptions) -> Iterator[Picture]:
    """Open a TIFF file by tifffile."""
    with reading(path, "a TIFF picture"):
        opened = tiff.Tiff(path, options)
    try:
        pixels = opened.size[0] * opened.size[1]
        height, width = (max(1, round(side * options.scale)) for side in opened.size)
        check_size(path, *([opened.depth] if opened.depth > 1 else []), height, width)
        check_data(path, pixels * opened.samples * opened.dtype.itemsize, most=LARGEST_PICTURE)
        spacing = opened.spacing
        if opened.depth == 1 and spacing is not None:
            spacing = (1.0, *spacing[1:])
        complete_spacing = None if spacing is None or spacing[0] is None else spacing
        yield Picture(
            _tiff_pages(opened),
            spacing=complete_spacing,
            channels_chosen=opened.channels_chosen,
            missing=opened.missing,
        )
    finally:
        opened.close()


def _tiff_pages(opened: tiff.Tiff) -> Iterator[Page]:
    white: float | None = None
    if opened.dtype.kind == "b":
        white = 1.0
    elif opened.dtype.kind == "u" and opened.bits <= 16:
        white = float(2**opened.bits - 1)
    names = _tiff_names(opened)
    for page in opened.pages():
        numbers = _orient(
            page[..., 0] if page.ndim == 3 and page.shape[-1] == 1 else page, opened.orientation
        )
        flat = numbers.ndim == 2
        first = 0
        for band in in_pieces(numbers):
            yield Page(
                band,
                [""] if flat else names,
                white,
                opened.white_is_zero and flat,
                first_row=first,
                rows=len(numbers),
            )
            first += len(band)


def _tiff_names(opened: tiff.Tiff) -> list[str]:
    """Return the names of the samples of a pixel by the photometric interpretation of the file."""
    colours = {2: COLOURS["RGB"], 5: COLOURS["CMYK"]}.get(
        opened.photometric, ["grey"] if opened.samples == 2 else []
    )
    names = colours[: opened.samples]
    for number in range(len(names), opened.samples):
        extra = opened.extra[number - len(names)] if number - len(names) < len(opened.extra) else 0
        names = [*names, "alpha" if extra in {1, 2} and number == opened.samples - 1 else ""]
    return names


def scale_of_width(path: Path, width: int, scale: float) -> float | None:
    """Return the scale with which a picture has at most ``width`` cells along its larger side, for
    a very large picture.

    A very large picture becomes smaller while it is read. Returns None for all other files, and for
    TIFF files that are small enough to be maps, which may contain a size of their pixels.
    """
    if path.suffix.lower() not in PICTURES or not path.is_file():
        return None
    try:
        columns, rows = size_of_picture(path)
    except ShoalError:  # the reader of the picture says what is wrong with it
        return None
    larger, cells = max(columns, rows), columns * rows * scale**2
    most = MAX_CELLS if path.suffix.lower().startswith(".tif") else MOST_COUNTED
    return width / larger if cells > most and width < larger * scale else None


def size_of_picture(path: Path) -> tuple[int, int]:
    """Return the columns and rows of a picture, of which only the header is read."""
    from PIL import Image

    refusal = InvalidInputError(
        f"{path.name}: expected a PNG, TIFF, BMP or JPEG picture, got a damaged or other file"
    )
    try:
        with (
            _any_size(),
            warnings.catch_warnings(),
            Image.open(path, formats=[*set(PICTURES.values())]) as image,
        ):
            warnings.simplefilter("ignore")
            return image.size
    except Exception:  # Pillow, as tifffile, raises many kinds of exceptions for damaged files
        if not path.suffix.lower().startswith(".tif"):
            raise refusal from None
    try:
        return tiff.size_of(path)
    except MissingExtraError:
        raise
    except Exception:
        raise refusal from None
