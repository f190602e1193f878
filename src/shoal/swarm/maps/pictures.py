"""Maps as pictures: the free cells of the pages of a picture (one layer per page of a TIFF file),
and of folders with one picture for each slice.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Generator, Iterable, Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.notices import tell_once
from shoal.swarm.maps.pages import COLOURS, LARGEST_FILE, PICTURES, Page, open_picture
from shoal.swarm.maps.reading import (
    LARGEST_PICTURE,
    MAX_LAYERS,
    WHITE,
    Cells,
    MapOptions,
    Mask,
    check_data,
    check_layers,
    check_size,
    index_of,
    map_options,
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
from shoal.swarm.maps.values import Extremes, free_by_brightness, free_by_number
from shoal.swarm.maps.workspace import GridWorkspace

LARGEST_PHOTOGRAPH = 2**27  # bytes of a decoded photograph, whose filters need many times as much
MOST_JOINED = 2**26  # pixels whose diagonal contacts are joined, which needs ten bytes a pixel
SHOWN = 8  # channels that a message lists
MIN_IS_WHITE = {  # by whether free cells and obstacles are exchanged
    False: (
        "in this file small numbers are white (MinIsWhite), and white is free (--invert takes the"
        " large numbers as free)"
    ),
    True: (
        "in this file small numbers are white (MinIsWhite), and --invert takes the large numbers as"
        " free"
    ),
}
LABELS_OF_PALETTE = "the labels are the entries of the palette (--level takes its greys)"
LEVELS_OF_PALETTE = "the levels are the greys of the palette (--label takes its entries)"
# weights of red, green and blue in the brightness, as in Pillow (ITU-R 601)
LUMA = (0.299, 0.587, 0.114)
# least opacity of the pixels that tell the ground behind transparent ones; in faint drawings
_OPAQUE, _FAINT = 0.5, 1e-6


def read_picture(path: Path, options: MapOptions) -> Cells:
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
            int(token) if re.fullmatch("[0-9]+", token) else token
            for token in re.split("([0-9]+)", path.name)
        ]
    )
    _tell_of_gaps(folder, files)
    for file in files:
        check_file(file, what="slice", most=LARGEST_FILE)
    return _free_layers(files, options, folder=folder)[0]


def _tell_of_gaps(folder: Path, files: list[Path]) -> None:
    """Tell if the numbers of slices, of which one number in the names counts them, have a gap."""
    names = [re.split("([0-9]+)", path.name) for path in files]
    if len({len(parts) for parts in names}) > 1:
        return
    columns = [column for column in zip(*names, strict=True) if len({*column}) > 1]
    if len(columns) != 1 or not all(re.fullmatch("[0-9]+", digits) for digits in columns[0]):
        return
    numbers = [int(digits) for digits in columns[0]]
    step = min(np.diff(numbers))
    gap = next(
        (number for number, following in pairwise(numbers) if following - number > step), None
    )
    if gap is not None and len(numbers) > 2:
        tell_once(
            f"shoal: warning: {folder}: no picture has the number {gap + step}; a slice may be"
            " missing"
        )


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
    options = map_options({"channel": channel, "frame": frame})
    with open_picture(path, options, most=LARGEST_PHOTOGRAPH) as picture:
        bands: list[Page] = []
        for band in picture:
            if bands and not band.first_row:
                break  # a second page
            bands.append(
                band
                if channel is None or picture.channels_chosen
                else _one_channel(band, channel, path)
            )
        with errors_at(path):
            ground = _ground_of(lambda: bands)
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


def encode_picture(workspace: GridWorkspace, suffix: str) -> bytes:
    """Return the bytes of a picture of a map, in which free cells are white. Each layer of the map
    becomes a page of a TIFF file.

    Free cells and obstacles remain distinguishable after JPEG compression. A TIFF file holds the
    size of a cell as files of ImageJ do.
    """
    from PIL import Image

    best: dict[str, Any] = {"quality": 100} if suffix in {".jpg", ".jpeg"} else {}
    layers = workspace.free if workspace.ndim == 3 else workspace.free[np.newaxis]
    first, *others = [Image.fromarray(layer.astype(np.uint8) * 255) for layer in layers]
    if others:
        best = {"save_all": True, "append_images": others, "compression": "tiff_deflate"}
    if workspace.spacing is not None and PICTURES[suffix] == "TIFF":
        *between, height, width = workspace.spacing
        metadata = ["ImageJ=1.54", f"images={len(layers)}", f"slices={len(layers)}", "unit=mm"]
        metadata += [f"spacing={distance!r}" for distance in between]
        # TIFF: ImageDescription, XResolution and YResolution in pixels a unit, ResolutionUnit none
        best["tiffinfo"] = {
            270: "\n".join([*metadata, ""]),
            282: 1 / width,
            283: 1 / height,
            296: 1,
        }
    buffer = io.BytesIO()
    first.save(buffer, format=PICTURES[suffix], **best)
    return buffer.getvalue()


# From pages to cells


def _free_layers(files: list[Path], options: MapOptions, *, folder: Path | None = None) -> Cells:
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
                number_of=lambda grey: white - grey if source.white_is_zero and white else grey,
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
            # before scaling: a smaller map no longer shows which pixels touched
            if options.join_diagonals:
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
        self.white_is_zero = False
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
            with open_picture(file, self.options) as picture:
                for band in picture:
                    if not band.first_row:
                        count, number = count + 1, number + 1
                        name = str(file) if self.folder else f"{file}: page {number}"
                        size = self._check_page(file, band, name, count, number, size)
                    by_axis = self.options.channel is None or picture.channels_chosen
                    page = band if by_axis else _one_channel(band, self.options.channel, file)
                    yield name, _without_missing(page, picture.missing)
                self.spacing = picture.spacing

    def _check_page(
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
        extent = (self.rows, band.numbers.shape[1])
        self.cells = extent[0] * extent[1]
        if size is not None and extent != size:
            sides = ["x".join(map(str, reversed(pair))) for pair in (size, extent)]
            raise InvalidInputError(
                f"{name}: expected {sides[0]} pixels as in the first layer, got {sides[1]}"
            )
        layers = max(count, len(self.files))
        check_size(where, layers, *(max(1, round(side * self.options.scale)) for side in extent))
        if self.options.join_diagonals and layers * self.cells > MOST_JOINED:
            raise InvalidInputError(
                f"{where}: join-diagonals: expected at most {MOST_JOINED} pixels before scaling,"
                f" got {layers * self.cells}"
            )
        # one byte a pixel until the map is scaled
        check_data(where, layers * extent[0] * extent[1], most=LARGEST_PICTURE)
        return extent

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
            and any(page.has_two for page in pages)
            and all(page.low == page.high or (page.has_two and page.low == 0) for page in pages)
        )

    def brightness(self) -> Iterator[NDArray[Any]]:
        """Return the brightness of each page. Transparent pixels have one ground on all pages."""
        self._extremes = []
        for name, page in self.pages():
            if self.ground is None and _opaque(page).transparent:
                self.ground = self._common_ground()
            if page.white_is_zero:
                self.white_is_zero = True
                self._notices[MIN_IS_WHITE[self.options.invert]] = None
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

        Raises
        ------
        InvalidInputError
            If no pixel can be seen.
        """
        with errors_at(str(self.folder or self.files[0])):
            ground = _ground_of(lambda: (page for _, page in self.pages()))
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


def _without_missing(page: Page, missing: float | None) -> Page:
    """Return a grey page in which NaN takes the place of the number that stands for a missing one. In
    masks this is often 0, which is an obstacle by itself.
    """
    if not missing or page.numbers.ndim != 2 or page.palette is not None:
        return page
    nearest = np.float32(missing) if page.numbers.dtype == np.float32 else missing
    numbers = page.numbers.astype(np.promote_types(page.numbers.dtype, np.float32))
    numbers[page.numbers == nearest] = np.nan
    return page._replace(numbers=numbers)


def _one_channel(page: Page, channel: int | str | None, path: Path) -> Page:
    """Return one channel of a page as a grey page."""
    where = str(path)
    if page.palette is not None:
        colours = page.palette[:, :3]
        if (colours != colours[:, :1]).any():
            names, columns = COLOURS["RGBA"], [0, 1, 2, 3]
        elif (page.palette[:, 3] < 255).any():
            names, columns = COLOURS["LA"], [0, 3]
        else:
            names, columns = ["grey"], [0]
        entries = page.palette[:, columns[index_of(names, channel, where=where)]]
        return page._replace(numbers=entries[page.numbers], names=[""], white=255.0, palette=None)
    if page.numbers.ndim == 2:
        index_of(["grey"], channel, where=where)
        return page
    index = index_of(page.names, channel, where=where)
    return page._replace(numbers=page.numbers[..., index], names=[""])


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
        # the same on all pages, whatever colours a page shows
        if option == "label" and page.numbered:
            return page.numbers
        entries = page.palette[np.unique(page.numbers)]
        if not (entries[:, :3] == entries[:, :1]).all():
            raise InvalidInputError(
                f"{name}: level: expected one number for each pixel, got a palette of colours"
                " (--label, --channel)"
            )
        _check_seen(entries[:, 0], entries[:, 3] < 255, name, option)
        return np.asarray(page.palette[:, 0][page.numbers])
    numbers = page.numbers
    if numbers.ndim == 2:
        return numbers
    colours = numbers[..., : 3 if page.names[:1] == ["red"] else 1]
    if page.names[:1] in (["red"], ["grey"]) and (colours == colours[..., :1]).all():
        if page.names[-1:] == ["alpha"]:
            _check_seen(colours[..., 0], numbers[..., -1] < (page.white or 1.0), name, option)
        return colours[..., 0]
    raise InvalidInputError(
        f"{name}: {option}: expected one number for each pixel, got the channels"
        f" {_channel_list(page.names)} (choose one by --channel)"
    )


def _check_seen(
    numbers: NDArray[Any], transparent: NDArray[np.bool_], name: str, option: str
) -> None:
    """Refuse numbers that transparent pixels hide, unless one number stands for these alone."""
    hidden = np.unique(numbers[transparent])
    if len(hidden) > 1 or np.isin(hidden, numbers[~transparent]).any():
        raise InvalidInputError(
            f"{name}: {option}: expected opaque pixels, because the number of a transparent one is"
            " not seen, got transparent ones (--channel alpha takes opaque pixels as free)"
        )


def _ground_of(pages: Callable[[], Iterable[Page]]) -> float:
    """Return the brightness from 0 to 1 of the ground behind transparent pixels.

    A drawing on a transparent ground is visible on a ground of the opposite brightness: white lines
    mean a black ground. The ground is therefore the opposite of most opaque pixels or, in a faint
    drawing without any, of most visible pixels.

    Raises
    ------
    InvalidInputError
        If all pixels are wholly transparent.
    """
    for least in (_OPAQUE, _FAINT):
        opaque = [_opaque(page, least) for page in pages()]
        bright, dark = (sum(getattr(page, side) for page in opaque) for side in ("bright", "dark"))
        if bright or dark or not any(page.transparent for page in opaque):
            return 0.0 if bright > dark else 1.0
    raise InvalidInputError(
        "expected pixels that can be seen, got transparent ones only (--channel reads one channel)"
    )


class _Opaque(NamedTuple):
    """The numbers of bright and of dark opaque pixels, and whether there are transparent pixels."""

    bright: float
    dark: float
    transparent: bool


def _opaque(page: Page, least: float = _OPAQUE) -> _Opaque:
    """Return how many pixels of a page with at least this opacity are bright, and how many are
    dark.
    """
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
    opaque = opacity >= least
    bright, dark = (
        float(counts[opaque & side].sum(dtype=np.float64))
        for side in (light >= WHITE, light < WHITE)
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
            "expected a grey or a colour picture, got the channels"
            f" {_channel_list(page.names)} (choose one by --channel)"
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


def _channel_list(names: list[str]) -> str:
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
    luma = colours[..., :3].astype(np.float32) @ np.array(LUMA, dtype=np.float32)
    return np.asarray(np.rint(luma).astype(colours.dtype) if colours.dtype.kind in "ui" else luma)
