"""Maps as pictures: PNG, TIFF (one layer per page), BMP, JPEG and GIF files, and folders with one
picture for each slice.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.dataclass import one_line
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.notices import tell_once
from shoal.swarm.maps import tiff
from shoal.swarm.maps.reading import (
    LARGEST_PICTURE,
    MAX_CELLS,
    MAX_LAYERS,
    PIECE,
    WHITE,
    MapOptions,
    check_data,
    check_layers,
    check_size,
    index_of,
    reading,
)
from shoal.swarm.maps.resampling import (
    MOST_COUNTED,
    cells_of_shares,
    join_diagonals,
    scale_cells,
    scaled_shape,
    shares_of_bands,
)
from shoal.swarm.maps.values import Extremes, Mask, free_by_brightness, free_by_number, in_pieces
from shoal.swarm.maps.workspace import GridWorkspace

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
LARGEST_PHOTOGRAPH = 2**27  # bytes of a decoded photograph, whose filters need many times as much
MOST_JOINED = 2**26  # pixels whose diagonal contacts are joined, which needs ten bytes a pixel
ORIENTATION = 0x0112  # EXIF tag
SHOWN = 8  # channels that a message lists
MIN_IS_WHITE = (
    "in this file small numbers are white (MinIsWhite), and white is free (--invert takes the large"
    " numbers as free)"
)
LABELS_OF_PALETTE = "the labels are the entries of the palette (--level takes its greys)"
LEVELS_OF_PALETTE = "the levels are the greys of the palette (--label takes its entries)"
LUMA = (
    0.299,
    0.587,
    0.114,
)  # weights of red, green and blue in the brightness, as in Pillow (ITU-R 601)
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


Sides = tuple[float, ...] | None


def read_picture(path: Path, options: MapOptions) -> tuple[Mask, Sides]:
    """Return the free cells of a picture, and the size of a cell if the file contains it. Each page
    of a TIFF becomes a layer.
    """
    free, sides = _free_layers([path], options)
    return (free[0], sides and sides[1:]) if len(free) == 1 else (free, sides)


def read_slices(folder: Path, options: MapOptions) -> Mask:
    """Return the free cells of a folder of pictures.

    Each picture becomes a layer. The numbers in the file names give the order of the layers.

    Raises
    ------
    InvalidInputError
        Raised if the folder has no pictures, if the pictures differ in format or size, or if a
        picture has several pages.
    """
    entries = (
        path for path in folder.iterdir() if path.suffix.lower() in PICTURES and path.name[0] != "."
    )
    files = [path for path in islice(entries, MAX_LAYERS + 1) if not path.is_dir()]
    check_layers(folder, len(files))
    if not files:
        raise InvalidInputError(
            f"{folder}: expected a map file, got a folder without slices ({' '.join(PICTURES)}, or"
            " DICOM)"
        )
    kinds = sorted({path.suffix.lower() for path in files})
    if len(kinds) > 1:
        raise InvalidInputError(f"{folder}: expected slices of one kind, got {' and '.join(kinds)}")
    # [0-9] and not str.isdigit, which is true of superscript digits that int refuses
    files.sort(
        key=lambda path: [
            int(part) if re.fullmatch("[0-9]+", part) else part
            for part in re.split("([0-9]+)", path.name)
        ]
    )
    for file in files:
        check_file(file, what="slice", most=LARGEST_FILE)
    return _free_layers(files, options, folder=folder)[0]


def read_pixels(
    path: Path, *, channel: int | str | None = None, frame: int | None = None
) -> NDArray[np.uint8]:
    """Return the pixels of a picture as uint8, with the shape (H, W) for greyscale or (H, W, 3) for
    colour.

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
        raise InvalidInputError(
            f"{path}: expected a picture ({' '.join(PICTURES)}), got {path.suffix!r}"
        )
    check_file(path, what="picture", most=LARGEST_FILE)
    options = MapOptions(channel=channel, frame=frame)
    with _opened(path, options, most=LARGEST_PHOTOGRAPH) as picture:
        bands: list[Page] = []
        for band in picture:
            if bands and not band.first_row:
                break  # a second page
            bands.append(
                band
                if channel is None or picture.channels_chosen
                else _one_channel(band, channel, path)
            )
        seen = [_opaque(band) for band in bands]
        ground = 0.0 if sum(one.bright for one in seen) > sum(one.dark for one in seen) else 1.0
        return np.concatenate(_pixels(path, bands, ground))


def _pixels(path: Path, bands: list[Page], ground: float) -> list[NDArray[np.uint8]]:
    """Return the bands of a page as grey values or colours of 8 bits."""
    first = bands[0]
    if first.palette is not None:
        colours = [
            Page(band.palette[band.numbers], COLOURS["RGBA"], 255.0)
            for band in bands
            if band.palette is not None
        ]
        return [_over_ground(band, ground)[..., :3] for band in colours]
    if (
        first.numbers.ndim == 3
        and first.numbers.dtype == np.uint8
        and first.names[:3] == COLOURS["RGB"]
    ):
        return [_over_ground(band, ground)[..., :3] for band in bands]
    with errors_at(path):
        greys = [_brightness(band, ground) for band in bands]
    for band, grey in zip(bands, greys, strict=True):
        if grey.dtype.kind == "f" and not np.isfinite(grey).all():
            row, column = (int(i) for i in np.argwhere(~np.isfinite(grey))[0])
            place = f"row {band.first_row + row + 1}, column {column + 1}"
            raise InvalidInputError(
                f"{path}: expected finite brightness, got {grey[row, column]} at {place}"
            )
    white = np.float32(first.white or max(1e-30, *(float(grey.max(initial=0)) for grey in greys)))
    return [
        np.asarray(np.rint(np.clip(255 * (grey / white), 0, 255)), dtype=np.uint8) for grey in greys
    ]


def scale_of_width(path: Path, width: int, scale: float) -> float | None:
    """Return the scale with which a picture has at most ``width`` cells along its larger side, for
    a very large picture.

    A very large picture becomes smaller while it is read. Returns None for all other files, and for
    TIFF files that are small enough to be maps, which may contain a size of their pixels.
    """
    from PIL import Image

    if path.suffix.lower() not in PICTURES or not path.is_file():
        return None
    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None
        with (
            warnings.catch_warnings(),
            Image.open(path, formats=[*set(PICTURES.values())]) as image,
        ):
            warnings.simplefilter("ignore")
            larger, cells, is_tiff = (
                max(image.size),
                image.width * image.height * scale**2,
                image.format == "TIFF",
            )
    except Exception:  # the reader of the picture says what is wrong with it
        return None
    finally:
        Image.MAX_IMAGE_PIXELS = limit
    return (
        width / larger
        if cells > (MAX_CELLS if is_tiff else MOST_COUNTED) and width < larger * scale
        else None
    )


def encode_picture(workspace: GridWorkspace, suffix: str) -> bytes:
    """Return the bytes of a picture of a map, in which free cells are white. Each layer of the map
    becomes a page of a TIFF file.

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


def _free_layers(
    files: list[Path], options: MapOptions, *, folder: Path | None = None
) -> tuple[Mask, Sides]:
    """Return the free cells (layers, rows, columns) of the pages of one file, or of files of one
    page each.
    """
    where = str(folder or files[0])
    with reading(folder or files[0], "a picture" if folder is None else "pictures"):
        source = _Source(files, options, folder)
        white = source.white()
        large = (
            len(files) * source.cells > MOST_COUNTED
            and options.scale < 1
            and not options.join_diagonals
        )
        if options.by_number:
            bands = free_by_number(source.numbers, options, where=where, packed=large)
        else:
            bands = free_by_brightness(
                source.brightness,
                white,
                options,
                where=where,
                all_masks=source.all_masks,
                packed=large,
            )
        source.tell()
        factors = [1.0, options.scale, options.scale]
        if large:  # the pixels are never in memory together
            sides = bands.size // source.cells, source.rows, source.cells // source.rows
            free = cells_of_shares(
                shares_of_bands(bands.unpacked(), sides, scaled_shape(sides, factors)), where=where
            )
        else:
            free = bands[0] if len(bands) == 1 else np.concatenate(bands)
            del bands
            free = free.reshape(-1, source.rows, free.shape[1])
            if (
                options.join_diagonals
            ):  # before scaling: a smaller map no longer shows which pixels touched
                free = join_diagonals(free)
            free = scale_cells(free, factors, where=where)
        check_size(where, *free.shape)
    size = source.spacing
    return free, (
        None
        if size is None
        else tuple(side / (options.scale if axis else 1.0) for axis, side in enumerate(size))
    )


class _Source:
    """The pages of one or several files, as brightness or as numbers, which can be read several
    times.
    """

    def __init__(self, files: list[Path], options: MapOptions, folder: Path | None) -> None:
        self.files, self.options, self.folder = files, options, folder
        self.spacing: tuple[float, float, float] | None = None
        self.ground: float | None = None
        self.rows = self.cells = 0  # of a page
        self._extremes: list[Extremes] = []  # of each page
        # the small number of a mask whose small numbers are white, if the file has no number of
        # white
        self._lightest: Any = None
        self._begun: tuple[tuple[str, Page], Iterator[tuple[str, Page]]] | None = None
        self._notices: dict[str, None] = {}

    def pages(self) -> Iterator[tuple[str, Page]]:
        """Return the name and the content of each page, in bands. Refuse pages of different sizes,
        and too many of them.
        """
        begun, self._begun = self._begun, None
        if begun is not None:
            yield begun[0]
            yield from begun[1]
        else:
            yield from self._walk()

    def _walk(self) -> Generator[tuple[str, Page], None, None]:
        size: tuple[int, int] | None = None
        count, name = 0, ""
        for file in self.files:
            number = 0
            with _opened(file, self.options) as picture:
                for band in picture:
                    if not band.first_row:
                        count, number = count + 1, number + 1
                        name = str(file) if self.folder else f"{file}: page {number}"
                        size = self._checked(file, band, name, count, number, size)
                    by_axis = self.options.channel is None or picture.channels_chosen
                    yield name, band if by_axis else _one_channel(band, self.options.channel, file)
                self.spacing = picture.spacing

    def _checked(
        self,
        file: Path,
        band: Page,
        name: str,
        count: int,
        number: int,
        size: tuple[int, int] | None,
    ) -> tuple[int, int]:
        """Return the rows and columns of a page, which are those of the pages before."""
        where = self.folder or file
        check_layers(where, count)
        if self.folder and number > 1:
            raise InvalidInputError(f"{file}: expected a slice, got a picture of several pages")
        self.rows = band.rows or len(band.numbers)
        found = (self.rows, band.numbers.shape[1])
        self.cells = found[0] * found[1]
        if size is not None and found != size:
            sides = ["x".join(map(str, reversed(one))) for one in (size, found)]
            raise InvalidInputError(
                f"{name}: expected {sides[0]} pixels as in the first layer, got {sides[1]}"
            )
        layers = max(count, len(self.files))
        check_size(where, layers, *(max(1, round(side * self.options.scale)) for side in found))
        if self.options.join_diagonals and layers * self.cells > MOST_JOINED:
            raise InvalidInputError(
                f"{where}: join-diagonals: expected at most {MOST_JOINED} pixels before scaling,"
                f" got {layers * self.cells}"
            )
        check_data(
            where, layers * found[0] * found[1], most=LARGEST_PICTURE
        )  # one byte a pixel until the map is scaled
        return found

    def numbers(self) -> Iterator[NDArray[Any]]:
        """Return the numbers of each page, of pages with one number for each pixel."""
        option = "level" if self.options.level is not None else "label"
        for name, page in self.pages():
            if page.palette is not None and page.numbered:
                self._notices[LABELS_OF_PALETTE if option == "label" else LEVELS_OF_PALETTE] = None
            yield _single_numbers(page, name, option)

    def white(self) -> float | None:
        """Return the brightness of white, after a look at the first page."""
        pages = self._walk()
        for name, page in pages:
            if page.palette is None and page.white is None and page.white_is_zero:
                pages.close()
                return self._white_of_mask(name)
            self._begun = (name, page), pages  # the first call of `pages` goes on here
            return 255.0 if page.palette is not None else page.white
        raise InvalidInputError(f"{self.folder or self.files[0]}: expected a picture, got no pages")

    def _white_of_mask(self, name: str) -> float:
        """Return the brightness of white in a mask whose small number is white, for numbers without
        a white of their own.
        """
        extremes = Extremes()
        for _, page in self._walk():
            extremes.add(
                page.numbers
                if page.numbers.dtype.kind != "f"
                else page.numbers[~np.isnan(page.numbers)]
            )
        if not extremes.has_two:
            raise InvalidInputError(
                f"{name}: expected a mask of two numbers, or a known number of white, in a picture"
                f" whose small numbers are white, got numbers from {extremes.low} to"
                f" {extremes.high} (--level N)"
            )
        self._lightest = extremes.low
        return 1.0

    def all_masks(self) -> bool:
        """Return whether the pages, of which there are several, are masks of 0 and of one
        brightness each.
        """
        pages = self._extremes
        return (
            len(pages) > 1
            and any(one.has_two for one in pages)
            and all(one.low == one.high or (one.has_two and one.low == 0) for one in pages)
        )

    def brightness(self) -> Iterator[NDArray[Any]]:
        """Return the brightness of each page. Transparent pixels have one ground on all pages."""
        self._extremes = []
        for name, page in self.pages():
            if self.ground is None and _opaque(page).transparent:
                self.ground = self._common_ground()
            if page.white_is_zero:
                self._notices[MIN_IS_WHITE] = None
            with errors_at(name):
                if self._lightest is None:
                    grey = _brightness(page, 0.0 if self.ground is None else self.ground)
                else:
                    grey = _lightness_of_mask(page.numbers, self._lightest)
            if len(self.files) > 1 or self.files[0].suffix.lower() in {".tif", ".tiff"}:
                if not page.first_row:
                    self._extremes.append(Extremes())
                self._extremes[-1].add(grey)
            yield grey

    def _common_ground(self) -> float:
        """Return the brightness from 0 to 1 that stands for transparent pixels on all pages.

        A drawing on a transparent ground is visible on a ground of the opposite brightness: white
        lines mean a black ground. The ground is therefore the opposite of most opaque pixels.
        """
        seen = [_opaque(page) for _, page in self.pages()]
        ground = 0.0 if sum(one.bright for one in seen) > sum(one.dark for one in seen) else 1.0
        word = "white" if ground else "black"
        self._notices[
            f"transparent pixels count as {word}, the opposite of most other pixels (--channel"
            " alpha takes opaque pixels as free)"
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
        return page._replace(
            numbers=page.palette[page.numbers][..., index], names=[""], white=255.0, palette=None
        )
    if page.palette is not None:
        index = index_of(
            COLOURS["LA"] if (page.palette[:, 3] < 255).any() else ["grey"], channel, where=where
        )
        return page._replace(
            numbers=page.palette[page.numbers][..., 3 * index],
            names=[""],
            white=255.0,
            palette=None,
        )
    if page.numbers.ndim == 2:
        index_of(["grey"], channel, where=where)
        return page
    return page._replace(
        numbers=page.numbers[..., index_of(page.names, channel, where=where)], names=[""]
    )


def _single_numbers(page: Page, name: str, option: str) -> NDArray[Any]:
    """Return one number for each pixel: that of the file, or the grey value of a picture of greys
    only.
    """
    if page.reduced:
        raise InvalidInputError(
            f"{name}: {option}: expected 8 bits for each channel of a colour picture, got"
            f" {page.reduced} (--threshold takes a share of white; a TIFF file keeps all bits)"
        )
    if page.palette is not None:
        if (
            option == "label" and page.numbered
        ):  # the same on all pages, whatever colours a page shows
            return page.numbers
        used = page.palette[np.unique(page.numbers)]
        if (used[:, :3] == used[:, :1]).all():
            return np.asarray(page.palette[:, 0][page.numbers])
        raise InvalidInputError(
            f"{name}: level: expected one number for each pixel, got a palette of colours (--label,"
            " --channel)"
        )
    numbers = page.numbers
    if numbers.ndim == 2:
        return numbers
    colours = numbers[..., : 3 if page.names[:1] == ["red"] else 1]
    if page.names[:1] in (["red"], ["grey"]) and (colours == colours[..., :1]).all():
        return colours[..., 0]
    raise InvalidInputError(
        f"{name}: {option}: expected one number for each pixel, got the channels"
        f" {_listed(page.names)} (choose one by --channel)"
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
    bright, dark = (
        float(counts[seen & side].sum(dtype=np.float64)) for side in (light >= WHITE, light < WHITE)
    )
    return _Opaque(bright, dark, bool(counts[opacity < 1].any()))


def _over_ground(page: Page, ground: float) -> NDArray[Any]:
    """Return the colours of a page with an opacity, drawn over a grey ground (from 0 to 1), without
    the opacity.
    """
    if page.names[-1:] != ["alpha"]:
        return page.numbers
    white = page.white or 1.0
    opacity = page.numbers[..., -1:].astype(np.float32) / np.float32(white)
    mixed = page.numbers[..., :-1] * opacity + np.float32(ground * white) * (1 - opacity)
    return np.asarray(np.rint(mixed) if page.numbers.dtype.kind in "ui" else mixed).astype(
        page.numbers.dtype
    )


def _brightness(page: Page, ground: float) -> NDArray[Any]:
    """Return the brightness of each pixel of a page. The ground, from 0 to 1, stands for
    transparent pixels.
    """
    if page.palette is not None:
        greys = _brightness(Page(page.palette[np.newaxis], COLOURS["RGBA"], 255.0), ground)[0]
        return np.asarray(greys[page.numbers])
    colours = _over_ground(page, ground)
    if colours.ndim == 2 or colours.shape[-1] == 1:
        grey = colours if colours.ndim == 2 else colours[..., 0]
    elif page.names[:3] == COLOURS["RGB"]:
        grey = _grey_of(colours)
    elif page.names[:4] == COLOURS["CMYK"]:
        white = np.float32(page.white or 1.0)
        light = (white - colours[..., :3]) * ((white - colours[..., 3:4]) / white)
        grey = (
            np.rint(light @ np.array(LUMA, dtype=np.float32)).astype(colours.dtype)
            if page.white
            else light @ np.array(LUMA)
        )
    else:
        raise InvalidInputError(
            f"expected a grey or a colour picture, got the channels {_listed(page.names)} (choose"
            " one by --channel)"
        )
    if not page.white_is_zero:
        return grey
    if page.white is None:
        raise InvalidInputError(
            "expected a known number of white in a picture whose zero is white, got none"
            " (--level N)"
        )
    return (
        grey == 0
        if grey.dtype == np.bool_
        else np.asarray(np.asarray(page.white, grey.dtype) - grey)
    )


def _lightness_of_mask(numbers: NDArray[Any], lightest: Any) -> NDArray[Any]:
    """Return 1 for the white number of a mask and 0 for the other. NaN stays NaN."""
    light = numbers == lightest
    return (
        np.where(np.isnan(numbers), np.float32(np.nan), light.astype(np.float32))
        if numbers.dtype.kind == "f"
        else light
    )


def _listed(names: list[str]) -> str:
    """Return the names of channels as a text; a channel without a name has its number."""
    return ", ".join(
        name or str(number) for number, name in enumerate(names[:SHOWN], start=1)
    ) + ", …" * (len(names) > SHOWN)


def _grey_of(colours: NDArray[Any]) -> NDArray[Any]:
    """Return the brightness of colours as Pillow computes it for 8 bits: rounded sums of red, green
    and blue.
    """
    if colours.shape[-1] == 1:
        return colours[..., 0]
    weighted = colours[..., :3].astype(np.float32) @ np.array(LUMA, dtype=np.float32)
    return np.asarray(
        np.rint(weighted).astype(colours.dtype) if colours.dtype.kind in "ui" else weighted
    )


# From files to pages


class _Picture:
    """An open picture: its pages, the size of a pixel, and whether a channel was chosen by an axis
    of the file.
    """

    def __init__(
        self, pages: Iterator[Page], *, spacing: Any = None, channels_chosen: bool = False
    ) -> None:
        self._pages, self.spacing, self.channels_chosen = pages, spacing, channels_chosen

    def __iter__(self) -> Iterator[Page]:
        return self._pages


@contextmanager
def _opened(path: Path, options: MapOptions, *, most: int | None = None) -> Iterator[_Picture]:
    """Open a picture by Pillow, or by tifffile if Pillow would change its numbers.

    The argument ``most`` is the maximum number of bytes of a decoded page (by default,
    `LARGEST_PICTURE`).
    """
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
                    f"{path}: expected {words}, got a damaged or other file (it begins with"
                    f" {begin!r})"
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
                depth = begin_of_png(file) if image.format == "PNG" else 0
                yield _Picture(_pages(path, image, options, most, png_depth=depth))
    finally:
        Image.MAX_IMAGE_PIXELS = limit


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


def begin_of_png(file: io.BufferedReader) -> int:
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
    taken = {"1": 1, "L": 8}.get(image.mode, bits)
    if bits not in {4, 8} or bits == taken:
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
    elif options.frame is not None:
        raise InvalidInputError(
            f"{path}: frame: expected no frame for a file without a time axis, got {options.frame}"
        )
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
    twice = image.has_transparency_data or (
        image.format != "TIFF" and image.getexif().get(ORIENTATION, 1) != 1
    )
    check_data(path, pixels * wide * (1 + twice), most=LARGEST_PICTURE if most is None else most)


def _check_tiles(path: Path, image: Image) -> None:
    """Refuse a picture whose file lacks data for some pixels, because the library Pillow would read
    missing pixels as black.
    """
    tiles: list[Any] = getattr(image, "tile", [])
    told = sum((right - left) * (low - high) for _, (left, high, right, low), *_ in tiles)
    if tiles and told < image.width * image.height:
        raise InvalidInputError(
            f"{path}: expected data for {image.width}x{image.height} pixels, got data for only"
            f" {told}"
        )


def _bands(image: Image, png_depth: int) -> Iterator[Page]:
    """Return the rows of a page that Pillow reads, turned as its EXIF orientation says,
    in bands.
    """
    from PIL.Image import Transpose

    turns = {
        2: Transpose.FLIP_LEFT_RIGHT,
        3: Transpose.ROTATE_180,
        4: Transpose.FLIP_TOP_BOTTOM,
        5: Transpose.TRANSPOSE,
        6: Transpose.ROTATE_270,
        7: Transpose.TRANSVERSE,
        8: Transpose.ROTATE_90,
    }
    # The tags of a TIFF page are read before the page is decoded: Pillow turns the page and changes
    # its tags.
    tags: Any = image.tag_v2 if image.format == "TIFF" else {}  # type: ignore[attr-defined]
    bits = tags.get(258, (8,))
    bits = png_depth or int(bits[0] if isinstance(bits, tuple) else bits)
    white_is_zero = bool(tags) and int(tags.get(262, 1)) == 0
    turn = turns.get(int(image.getexif().get(ORIENTATION, 1))) if image.format != "TIFF" else None
    palette = None
    image.load()
    if image.mode in {"P", "PA"}:
        palette = _palette_of(image)
    whole = image if turn is None else image.transpose(turn)
    step = max(1, PIECE // max(1, whole.width))
    for first in range(0, whole.height, step):
        band = whole.crop((0, first, whole.width, min(whole.height, first + step)))
        yield _decoded(band, bits, white_is_zero, palette, gif=image.format == "GIF")._replace(
            first_row=first, rows=whole.height
        )


def _decoded(
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
        check_data(path, pixels * opened.samples * opened.dtype.itemsize, most=LARGEST_PICTURE)
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
        numbers = _turned(
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
