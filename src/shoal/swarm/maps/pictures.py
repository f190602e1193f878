"""Maps as pictures: PNG, TIFF (one layer per page), BMP, JPEG and GIF files, and folders with one picture for each slice."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.notices import tell_once
from shoal.swarm.maps import tiff
from shoal.swarm.maps.reading import (
    MAX_CELLS,
    MAX_LAYERS,
    WHITE,
    MapOptions,
    check_data,
    check_layers,
    check_size,
    index_of,
    reading,
)
from shoal.swarm.maps.resampling import join_diagonals, scale_cells
from shoal.swarm.maps.values import Mask, free_by_brightness, free_by_number
from shoal.swarm.maps.workspace import GridWorkspace

if TYPE_CHECKING:
    from PIL.Image import Image

PICTURES = {
    ".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG", ".gif": "GIF",
}  # fmt: skip
"""Suffixes of pictures, and the names of their formats in Pillow."""

LARGEST_FILE = 2**31  # bytes
SHOWN = 8  # channels that a message lists
MIN_IS_WHITE = "in this file small numbers are white (MinIsWhite), and white is free (--invert takes the large numbers as free)"
LUMA = (0.299, 0.587, 0.114)  # weights of red, green and blue in the brightness, as in Pillow (ITU-R 601)
COLOURS = {
    "RGB": ["red", "green", "blue"],
    "RGBA": ["red", "green", "blue", "alpha"],
    "LA": ["grey", "alpha"],
    "CMYK": ["cyan", "magenta", "yellow", "black"],
    "LAB": ["lightness", "a", "b"],
}
"""Names of the channels of colour pictures, by Pillow's name of the mode."""


class Page(NamedTuple):
    """One layer of a picture.

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
    """

    numbers: NDArray[Any]
    names: list[str]
    white: float | None
    white_is_zero: bool = False
    palette: NDArray[np.uint8] | None = None
    reduced: int = 0


Sides = tuple[float, ...] | None


def read_picture(path: Path, options: MapOptions) -> tuple[Mask, Sides]:
    """Return the free cells of a picture, and the size of a cell if the file contains it. Each page of a TIFF becomes a layer."""
    free, sides = _free_layers([path], options)
    return (free[0], sides and sides[1:]) if len(free) == 1 else (free, sides)


def read_slices(folder: Path, options: MapOptions) -> Mask:
    """Return the free cells of a folder of pictures.

    Each picture becomes a layer. The numbers in the file names give the order of the layers.

    Raises
    ------
    InvalidInputError
        Raised if the folder has no pictures, if the pictures differ in format or size, or if a picture has several pages.
    """
    entries = (path for path in folder.iterdir() if path.suffix.lower() in PICTURES and path.name[0] != ".")
    files = [path for path in islice(entries, MAX_LAYERS + 1) if not path.is_dir()]
    check_layers(folder, len(files))
    if not files:
        raise InvalidInputError(f"{folder}: expected a map file, got a folder without slices ({' '.join(PICTURES)}, or DICOM)")
    kinds = sorted({path.suffix.lower() for path in files})
    if len(kinds) > 1:
        raise InvalidInputError(f"{folder}: expected slices of one kind, got {' and '.join(kinds)}")
    # [0-9] and not str.isdigit, which is true of superscript digits that int refuses
    files.sort(key=lambda path: [int(part) if re.fullmatch("[0-9]+", part) else part for part in re.split("([0-9]+)", path.name)])
    for file in files:
        check_file(file, what="slice", most=LARGEST_FILE)
    return _free_layers(files, options, folder=folder)[0]


def read_pixels(path: Path, *, channel: int | str | None = None, frame: int | None = None) -> NDArray[np.uint8]:
    """Return the pixels of a picture as uint8, with the shape (H, W) for greyscale or (H, W, 3) for colour.

    Parameters
    ----------
    path : path
    channel : int or str, optional
        Channel that is returned alone, as greyscale.
    frame : int, optional
        Point in time, from 1, in a file with a time axis.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing or damaged, or does not contain a picture.
    """
    if path.suffix.lower() not in PICTURES:
        raise InvalidInputError(f"{path}: expected a picture ({' '.join(PICTURES)}), got {path.suffix!r}")
    check_file(path, what="picture", most=LARGEST_FILE)
    options = MapOptions(channel=channel, frame=frame)
    with _opened(path, options) as picture:
        page = next(iter(picture))
        if channel is not None:
            page = _one_channel(page, channel, path)
        opaque = _opaque(page)
        ground = 0.0 if opaque.bright > opaque.dark else 1.0
        if page.numbers.ndim == 3 and page.numbers.dtype == np.uint8 and page.names[:3] == COLOURS["RGB"]:
            return np.ascontiguousarray(_over_ground(page, ground)[..., :3])
        if page.palette is not None:
            colours = page.palette[page.numbers]
            return np.ascontiguousarray(_over_ground(Page(colours, COLOURS["RGBA"], 255.0), ground)[..., :3])
        grey = _brightness(page, ground)
        white = page.white or max(float(np.nanmax(grey, initial=0)), 1e-30)
        _check_finite(path, grey)
        return np.asarray(np.rint(np.clip(255 * (grey / np.float32(white)), 0, 255)), dtype=np.uint8)


def encode_picture(workspace: GridWorkspace, suffix: str) -> bytes:
    """Return the bytes of a picture of a map, in which free cells are white. Each layer of the map becomes a page of a TIFF file.

    Free cells and obstacles remain distinguishable after JPEG compression.
    """
    from PIL import Image

    best: dict[str, Any] = {"quality": 100} if suffix in {".jpg", ".jpeg"} else {}
    layers = workspace.free if workspace.ndim == 3 else workspace.free[np.newaxis]
    first, *others = [Image.fromarray(layer.astype(np.uint8) * 255) for layer in layers]
    if others:
        best = {"save_all": True, "append_images": others, "compression": "tiff_deflate"}
    buffer = io.BytesIO()
    first.save(buffer, format=PICTURES[suffix], **best)
    return buffer.getvalue()


# From pages to cells


def _free_layers(files: list[Path], options: MapOptions, *, folder: Path | None = None) -> tuple[Mask, Sides]:
    """Return the free cells (layers, rows, columns) of the pages of one file, or of files of one page each."""
    where = str(folder or files[0])
    with reading(folder or files[0], "a picture" if folder is None else "pictures"):
        source = _Source(files, options, folder)
        if options.by_number:
            layers = free_by_number(source.numbers, options, where=where)
        else:
            layers = free_by_brightness(source.brightness, source.white(), options, where=where)
        source.tell()
        free = np.stack(layers)
        del layers
        if options.join_diagonals:  # before scaling: a smaller map no longer shows which pixels touched
            free = join_diagonals(free)
        free = scale_cells(free, [1.0, options.scale, options.scale], where=where)
        check_size(where, *free.shape)
    sides = source.spacing
    return free, None if sides is None else tuple(side / (options.scale if axis else 1.0) for axis, side in enumerate(sides))


class _Source:
    """The pages of one or several files, as brightness or as numbers, which can be read several times."""

    def __init__(self, files: list[Path], options: MapOptions, folder: Path | None) -> None:
        self.files, self.options, self.folder = files, options, folder
        self.spacing: tuple[float, float, float] | None = None
        self.ground: float | None = None
        self._notices: dict[str, None] = {}

    def pages(self) -> Iterator[tuple[str, Page]]:
        """Return the name and the content of each page. Refuse pages of different sizes, and too many of them."""
        size: tuple[int, ...] | None = None
        count = 0
        for file in self.files:
            with _opened(file, self.options, layers=len(self.files) if self.folder else None) as picture:
                for number, whole in enumerate(picture, start=1):
                    count += 1
                    check_layers(self.folder or file, count)
                    name = str(file) if self.folder else f"{file}: page {number}"
                    if self.folder and number > 1:
                        raise InvalidInputError(f"{file}: expected a slice, got a picture of several pages")
                    size = size or whole.numbers.shape[:2]
                    if whole.numbers.shape[:2] != size:
                        sides = ["x".join(map(str, reversed(shape))) for shape in (size, whole.numbers.shape[:2])]
                        raise InvalidInputError(f"{name}: expected {sides[0]} pixels as in the first layer, got {sides[1]}")
                    layers = max(count, len(self.files))
                    check_size(self.folder or file, layers, *(max(1, round(side * self.options.scale)) for side in size))
                    check_data(self.folder or file, layers * size[0] * size[1])  # one byte a pixel until the map is scaled
                    by_axis = self.options.channel is None or picture.channels_chosen
                    yield name, whole if by_axis else _one_channel(whole, self.options.channel, file)
                self.spacing = picture.spacing

    def numbers(self) -> Iterator[NDArray[Any]]:
        """Return the numbers of each page, of pages with one number for each pixel."""
        option = "level" if self.options.level is not None else "label"
        for name, page in self.pages():
            yield _single_numbers(page, name, option)

    def white(self) -> float | None:
        """Return the brightness of white, after a look at the first page."""
        for _, page in self.pages():
            return 255.0 if page.palette is not None else page.white
        raise InvalidInputError(f"{self.folder or self.files[0]}: expected a picture, got no pages")

    def brightness(self) -> Iterator[NDArray[Any]]:
        """Return the brightness of each page. Transparent pixels have one ground on all pages."""
        for name, page in self.pages():
            if self.ground is None and _opaque(page).transparent:
                self.ground = self._common_ground()
            if page.white_is_zero:
                self._notices[MIN_IS_WHITE] = None
            with errors_at(name):
                yield _brightness(page, 0.0 if self.ground is None else self.ground)

    def _common_ground(self) -> float:
        """Return the brightness from 0 to 1 that stands for transparent pixels on all pages.

        A drawing on a transparent ground is visible on a ground of the opposite brightness: white lines mean a black ground. The
        ground is therefore the opposite of most opaque pixels.
        """
        seen = [_opaque(page) for _, page in self.pages()]
        ground = 0.0 if sum(one.bright for one in seen) > sum(one.dark for one in seen) else 1.0
        word = "white" if ground else "black"
        self._notices[
            f"transparent pixels count as {word}, the opposite of most other pixels (--channel alpha takes opaque pixels as free)"
        ] = None
        return ground

    def tell(self) -> None:
        """Send the notices about the pages."""
        for text in self._notices:
            tell_once(f"shoal: {self.folder or self.files[0]}: {text}")


def _one_channel(page: Page, channel: int | str | None, path: Path) -> Page:
    """Return one channel of a page as a grey page."""
    where = str(path)
    if page.palette is not None and (page.palette[:, :3] != page.palette[:, :1]).any():
        index = index_of(COLOURS["RGBA"], channel, where=where)
        return Page(page.palette[page.numbers][..., index], [""], 255.0)
    if page.palette is not None:
        index = index_of(COLOURS["LA"] if (page.palette[:, 3] < 255).any() else ["grey"], channel, where=where)
        return Page(page.palette[page.numbers][..., 3 * index], [""], 255.0)
    if page.numbers.ndim == 2:
        index_of(["grey"], channel, where=where)
        return page
    return Page(page.numbers[..., index_of(page.names, channel, where=where)], [""], page.white)


def _single_numbers(page: Page, name: str, option: str) -> NDArray[Any]:
    """Return one number for each pixel: that of the file, or the grey value of a picture of greys only."""
    if page.reduced:
        raise InvalidInputError(
            f"{name}: {option}: expected 8 bits for each channel of a colour picture, got {page.reduced} (--threshold takes a "
            "share of white; a TIFF file keeps all bits)"
        )
    if page.palette is not None:
        used = page.palette[np.unique(page.numbers)]
        if (used[:, :3] == used[:, :1]).all():
            return np.asarray(page.palette[page.numbers][..., 0])
        if option == "label":
            return page.numbers
        raise InvalidInputError(f"{name}: level: expected one number for each pixel, got a palette of colours (--label, --channel)")
    numbers = page.numbers
    if numbers.ndim == 2:
        return numbers
    colours = numbers[..., : 3 if page.names[:1] == ["red"] else 1]
    if page.names[:1] in (["red"], ["grey"]) and (colours == colours[..., :1]).all():
        return colours[..., 0]
    raise InvalidInputError(
        f"{name}: {option}: expected one number for each pixel, got the channels {_listed(page.names)} (choose one by --channel)"
    )


class _Opaque(NamedTuple):
    """The numbers of bright and of dark opaque pixels, and whether there are transparent pixels."""

    bright: float
    dark: float
    transparent: bool


def _opaque(page: Page) -> _Opaque:
    """Return how many opaque pixels of a page are bright, and how many are dark."""
    if page.palette is not None:
        counts = np.bincount(page.numbers.ravel(), minlength=len(page.palette)).astype(np.float64)
        opacity = page.palette[:, 3] / 255
        light = page.palette[:, :3].astype(np.float64) @ LUMA / 255
    elif page.names[-1:] == ["alpha"]:
        white = page.white or 1.0
        opacity = page.numbers[..., -1].ravel() / np.float32(white)
        counts = np.ones(opacity.size, dtype=np.uint8)
        light = (_grey_of(page.numbers[..., :-1]) / np.float32(white)).ravel()
    else:
        return _Opaque(0, 0, False)
    seen = opacity >= 0.5
    bright, dark = (float(counts[seen & side].sum(dtype=np.float64)) for side in (light >= WHITE, light < WHITE))
    return _Opaque(bright, dark, bool(counts[opacity < 1].any()))


def _over_ground(page: Page, ground: float) -> NDArray[Any]:
    """Return the colours of a page with an opacity, drawn over a grey ground (from 0 to 1), without the opacity."""
    if page.names[-1:] != ["alpha"]:
        return page.numbers
    white = page.white or 1.0
    opacity = page.numbers[..., -1:].astype(np.float32) / np.float32(white)
    mixed = page.numbers[..., :-1] * opacity + np.float32(ground * white) * (1 - opacity)
    return np.asarray(np.rint(mixed) if page.numbers.dtype.kind in "ui" else mixed).astype(page.numbers.dtype)


def _brightness(page: Page, ground: float) -> NDArray[Any]:
    """Return the brightness of each pixel of a page. The ground, from 0 to 1, stands for transparent pixels."""
    if page.palette is not None:
        greys = _brightness(Page(page.palette[np.newaxis], COLOURS["RGBA"], 255.0), ground)[0]
        return np.asarray(greys[page.numbers])
    colours = _over_ground(page, ground)
    if colours.ndim == 2 or colours.shape[-1] == 1:
        grey = colours if colours.ndim == 2 else colours[..., 0]
    elif page.names[:3] == COLOURS["RGB"]:
        grey = _grey_of(colours)
    else:
        raise InvalidInputError(
            f"expected a grey or a colour picture, got the channels {_listed(page.names)} (choose one by --channel)"
        )
    if not page.white_is_zero:
        return grey
    if page.white is None:
        raise InvalidInputError("expected a known number of white in a picture whose zero is white, got none (--level N)")
    return grey == 0 if grey.dtype == np.bool_ else np.asarray(np.asarray(page.white, grey.dtype) - grey)


def _listed(names: list[str]) -> str:
    """Return the names of channels as a text; a channel without a name has its number."""
    return ", ".join(name or str(number) for number, name in enumerate(names[:SHOWN], start=1)) + ", …" * (len(names) > SHOWN)


def _grey_of(colours: NDArray[Any]) -> NDArray[Any]:
    """Return the brightness of colours as Pillow computes it for 8 bits: rounded sums of red, green and blue."""
    if colours.shape[-1] == 1:
        return colours[..., 0]
    weighted = colours[..., :3].astype(np.float32) @ np.array(LUMA, dtype=np.float32)
    return np.asarray(np.rint(weighted).astype(colours.dtype) if colours.dtype.kind in "ui" else weighted)


def _check_finite(path: Path, grey: NDArray[Any]) -> None:
    if grey.dtype.kind == "f" and not np.isfinite(grey).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(grey))[0])
        raise InvalidInputError(
            f"{path}: expected finite brightness, got {grey[row, column]} at row {row + 1}, column {column + 1}"
        )


# From files to pages


class _Picture:
    """An open picture: its pages, the size of a pixel, and whether a channel was chosen by an axis of the file."""

    def __init__(self, pages: Iterator[Page], *, spacing: Any = None, channels_chosen: bool = False) -> None:
        self._pages, self.spacing, self.channels_chosen = pages, spacing, channels_chosen

    def __iter__(self) -> Iterator[Page]:
        return self._pages


@contextmanager
def _opened(path: Path, options: MapOptions, *, layers: int | None = None) -> Iterator[_Picture]:
    """Open a picture by Pillow, or by tifffile if Pillow would change its numbers."""
    from PIL import Image, UnidentifiedImageError

    limit = Image.MAX_IMAGE_PIXELS
    gif = path.suffix.lower() == ".gif"
    formats = ("GIF",) if gif else ("PNG", "TIFF", "BMP", "JPEG")
    try:
        Image.MAX_IMAGE_PIXELS = None  # checked here, to raise an error of our own
        with path.open("rb") as file, reading(path, "a picture"):
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
                    _check_pixels(path, image, options, layers)
                    with _by_tifffile(path, options) as picture:
                        yield picture
                    return
                depth = begin_of_png(file) if image.format == "PNG" else 0
                yield _Picture(_pages(path, image, options, layers, png_depth=depth))
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def begin_of_png(file: io.BufferedReader) -> int:
    """Return the number of bits for each channel in the header of a PNG file."""
    place = file.tell()
    file.seek(24)
    depth = file.read(1)
    file.seek(place)
    return depth[0] if depth else 8


def _pages(path: Path, image: Image, options: MapOptions, layers: int | None, *, png_depth: int) -> Iterator[Page]:
    """Return the pages of a picture that Pillow reads. The size of a page is checked before the page is decoded."""
    if image.format == "GIF":
        image.seek(_frame_of_gif(path, image, options))
    elif options.frame is not None:
        raise InvalidInputError(f"{path}: frame: expected no frame for a file without a time axis, got {options.frame}")
    for page in range(MAX_LAYERS + 1):
        if page:
            try:  # one page after the other, because counting the pages first would read all their directories
                image.seek(page)
            except EOFError:
                return
        _check_pixels(path, image, options, layers, page + 1)
        _check_tiles(path, image)
        yield _decoded(image, png_depth)
        if image.format != "TIFF":
            return


def _frame_of_gif(path: Path, image: Image, options: MapOptions) -> int:
    """Return the index of the chosen frame of a film, whose frames are points in time and no layers."""
    count = 1
    while count <= MAX_LAYERS:
        try:
            image.seek(count)
        except EOFError:
            break
        count += 1
    return index_of([""] * count, options.frame, where=str(path), axis="frame")


def _check_pixels(path: Path, image: Image, options: MapOptions, layers: int | None, page: int = 1) -> None:
    """Refuse a page of too many pixels. The limit of cells counts after scaling, that of bytes before."""
    height, width = (max(1, round(side * options.scale)) for side in (image.height, image.width))
    check_size(path, *([page] if page > 1 else []), height, width)
    pixels = image.width * image.height
    if pixels > MAX_CELLS and options.scale < 1 and image.format == "JPEG":
        image.draft(image.mode, (width, height))
        pixels = image.width * image.height
    wide = 4 if image.mode not in {"1", "L", "P", "I;16", "LA", "PA"} else 2 if image.mode == "I;16" else 1
    check_data(path, pixels * wide)


def _check_tiles(path: Path, image: Image) -> None:
    """Refuse a picture whose file lacks data for some pixels, because the library Pillow would read missing pixels as black."""
    tiles: list[Any] = getattr(image, "tile", [])
    told = sum((right - left) * (low - high) for _, (left, high, right, low), *_ in tiles)
    if tiles and told < image.width * image.height:
        raise InvalidInputError(f"{path}: expected data for {image.width}x{image.height} pixels, got data for only {told}")


def _decoded(image: Image, png_depth: int) -> Page:
    """Return a page that Pillow has read, turned as its EXIF orientation says."""
    orientation = 1 if image.format == "TIFF" else int(image.getexif().get(0x0112, 1))
    # For a TIFF page, the tags must be read before the page is decoded: Pillow turns the page and changes its tags.
    tags: Any = image.tag_v2 if image.format == "TIFF" else {}  # type: ignore[attr-defined]
    photometric, bits = int(tags.get(262, 1)), tags.get(258, (8,))
    white_is_zero = bool(tags) and photometric == 0
    bits = int(bits[0] if isinstance(bits, tuple) else bits)
    if image.mode in {"P", "PA"}:
        image.load()
        palette = _palette_of(image)
        numbers = np.asarray(image if image.mode == "P" else image.getchannel(0))
        return Page(_turned(numbers, orientation), [""], 255.0, palette=palette)
    if image.mode in {"CMYK", "YCbCr", "LAB", "HSV", "RGBX", "RGBa", "La"}:
        image = image.convert("LA" if image.mode == "La" else "RGBA" if image.mode == "RGBa" else "RGB")
    elif "transparency" in image.info and image.mode in {"1", "L", "RGB"}:  # one colour stands for "nothing here"
        image = image.convert("RGBA" if image.mode == "RGB" else "LA")
    numbers = _turned(np.asarray(image), orientation)
    if image.mode.startswith("I") and isinstance(nothing := image.info.get("transparency"), int):
        opacity = np.where(numbers == nothing, 0, 65535)
        return Page(np.stack([numbers, opacity], axis=-1).astype(np.uint16), COLOURS["LA"], 65535.0)
    if image.mode == "1":
        return Page(~numbers if white_is_zero else numbers, [""], 1.0, white_is_zero)
    names = COLOURS.get(image.mode, [""])
    white: float | None = {"u1": 255.0, "u2": 65535.0}.get(numbers.dtype.str[1:])
    if image.mode == "I" and image.format == "PNG":
        white = 65535.0
    if numbers.ndim == 2 and numbers.dtype == np.uint8:
        small = png_depth if png_depth in {1, 2, 4} else bits if bits in {2, 4} else 0
        if small:  # Pillow spreads 2 and 4 bits over the range of 8 bits
            white = float(2**small - 1)
            numbers = numbers // np.uint8(255 // (2**small - 1))
        if white_is_zero:
            numbers = np.uint8(white or 0) - numbers
    return Page(numbers, names, white, white_is_zero, reduced=16 if png_depth == 16 and numbers.ndim == 3 else 0)


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


def _turned(numbers: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return an array of pixels as its EXIF orientation says that the picture is seen."""
    if orientation >= 5:
        numbers = numbers.swapaxes(0, 1)
    if orientation in {3, 4, 7, 8}:
        numbers = numbers[::-1]
    if orientation in {2, 3, 6, 7}:
        numbers = numbers[:, ::-1]
    return numbers


@contextmanager
def _by_tifffile(path: Path, options: MapOptions) -> Iterator[_Picture]:
    """Open a TIFF file by tifffile."""
    with reading(path, "a TIFF picture"):
        opened = tiff.Tiff(path, options)
    try:
        pixels = opened.size[0] * opened.size[1]
        height, width = (max(1, round(side * options.scale)) for side in opened.size)
        check_size(path, *([opened.depth] if opened.depth > 1 else []), height, width)
        check_data(path, pixels * opened.samples * opened.dtype.itemsize)
        spacing = opened.spacing
        if opened.depth == 1 and spacing is not None:
            spacing = (1.0, *spacing[1:])
        known = None if spacing is None or spacing[0] is None else spacing
        yield _Picture(_tiff_pages(opened), spacing=known, channels_chosen=opened.channels_chosen)
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
        numbers = _turned(page[..., 0] if page.ndim == 3 and page.shape[-1] == 1 else page, opened.orientation)
        flat = numbers.ndim == 2
        yield Page(numbers, [""] if flat else names, white, opened.white_is_zero and flat)


def _tiff_names(opened: tiff.Tiff) -> list[str]:
    """Return the names of the samples of a pixel by the photometric interpretation of the file."""
    colours = {2: COLOURS["RGB"], 5: COLOURS["CMYK"]}.get(opened.photometric, ["grey"] if opened.samples == 2 else [])
    names = colours[: opened.samples]
    for number in range(len(names), opened.samples):
        extra = opened.extra[number - len(names)] if number - len(names) < len(opened.extra) else 0
        names = [*names, "alpha" if extra in {1, 2} and number == opened.samples - 1 else ""]
    return names
