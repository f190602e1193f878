"""Where compiled kernels are kept: beside the sources, in the user's cache, in the folder SHOAL_CACHE, or in a private one.

Numba keeps them, with three changes. A kernel is compiled again if any kernel of its part has changed, since it holds the code of
those that it calls. What is damaged is compiled again and replaced. And a folder that cannot be written, or a full disk, costs
the time to compile, not the run.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache

from shoal.notices import tell_once

ENVIRONMENT = "SHOAL_CACHE"
"""Names the folder, if it is set."""


def cached(compiled: Any) -> Any:
    """Return a compiled function, with its results kept on disk if there is a folder for them."""
    source = Path(compiled.py_func.__code__.co_filename)
    if not source.is_file():
        return compiled
    if folder_of(source.parent) is not None:
        compiled._cache = _KernelCache(compiled.py_func)
    return compiled


@cache
def folder_of(sources: Path) -> Path | None:
    """Return the folder for kernels of a folder of sources; None if there is none that can be written."""
    subfolder = f"{sources.name}-{hashlib.blake2b(str(sources).encode(), digest_size=6).hexdigest()}"
    named = os.environ.get(ENVIRONMENT)
    if named:
        folder = Path(named).expanduser() / subfolder
        if _is_usable(folder):
            return folder
        tell_once(f"{ENVIRONMENT}: expected a folder that can be written, got {named}; kernels are compiled without a cache")
        return None
    for folder in (sources / "__pycache__", _users_cache() / subfolder):
        if _is_usable(folder):
            return folder
    private = _private_folder()
    if private is None:
        tell_once(f"kernels are compiled anew by each run: no cache folder can be written (name one with {ENVIRONMENT})")
        return None
    tell_once(f"compiled kernels are kept in {private}: no other folder can be written (name one with {ENVIRONMENT})")
    return private / subfolder if _is_usable(private / subfolder) else None


def _users_cache() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(home) / "shoal"


def _is_usable(folder: Path) -> bool:
    """Tell whether files can be made in a folder, which is made if it is not there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def _private_folder() -> Path | None:
    """Return a folder for temporary files that is this user's and nobody else can write to: what lies there is run."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"shoal-kernels-{user}"
    try:
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
        if hasattr(os, "getuid") and (folder.is_symlink() or found.st_uid != user or found.st_mode & 0o077):
            return None
    except OSError:
        return None
    return folder if _is_usable(folder) else None


@cache
def _stamp(part: Path) -> bytes:
    """Return a digest of all kernels of a part, and of how they are compiled."""
    digest = hashlib.blake2b(digest_size=16)
    for folder in (Path(__file__).parent, part):
        for file in sorted(folder.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.digest()


class _Locator:
    """What Numba asks about a function's cache."""

    def __init__(self, source: str) -> None:
        self.folder = folder_of(Path(source).parent)
        sources = Path(source).parent
        self.part = next((one for one in (sources, *sources.parents) if one.name == "kernels"), sources)

    @classmethod
    def from_function(cls, function: Any, source: str) -> _Locator:
        return cls(source)

    def ensure_cache_path(self) -> None:
        os.makedirs(self.get_cache_path(), exist_ok=True)

    def get_cache_path(self) -> str:
        return str(self.folder)

    def get_source_stamp(self) -> bytes:
        return _stamp(self.part)

    def get_disambiguator(self) -> str:
        return "0"  # not the line, as Numba has it: what was compiled of an older version is replaced, not left behind


class _KernelImpl(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # type: ignore[list-item]  # noqa: RUF012 - as Numba declares it


class _KernelCache(FunctionCache):
    """Numba's cache of a function, for which nothing that is wrong on disk is an error."""

    _impl_class = _KernelImpl

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        try:
            found = super().load_overload(signature, target_context)
        except Exception:  # a damaged file: unpickling runs into anything
            self._drop_index()
            return None
        wanted = tuple(getattr(signature, "args", signature))
        return found if found is not None and tuple(found.signature.args) == wanted else None

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            os.makedirs(self.cache_path, exist_ok=True)
            with _locked(Path(self.cache_path)):
                try:
                    super().save_overload(signature, data)
                except OSError:
                    raise
                except Exception:  # a damaged index
                    self._drop_index()
                    super().save_overload(signature, data)
        except OSError as error:
            tell_once(f"compiled kernels cannot be kept in {self.cache_path}: {error.strerror or error}")

    def _drop_index(self) -> None:
        with suppress(OSError):
            os.unlink(os.path.join(self.cache_path, f"{self._impl.filename_base}.nbi"))


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Let no other process write into a folder while the block runs: two would take the same name for two kernels."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    with open(folder / "kernels.lock", "w") as file:
        with suppress(OSError):  # a disk without locks
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
