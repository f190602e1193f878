"""Read and write maps: pictures and stacks of them, text, MovingAI ``.map``, ``.npy``, CSV and NIfTI."""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.files import atomic
from shoal.swarm.maps.volumes import NIFTI, VolumeOptions, nifti_bytes, read_nifti, slices_of, suffix_of
from shoal.swarm.maps.workspace import MAX_CELLS, GridWorkspace

if TYPE_CHECKING:
    from PIL.Image import Image

PICTURES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg")
_PILLOW_NAMES = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG"}
_LARGEST_FILE = 2**31


@dataclass(frozen=True)
class PictureOptions:
    """How a picture becomes a map.

    Parameters
    ----------
    threshold : float
        0 to 1: pixels at least this bright are free (black 0, white 1).
    invert : bool
        Dark pixels are free instead.
    scale : float
        Above 0: the map has this many cells a pixel along each side, 0.5 halves both.
    """

    threshold: float = 0.5
    invert: bool = False
    scale: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.threshold <= 1:
            raise InvalidInputError(f"threshold: expected 0 to 1, got {self.threshold:g}")
        if not 0 < self.scale <= 64:
            raise InvalidInputError(f"scale: expected above 0 and at most 64, got {self.scale:g}")


def read_map(
    path: str | os.PathLike[str],
    *,
    threshold: float = 0.5,
    invert: bool = False,
    scale: float = 1.0,
    level: float | None = None,
    label: int | None = None,
) -> GridWorkspace:
    """Read a workspace from a file; the suffix says the format.

    Parameters
    ----------
    path : path
        ``.png .tif .tiff .bmp .jpg .jpeg`` (bright is free), ``.txt`` (``.`` free, ``#`` obstacle), ``.map`` (MovingAI: ``.``,
        ``G``, ``S`` free), ``.npy`` (2-D or 3-D, not zero is free), ``.csv`` (1 free, 0 obstacle), or ``.nii .nii.gz`` (3-D, not
        zero is free; the size of a voxel is kept). A TIFF of several pages and a folder of pictures are 3-D: a layer each.
    threshold, invert, scale
        For pictures; see `PictureOptions`.
    level, label
        For ``.npy`` and NIfTI; see `shoal.swarm.maps.volumes.VolumeOptions`.

    Returns
    -------
    GridWorkspace
        Named as the file, without its suffix.

    Raises
    ------
    InvalidInputError
        If the file is missing, unreadable, damaged, of another format, too large, or has no free cell; the message says where.
    """
    source = Path(path)
    options = PictureOptions(threshold, invert, scale)
    numbers, suffix = VolumeOptions(level, label), suffix_of(source)
    folder, spacing = bool(source.name) and os.path.isdir(source), None  # unlike Path.is_dir it takes names of any length
    if not folder and suffix not in (*_READERS, *PICTURES, *NIFTI, ".npy"):
        known = " ".join((*PICTURES, *_READERS, ".npy", *NIFTI))
        raise InvalidInputError(f"{source}: expected a map file ({known}), got the suffix {suffix!r}")
    try:
        if folder:
            free = _read_slices(source, options)
        else:
            _check_file(source, "map")
            if suffix in NIFTI:
                free, spacing = read_nifti(source, numbers)
            elif suffix == ".npy":
                free = numbers.free(_read_npy(source), source)
            else:
                free = _read_picture(source, options) if suffix in PICTURES else _READERS[suffix](source)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    try:
        return GridWorkspace(free, name=name_of(source), spacing=spacing)
    except InvalidInputError as error:
        raise InvalidInputError(f"{source}: {error}") from None


def name_of(path: Path) -> str:
    """Return the name of a file without its suffix, fit for any output: bytes of it that are no text become "?"."""
    stem = path.name[: -len(".nii.gz")] if suffix_of(path) == ".nii.gz" else path.stem
    return stem.encode("utf-8", "replace").decode()


def _check_file(path: Path, what: str) -> None:
    """Refuse what is no file, or one that cannot be a map or picture by its size alone."""
    if not path.is_file():
        raise InvalidInputError(f"{path}: expected a {what} file, got {'a folder' if path.is_dir() else 'no such file'}")
    size = path.stat().st_size
    if size == 0:
        raise InvalidInputError(f"{path}: expected a {what}, got an empty file")
    if size > _LARGEST_FILE:
        raise InvalidInputError(f"{path}: expected a file of at most 2 GiB, got {size} bytes")


def read_pixels(path: str | os.PathLike[str]) -> NDArray[np.uint8]:
    """Return the pixels of a picture; uint8, shape (H, W) if it is grey, else (H, W, 3).

    Raises
    ------
    InvalidInputError
        As `read_map`.
    """
    source = Path(path)
    if source.suffix.lower() not in PICTURES:
        raise InvalidInputError(f"{source}: expected a picture ({' '.join(PICTURES)}), got {source.suffix!r}")
    try:
        _check_file(source, "picture")
        image = _open_picture(source)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    if _is_deep(image):  # Pillow would clip these at 255, not scale them
        return np.asarray(np.rint(255 * _grey(source, image)), dtype=np.uint8)
    return np.asarray(image.convert("L" if image.mode in {"1", "L"} else "RGB"))


def _open_picture(path: Path) -> Image:
    """Open and decode a picture, checking its size before it is decoded."""
    from PIL import Image, UnidentifiedImageError

    limit = Image.MAX_IMAGE_PIXELS
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what Pillow warns of is either an error below or harmless
        try:
            Image.MAX_IMAGE_PIXELS = None  # checked here, with a sentence of our own
            with Image.open(file, formats=("PNG", "TIFF", "BMP", "JPEG")) as image:
                if image.width * image.height > MAX_CELLS:
                    raise InvalidInputError(
                        f"{path}: expected a picture of at most {MAX_CELLS} pixels, got {image.width}x{image.height}"
                    )
                image.load()
                return image
        except UnidentifiedImageError:
            file.seek(0)
            raise InvalidInputError(
                f"{path}: expected a PNG, TIFF, BMP or JPEG picture, "
                f"got a damaged one or another format (it begins with {file.read(8)!r})"
            ) from None
        except InvalidInputError:
            raise
        except Exception as error:  # Pillow's readers raise many kinds for damaged files
            raise InvalidInputError(f"{path}: the picture is damaged: {_one_line(error)}") from None
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _read_picture(path: Path, options: PictureOptions) -> NDArray[np.bool_]:
    image = _open_picture(path)
    pages = _pages_of(path) if path.suffix.lower() in {".tif", ".tiff"} else 1
    return _read_pages(path, options, pages) if pages > 1 else _free_of(path, image, options)


def _pages_of(path: Path) -> int:
    """Return the number of pages of a TIFF whose first one has been read."""
    from PIL import Image

    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(file, formats=("TIFF",)) as image:
                return int(getattr(image, "n_frames", 1))
        except Exception as error:  # as above
            raise InvalidInputError(f"{path}: the picture is damaged: {_one_line(error)}") from None


def _free_of(path: Path, image: Image, options: PictureOptions) -> NDArray[np.bool_]:
    grey = _grey(path, image)
    if options.scale != 1.0:
        size = tuple(max(1, round(side * options.scale)) for side in image.size)
        if size[0] * size[1] > MAX_CELLS:
            raise InvalidInputError(f"{path}: expected at most {MAX_CELLS} cells, got {size[0]}x{size[1]} after scaling")
        from PIL import Image

        grey = np.asarray(Image.fromarray(grey).resize((size[0], size[1]), Image.Resampling.BOX))
    free = grey >= options.threshold
    return ~free if options.invert else free


def _read_pages(path: Path, options: PictureOptions, pages: int) -> NDArray[np.bool_]:
    """Return the pages of a TIFF as layers."""
    from PIL import Image

    layers = []
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with Image.open(file, formats=("TIFF",)) as image:
                _check_stack(path, pages, image.height, image.width)
                for page in range(pages):
                    image.seek(page)
                    layers.append(_free_of(path, image.copy(), options))
        except InvalidInputError:
            raise
        except Exception as error:  # as above
            raise InvalidInputError(f"{path}: page {len(layers) + 1} is damaged: {_one_line(error)}") from None
    return _stacked(layers, lambda layer: f"{path}: page {layer + 1}")


def _read_slices(folder: Path, options: PictureOptions) -> NDArray[np.bool_]:
    """Return the pictures of a folder as layers."""
    files = slices_of(folder, PICTURES)
    first = _read_picture(files[0], options)
    if first.ndim != 2:
        raise InvalidInputError(f"{files[0]}: expected a slice, got a picture of {len(first)} pages")
    _check_stack(folder, len(files), *first.shape)
    layers = [first, *(_read_picture(file, options) for file in files[1:])]
    return _stacked(layers, lambda layer: str(files[layer]))


def _check_stack(path: Path, layers: int, height: int, width: int) -> None:
    if layers * height * width > MAX_CELLS:
        raise InvalidInputError(f"{path}: expected at most {MAX_CELLS} cells, got {layers} layers of {width}x{height}")


def _stacked(layers: list[NDArray[np.bool_]], where: Callable[[int], str]) -> NDArray[np.bool_]:
    for number, layer in enumerate(layers):
        if layer.shape != layers[0].shape:
            sizes = ["x".join(map(str, reversed(shape))) for shape in (layers[0].shape, layer.shape)]
            raise InvalidInputError(f"{where(number)}: expected {sizes[0]} pixels as in the first layer, got {sizes[1]}")
    return np.stack(layers)


def _is_deep(image: Image) -> bool:
    """Tell whether a picture has more than 8 bits a channel: modes I, I;16, I;16B (big-endian) and F."""
    return image.mode.startswith("I") or image.mode == "F"


def _grey(path: Path, image: Image) -> NDArray[np.float32]:
    """Return brightness 0 to 1; transparent pixels count as white."""
    from PIL import Image as Pillow

    if _is_deep(image):  # 16-bit and float pictures: full range of the type, or of the data
        values = np.asarray(image).astype(np.float32)
        if not np.isfinite(values).all():
            row, column = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
            raise InvalidInputError(
                f"{path}: expected finite brightness, got {values[row, column]} at row {row + 1}, column {column + 1}"
            )
        top = 65535.0 if image.mode != "F" else max(float(values.max(initial=0.0)), 1e-30)
        return np.asarray(np.clip(values / np.float32(top), 0, 1), dtype=np.float32)
    if image.mode == "LAB":  # Pillow converts it to colours only
        image = image.convert("RGB")
    if image.has_transparency_data:
        rgba = image.convert("RGBA")
        image = Pillow.alpha_composite(Pillow.new("RGBA", rgba.size, "white"), rgba)
    return np.asarray(image.convert("L"), dtype=np.float32) / np.float32(255)


def _text_lines(path: Path) -> list[str]:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{path}: expected text, got the byte {error.object[error.start]:#04x}") from None
    return text.replace("\r\n", "\n").rstrip("\n").split("\n")


def _grid(path: Path, lines: list[str], first_line: int, free: str, blocked: str) -> NDArray[np.bool_]:
    """Turn lines of equal length into cells; errors name line and column."""
    width = len(lines[0]) if lines else 0
    if not width:
        raise InvalidInputError(f"{path}, line {first_line}: expected a row of cells, got an empty line")
    _check_cells(path, len(lines), width)
    table = {ord(letter): True for letter in free} | {ord(letter): False for letter in blocked}
    for number, line in enumerate(lines, start=first_line):
        if len(line) != width:
            raise InvalidInputError(f"{path}, line {number}: expected {width} cells as in the first row, got {len(line)}")
        for column, letter in enumerate(line, start=1):
            if ord(letter) not in table:
                raise InvalidInputError(
                    f"{path}, line {number}, column {column}: expected one of {free + blocked!r}, got {letter!r}"
                )
    return np.array([[table[ord(letter)] for letter in line] for line in lines], dtype=np.bool_)


def _check_cells(path: Path, rows: int, columns: int) -> None:
    if rows * columns > MAX_CELLS:
        raise InvalidInputError(f"{path}: expected at most {MAX_CELLS} cells, got {rows} rows of {columns}")


def _read_text(path: Path) -> NDArray[np.bool_]:
    return _grid(path, _text_lines(path), 1, free=".", blocked="#")


def _read_movingai(path: Path) -> NDArray[np.bool_]:
    lines = _text_lines(path)
    sizes: dict[str, int] = {}
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words == ["map"]:
            body = lines[number:]
            break
        if len(words) == 2 and words[0] in {"height", "width"} and re.fullmatch("[0-9]{1,9}", words[1]):
            sizes[words[0]] = int(words[1])
        elif not (len(words) == 2 and words[0] == "type"):
            raise InvalidInputError(
                f"{path}, line {number}: expected 'type NAME', 'height N', 'width N' or 'map', got {line[:40]!r}"
            )
    else:
        raise InvalidInputError(f"{path}: expected a line 'map' after the header, got none in {len(lines)} lines")
    if not body:
        raise InvalidInputError(f"{path}, line {number + 1}: expected a row of cells after 'map', got the end of the file")
    cells = _grid(path, body, number + 1, free=".GS", blocked="@OTW")
    for key, got in (("height", cells.shape[0]), ("width", cells.shape[1])):
        if sizes.get(key, got) != got:
            raise InvalidInputError(f"{path}: expected {key} {sizes[key]} as the header says, got {got}")
    return cells


def _read_npy(path: Path) -> NDArray[Any]:
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers that Python 2 wrote and of names of types that have gone out of use
        try:
            version = np.lib.format.read_magic(file)
            header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
            shape, _, dtype = header(file)
            if len(shape) not in (2, 3) or dtype.kind not in "biuf":
                raise InvalidInputError(f"{path}: expected a 2-D or 3-D array of booleans or numbers, got {dtype} {shape}")
            cells = int(np.prod(shape, dtype=object))
            if cells > MAX_CELLS:
                raise InvalidInputError(f"{path}: expected at most {MAX_CELLS} cells, got {shape}")
            expected, got = cells * dtype.itemsize, path.stat().st_size - file.tell()
            if got < expected:
                raise InvalidInputError(f"{path}: expected {expected} bytes of {dtype} {shape}, got {got}: the file is cut off")
            file.seek(0)
            return np.asarray(np.load(file, allow_pickle=False))
        except InvalidInputError:
            raise
        except Exception as error:  # NumPy's header parser raises several kinds
            raise InvalidInputError(f"{path}: expected a NumPy array file (.npy): {_one_line(error)}") from None


def _read_csv(path: Path) -> NDArray[np.bool_]:
    rows: list[list[bool]] = []
    lines = _text_lines(path)
    for number, line in enumerate(lines, start=1):
        values = [value.strip() for value in line.split(",")]
        if number == 1:
            _check_cells(path, len(lines), len(values))
        for column, value in enumerate(values, start=1):
            if value not in {"0", "1"}:
                raise InvalidInputError(f"{path}, line {number}, column {column}: expected 0 or 1, got {value[:20]!r}")
        if rows and len(values) != len(rows[0]):
            raise InvalidInputError(f"{path}, line {number}: expected {len(rows[0])} cells as in the first row, got {len(values)}")
        rows.append([value == "1" for value in values])
    return np.array(rows, dtype=np.bool_)


_READERS: dict[str, Callable[[Path], NDArray[Any]]] = {
    ".txt": _read_text,
    ".map": _read_movingai,
    ".csv": _read_csv,
}


def write_map(workspace: GridWorkspace, path: str | os.PathLike[str]) -> None:
    """Write a workspace; the suffix says the format, as for `read_map`, which reads the same cells back.

    Of these ``.npy``, ``.tif`` and NIfTI take three dimensions. JPEG is written at its best quality, which keeps black and
    white apart.

    Raises
    ------
    InvalidInputError
        For another suffix, or a workspace of dimensions that the format does not take.
    MissingExtraError
        For NIfTI without nibabel.
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    target = Path(path)
    suffix = suffix_of(target)
    writable = [*PICTURES, *_READERS, ".npy", *NIFTI]
    if suffix not in writable:
        raise InvalidInputError(f"{target}: expected one of the suffixes {' '.join(writable)}, got {suffix!r}")
    if workspace.ndim != 2 and suffix not in {".npy", ".tif", ".tiff", *NIFTI}:
        raise InvalidInputError(f"{target}: expected .npy, .tif, .nii or .nii.gz for a 3-D workspace, got {suffix!r}")
    if workspace.ndim != 3 and suffix in NIFTI:
        raise InvalidInputError(f"{target}: expected a 3-D workspace for {suffix}, got 2-D")
    with atomic(target) as temporary:
        # Encoded in memory first: Pillow does not notice when a full disk takes only a part of what it writes.
        temporary.write_bytes(_encoded(workspace, suffix))


def _encoded(workspace: GridWorkspace, suffix: str) -> bytes:
    """Return the bytes of a map file."""
    if suffix in NIFTI:
        return nifti_bytes(workspace, compressed=suffix.endswith(".gz"))
    if suffix in _READERS:
        return _as_text(workspace, suffix).encode()
    buffer = io.BytesIO()
    if suffix == ".npy":
        np.save(buffer, workspace.free)
    else:
        from PIL import Image

        best: dict[str, Any] = {"quality": 100} if suffix in {".jpg", ".jpeg"} else {}
        layers = workspace.free if workspace.ndim == 3 else workspace.free[np.newaxis]
        first, *others = [Image.fromarray(layer.astype(np.uint8) * 255) for layer in layers]
        if others:
            best = {"save_all": True, "append_images": others, "compression": "tiff_deflate"}
        first.save(buffer, format=_PILLOW_NAMES[suffix], **best)
    return buffer.getvalue()


def _as_text(workspace: GridWorkspace, suffix: str) -> str:
    if suffix == ".csv":
        return "".join(",".join(np.where(row, "1", "0")) + "\n" for row in workspace.free)
    if suffix == ".map":
        height, width = workspace.shape
        body = str(workspace).replace("#", "@")
        return f"type octile\nheight {height}\nwidth {width}\nmap\n{body}\n"
    return f"{workspace}\n"
