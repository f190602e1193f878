"""Maps as pictures: PNG, TIFF (one layer per page), BMP and JPEG files, and folders with one picture for each slice of a volume."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.swarm.maps.reading import MAX_LAYERS, MapOptions, check_layers, check_size, reading
from shoal.swarm.maps.resampling import block_shares, cells_of_shares, enlarge_cells, join_diagonals, scale_cells, scaled_shape
from shoal.swarm.maps.workspace import GridWorkspace

if TYPE_CHECKING:
    from PIL.Image import Image

T = TypeVar("T")
Layer = NDArray[Any]
PICTURES = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG"}  # names in Pillow
LARGEST_FILE = 2**31  # bytes
MIDDLE = 0.8  # width of the range of brightness, around 0.5, that counts as neither black nor white


def read_picture(path: Path, options: MapOptions) -> NDArray[np.bool_]:
    """Return the free cells of a picture. Each page of a TIFF file becomes a layer of the map."""
    layers = _layers(path, options)
    names = [f"{path}: page {page + 1}" for page in range(len(layers))]
    return _connected(layers[0] if len(layers) == 1 else _stacked(layers, names), path, options)


def read_slices(folder: Path, options: MapOptions) -> NDArray[np.bool_]:
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
        raise InvalidInputError(f"{folder}: expected a map file, got a folder without slices ({' '.join(PICTURES)})")
    kinds = sorted({path.suffix.lower() for path in files})
    if len(kinds) > 1:
        raise InvalidInputError(f"{folder}: expected slices of one kind, got {' and '.join(kinds)}")
    files.sort(key=lambda path: [int(part) if part.isdigit() else part for part in re.split("([0-9]+)", path.name)])
    layers: list[Layer] = []
    for file in files:
        check_file(file, what="slice", most=LARGEST_FILE)
        pages = _layers(file, options)
        if len(pages) > 1:
            raise InvalidInputError(f"{file}: expected a slice, got a picture of {len(pages)} pages")
        layers += pages
        check_size(folder, len(files), *layers[0].shape)
    return _connected(_stacked(layers, list(map(str, files))), folder, options)


def read_pixels(path: Path) -> NDArray[np.uint8]:
    """Return the pixels of a picture as uint8, with the shape (H, W) for greyscale or (H, W, 3) for colour.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing or damaged, or does not contain a picture.
    """
    if path.suffix.lower() not in PICTURES:
        raise InvalidInputError(f"{path}: expected a picture ({' '.join(PICTURES)}), got {path.suffix!r}")
    check_file(path, what="picture", most=LARGEST_FILE)
    return _pages(path, lambda image: _pixels(path, image), most=1)[0]


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


def _pages(path: Path, turn: Callable[[Image], T], *, most: int | None = None) -> list[T]:
    """Return the result of ``turn``, a function of a page, for each page of a picture.

    The sizes of all pages are checked before the first page is decoded.
    """
    from PIL import Image, UnidentifiedImageError

    limit = Image.MAX_IMAGE_PIXELS
    try:
        Image.MAX_IMAGE_PIXELS = None  # checked here, to raise an error of our own
        with path.open("rb") as file, reading(path, "a picture"):
            try:
                image = Image.open(file, formats=("PNG", "TIFF", "BMP", "JPEG"))
            except UnidentifiedImageError:
                file.seek(0)
                raise InvalidInputError(
                    f"{path}: expected a PNG, TIFF, BMP or JPEG picture, "
                    f"got a damaged or other file (it begins with {file.read(8)!r})"
                ) from None
            with image:
                check_size(path, image.height, image.width)
                made: list[T] = []
                for page in range(most or MAX_LAYERS + 1):
                    try:  # one page after the other, because counting the pages first would read all their directories
                        image.seek(page)
                    except EOFError:
                        break
                    check_layers(path, page + 1)
                    check_size(path, page + 1, image.height, image.width)
                    _check_tiles(path, image)
                    made.append(turn(image))
                    if image.format != "TIFF":
                        break
                return made
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _check_tiles(path: Path, image: Image) -> None:
    """Refuse a picture whose file lacks data for some pixels, because the library Pillow would read missing pixels as black."""
    tiles: list[Any] = getattr(image, "tile", [])
    told = sum((right - left) * (low - high) for _, (left, high, right, low), *_ in tiles)
    if tiles and told < image.width * image.height:
        raise InvalidInputError(f"{path}: expected data for {image.width}x{image.height} pixels, got data for only {told}")


def _layers(path: Path, options: MapOptions) -> list[Layer]:
    """Return the layers of a picture: free cells or, if the picture is reduced, the share of free pixels in each cell."""

    def layer(image: Image) -> Layer:
        shape = scaled_shape((image.height, image.width), (options.scale, options.scale))
        check_size(path, *shape)
        free = _free_cells(path, image, options)
        if options.join_diagonals:  # a smaller map no longer shows which pixels touched
            return free
        return block_shares(free, shape) if options.scale < 1 else enlarge_cells(free, shape)

    return _pages(path, layer)


def _connected(layers: Layer, path: Path, options: MapOptions) -> NDArray[np.bool_]:
    """Return the free cells, given the layers of a picture as `_layers` returned them."""
    if options.join_diagonals:
        factors = [1.0] * (layers.ndim - 2) + [options.scale] * 2
        return scale_cells(join_diagonals(layers), factors, where=str(path))
    return layers if layers.dtype == np.bool_ else cells_of_shares(layers, where=str(path))


def _stacked(layers: list[Layer], names: list[str]) -> Layer:
    for name, layer in zip(names, layers, strict=True):
        if layer.shape != layers[0].shape:
            sizes = ["x".join(map(str, reversed(shape))) for shape in (layers[0].shape, layer.shape)]
            raise InvalidInputError(f"{name}: expected {sizes[0]} pixels as in the first layer, got {sizes[1]}")
    return np.stack(layers)


def _free_cells(path: Path, image: Image, options: MapOptions) -> NDArray[np.bool_]:
    grey = _grey(path, image)
    # 8-bit pictures use a table, because brightness as a float would need four times the memory.
    shares = _share(np.arange(256, dtype=np.uint8))
    free = (shares >= options.threshold)[grey] if grey.dtype == np.uint8 else grey >= options.threshold
    sample = grey[:: max(1, grey.shape[0] // 256), :: max(1, grey.shape[1] // 256)]
    middle = np.abs((shares[sample] if grey.dtype == np.uint8 else sample) - 0.5) < MIDDLE / 2
    if middle.mean() > 0.5:
        tell_once(
            f"shoal: warning: {path}: most pixels are neither black nor white, as in a photograph; {100 * free.mean():.3g} % of "
            "them count as free (--vessels finds the vessels of a photograph)"
        )
    return ~free if options.invert else free


def _pixels(path: Path, image: Image) -> NDArray[np.uint8]:
    if _is_deep(image):  # Pillow would clip these values at 255 instead of scaling them
        return np.asarray(np.rint(255 * _share(_grey(path, image))), dtype=np.uint8)
    return np.asarray(image.convert("L" if image.mode in {"1", "L"} else "RGB"))


def _is_deep(image: Image) -> bool:
    """Return whether a picture has more than 8 bits per channel: modes I, I;16, I;16B (big-endian) and F."""
    return image.mode.startswith("I") or image.mode == "F"


def _share(grey: NDArray[Any]) -> NDArray[np.float32]:
    """Return brightness values as fractions from 0 to 1."""
    return grey.astype(np.float32) / np.float32(255) if grey.dtype == np.uint8 else grey


def _grey(path: Path, image: Image) -> NDArray[Any]:
    """Return the brightness of each pixel: uint8 from 0 to 255, or float32 from 0 to 1. Transparent pixels count as white."""
    from PIL import Image as Pillow

    if _is_deep(image):  # 16-bit and float pictures: scaled by the range of the type or of the data
        values = np.asarray(image).astype(np.float32)
        if not np.isfinite(values).all():
            row, column = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
            raise InvalidInputError(
                f"{path}: expected finite brightness, got {values[row, column]} at row {row + 1}, column {column + 1}"
            )
        top = 65535.0 if image.mode != "F" else max(float(values.max(initial=0.0)), 1e-30)
        return np.asarray(np.clip(values / np.float32(top), 0, 1), dtype=np.float32)
    if image.mode == "LAB":  # Pillow converts this mode only to colours
        image = image.convert("RGB")
    if image.has_transparency_data:
        rgba = image.convert("RGBA")
        image = Pillow.alpha_composite(Pillow.new("RGBA", rgba.size, "white"), rgba)
    return np.asarray(image.convert("L"))
