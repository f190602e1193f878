"""The folder of a studio. Paths from a browser cannot lead out of the folder, and pictures that are
too large are refused.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

import shoal
from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.swarm.maps.files import FORMATS as MAP_FORMATS
from shoal.swarm.maps.pages import size_of_picture

MOST_PIXELS = 50_000_000
"""Maximum number of pixels in a picture that the studio opens. Commands outside the studio can open
larger pictures.
"""

PAPERS = "papers"
"""Name of the subfolder for reproduced figures of the papers."""

MISSIONS_PAGE = "studio.json"
"""Name of the file in an archive of missions with what the studio's page shows of them."""

MOST_LISTED = 500
"""Maximum number of files of each kind in one page of a list. The other files are on the following
pages.
"""

MOST_SEEN = 1_000_000
"""Maximum number of files of the folder that a list counts."""

SHAPEFILE = (".shp", ".shx", ".dbf", ".prj", ".cpg")
"""File suffixes of a Shapefile, which consists of several files with a common stem."""

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
KINDS = {
    # a GIF is a film here, and the header of a volume needs its second file
    "map": tuple(suffix for suffix in MAP_FORMATS if suffix not in (".gif", ".nhdr")),
    "episode": (".npz", ".episode.json", ".jsonl"),
    "missions": (".missions.zip",),
    "region": (".geojson", ".kml", ".kmz", ".gpkg", ".zip", ".shp"),
    "part": SHAPEFILE[1:],
    "terrain": (".asc",),
    "tiles": (".pmtiles",),
    "workspace": (".svg", ".wkt", ".geojson"),
    "sweep": (".toml",),
    "store": (".sqlite",),
    "film": (".mp4", ".gif", ".html"),
    "problem": (".json",),
}
LARGEST_ZOOM = 24
TILES = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".webp": "image/webp",
}
"""File suffixes of map tiles, with their media types."""

_TAKEN = tuple({suffix for suffixes in KINDS.values() for suffix in suffixes})


class Folder:
    """The folder that a studio serves. The methods of `Folder` convert the names of files to paths
    inside the folder.

    Parameters
    ----------
    root : path

    Examples
    --------
    >>> Folder(".").path("../secret")
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: file: expected a name inside the folder, got '../secret'
    """

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = Path(root).resolve()

    def path(self, name: str) -> Path:
        """Return the path of the file with the given name in the folder. The file need not exist
        yet.

        Raises
        ------
        InvalidInputError
            Raised if the path is hidden, or if it leads out of the folder, directly or through a
            link.
        """
        parts = Path(name).parts
        bad = (
            not name or "\0" in name or "\\" in name or len(name) > 500 or Path(name).is_absolute()
        )
        if bad or any(part.startswith(".") for part in parts):
            raise InvalidInputError(
                f"file: expected a name inside the folder, got {shortened(name)}"
            )
        path = self.root.joinpath(*parts)
        try:
            inside = path.resolve().is_relative_to(self.root)
        except (OSError, RuntimeError):  # links in a circle, or a name that no file can have
            inside = False
        if not inside:
            raise InvalidInputError(
                f"file: expected a name inside the folder, got {shortened(name)}"
            )
        return path

    def check_fields(self, data: Mapping[str, Any]) -> None:
        """Refuse a problem if one of its fields names a file outside the folder, or a picture that
        is too large.
        """
        for text in texts_of(data):
            path = Path(text)
            if path.is_absolute() or text.startswith("~") or ".." in path.parts or "\0" in text:
                raise InvalidInputError(
                    f"file: expected a name inside the folder, got {shortened(text)}"
                )
            if "/" in text or (text and os.path.lexists(self.root / path)):
                check_pixels(self.path(text))

    def named_in(self, *given: Mapping[str, Any]) -> list[str]:
        """Return the names of the files of the folder that fields name, with all parts of a
        Shapefile, in alphabetical order.
        """
        files = set()
        for text in set().union(*map(texts_of, given)):
            path = Path(text)
            parts = [path.with_suffix(one) for one in SHAPEFILE] if path.suffix == ".shp" else []
            for file in (path, *parts):
                if text and os.path.lexists(self.root / file) and self.path(str(file)).is_file():
                    files.add(file.as_posix())
        return sorted(files)

    def files(self) -> list[dict[str, Any]]:
        """Return the files of the folder, newest first, with the name, purpose, size in bytes and
        time of each file. A folder of map tiles is one of them.

        Raises
        ------
        InvalidInputError
            Raised if the folder has more than `MOST_SEEN` files.
        """
        files: list[dict[str, Any]] = []
        folders, seen, pyramids = [str(self.root)], 0, set[str]()
        while folders:
            where = folders.pop()
            try:
                with os.scandir(where) as entries:
                    for entry in entries:
                        seen += 1
                        if seen > MOST_SEEN:
                            raise InvalidInputError(
                                f"folder: expected at most {MOST_SEEN} files, got more: use another"
                                " folder"
                            )
                        if entry.name[0] == ".":
                            continue
                        if entry.is_dir(follow_symlinks=False):
                            if where != str(self.root) and is_zoom_folder(entry.path):
                                pyramids.add(where)
                            else:
                                folders.append(entry.path)
                        elif (listed := self._listed(entry)) is not None:
                            files.append(listed)
            except OSError:  # a folder that cannot be read, or has just gone
                continue
        for path in pyramids:  # the tiles in it are no maps
            name = os.path.relpath(path, self.root).replace(os.sep, "/")
            files.append(
                {"name": name, "kind": "tiles", "bytes": 0, "time": os.stat(path).st_mtime}
            )
        return sorted(files, key=lambda one: (-float(one["time"]), one["name"]))

    def _listed(self, entry: os.DirEntry[str]) -> dict[str, Any] | None:
        purpose = purpose_of(entry.name)
        try:
            if purpose is None or not entry.is_file():
                return None
            if entry.name.lower().endswith(".jsonl") and not is_drive_log(entry.path):
                return None
            if purpose == "problem" and is_episode(entry.path):
                purpose = "episode"
            if entry.is_symlink() and not Path(entry.path).resolve().is_relative_to(self.root):
                return None
            about = entry.stat()
            inside = os.path.relpath(entry.path, self.root).replace(os.sep, "/")
            inside.encode()
        except (OSError, RuntimeError, UnicodeEncodeError):
            return None
        return {"name": inside, "kind": purpose, "bytes": about.st_size, "time": about.st_mtime}

    def list_files(
        self, kind: str | None = None, *, after: int = 0, name: str = ""
    ) -> dict[str, Any]:
        """Return the newest files of each kind (or of one kind), and the number of files of each
        kind.

        Parameters
        ----------
        kind : str, optional
            A kind of file: a key of `KINDS`.
        after : int
            Number of newer files of each kind to leave out.
        name : str
            Text in the names of the files. Files with other names are not listed and not counted.

        Returns
        -------
        dict
            Under ``files``, at most `MOST_LISTED` files of each kind, newest first. Under
            ``counts``, the number of files of each kind.
        """
        counts: Counter[str] = Counter()
        listed = []
        for file in self.files():
            if (kind is not None and file["kind"] != kind) or name.lower() not in file[
                "name"
            ].lower():
                continue
            if after <= counts[file["kind"]] < after + MOST_LISTED:
                listed.append(file)
            counts[file["kind"]] += 1
        return {"files": listed, "counts": dict(counts)}

    def new_name(self, stem: str, suffix: str) -> str:
        """Return an unused file name, which consists of the stem, a number if necessary, and the
        suffix.
        """
        plain = (
            "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in stem).strip(
                "-"
            )[:60]
            or "file"
        )
        # an existing file of another Shapefile is not used as a part of this one
        family = SHAPEFILE if suffix == ".shp" else (suffix,)
        number, free = 1, plain
        while any(os.path.lexists(self.root / (free + one)) for one in family):
            number += 1
            free = f"{plain}-{number}"
        return free + suffix

    async def take(self, name: str, pieces: AsyncIterator[bytes]) -> str:
        """Write an uploaded file to the folder, and return the name of the new file.

        If a file with the name of the uploaded file exists, add a number to the name. A failed
        write leaves no partial file.

        Raises
        ------
        InvalidInputError
            Raised if the suffix is not the suffix of a file type that Shoal reads, or if the file
            is a picture that is too large.
        OutputError
        """
        plain = Path(name.replace("\\", "/")).name
        suffix = next(
            (one for one in sorted(_TAKEN, key=len, reverse=True) if plain.lower().endswith(one)),
            None,
        )
        if suffix is None:
            raise InvalidInputError(
                f"file: expected one of {' '.join(sorted(_TAKEN))}, got {shortened(plain)}"
            )
        target = self.path(self.new_name(plain[: -len(suffix)], suffix))
        with atomic(target) as temporary:
            with temporary.open("wb") as file:
                async for piece in pieces:
                    file.write(piece)
            try:
                check_pixels(temporary)
            except InvalidInputError as error:
                named = str(error).replace(temporary.name, plain)
                raise InvalidInputError(named) from None
        return target.name


def texts_of(data: Mapping[str, Any]) -> set[str]:
    """Return the texts in the fields of a problem that may be names of files."""
    texts = {
        text
        for value in data.values()
        for text in (value if isinstance(value, list) else [value])
        if isinstance(text, str) and len(text) <= 4096
    }
    # fields follow the file name of a vehicle; a file may follow the name of a policy
    return {
        *texts,
        *(text.partition(",")[0] for text in texts),
        *(text.partition(":")[2] for text in texts),
    }


def is_zoom_folder(path: str | os.PathLike[str]) -> bool:
    """Return whether a folder holds the tiles of one zoom, as its name and what is in it say."""
    name = os.path.basename(path)
    if not name.isdecimal() or int(name) > LARGEST_ZOOM:
        return False
    for column in numbered_folders(path):
        with os.scandir(os.path.join(path, str(column))) as entries:
            for entry in entries:
                stem, suffix = os.path.splitext(entry.name)
                return stem.isdecimal() and suffix.lower() in TILES
    return False


def numbered_folders(path: str | os.PathLike[str]) -> list[int]:
    """Return the numbers that name the folders in a folder."""
    with os.scandir(path) as entries:
        found = [int(one.name) for one in entries if one.name.isdecimal() and one.is_dir()]
    return sorted(found)


def purpose_of(name: str) -> str | None:
    """Return the purpose of a file, such as map or episode, as indicated by the file name, or None
    for an unknown purpose.
    """
    return next((kind for kind, suffixes in KINDS.items() if name.lower().endswith(suffixes)), None)


def is_drive_log(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is the log of a drive of a swarm, which a page can play."""
    with open(path, "rb") as file:
        return b'"log":"shoal-drive"' in file.read(200)


def is_episode(path: str | os.PathLike[str]) -> bool:
    """Return whether a JSON file is an episode, as its beginning says: commands save theirs as
    ``episode.json``, and an episode contains a problem.
    """
    with open(path, "rb") as file:
        return re.search(rb'"problem": ?\{"kind"', file.read(1000)) is not None


def episode_in(path: Path) -> Any:
    """Return the episode of a file: one that was saved, or that of the log of a drive."""
    if path.suffix.lower() == ".jsonl":
        from shoal.rigs.records import episode_of_log

        return episode_of_log(path)
    return shoal.load(path)


def check_pixels(path: Path) -> None:
    """Refuse a picture of more than `MOST_PIXELS` pixels. The check reads only the header of the
    file.
    """
    if path.suffix.lower() not in PICTURES or not path.is_file():
        return
    width, height = size_of_picture(path)
    if width * height > MOST_PIXELS:
        raise InvalidInputError(
            f"{path.name}: expected a picture of at most {MOST_PIXELS // 10**6} megapixels, got"
            f" {width} x {height}"
        )
