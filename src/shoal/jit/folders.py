"""Folders for compiled kernels: the folder in SHOAL_CACHE, a folder beside the sources, the user's
cache, or a private folder.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from shoal.core.files import users_cache
from shoal.core.notices import tell_once

ENVIRONMENT = "SHOAL_CACHE"
"""Name of the environment variable that sets the cache folder."""


@cache
def folder_of(sources: Path) -> Path | None:
    """Return the cache folder for the kernels of a source folder, or None if no folder
    is writable.
    """
    subfolder = (
        f"{sources.name}-{hashlib.blake2b(str(sources).encode(), digest_size=6).hexdigest()}"
    )
    named = os.environ.get(ENVIRONMENT)
    if named:
        folder = Path(named).expanduser() / subfolder
        if _is_usable(folder):
            return folder
        tell_once(
            f"{ENVIRONMENT}: expected a folder that can be written, got {named}; kernels are"
            " compiled without a cache"
        )
        return None
    for folder in (sources / "__pycache__", users_cache() / subfolder):
        if _is_usable(folder):
            return folder
    private = _private_folder()
    if private is None:
        tell_once(
            "kernels are compiled anew by each run: no cache folder can be written (the variable"
            f" {ENVIRONMENT} chooses another folder)"
        )
        return None
    tell_once(
        f"compiled kernels are kept in {private}: no other folder can be written (the variable"
        f" {ENVIRONMENT} chooses another folder)"
    )
    return private / subfolder if _is_usable(private / subfolder) else None


def _is_usable(folder: Path) -> bool:
    """Return whether Shoal can create files in a folder. If the folder is missing, create the
    folder first.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def _private_folder() -> Path | None:
    """Return a private folder for temporary files, or None if no safe folder exists.

    Only the current user can write to the private folder, because Shoal runs the code in the
    folder.
    """
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"shoal-kernels-{user}"
    try:
        with suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
        if hasattr(os, "getuid") and (
            folder.is_symlink() or found.st_uid != user or found.st_mode & 0o077
        ):
            return None
    except OSError:
        return None
    return folder if _is_usable(folder) else None


def part_of(function: Callable[..., Any]) -> Path:
    """Return the folder ``kernels`` that contains a kernel.

    A compiled kernel is out of date after any change in its folder ``kernels``.
    """
    sources = Path(function.__code__.co_filename).parents
    return next((one for one in sources if one.name == "kernels"), sources[0])


@cache
def stamp(part: Path) -> bytes:
    """Return a digest of the compiler module and of all Python files in the folder ``part``."""
    digest = hashlib.blake2b(digest_size=16)
    for file in (Path(__file__).with_name("compiler.py"), *sorted(part.rglob("*.py"))):
        digest.update(file.read_bytes())
    return digest.digest()


def kernel_name(function: Callable[..., Any]) -> str:
    """Return the name of a kernel in archives and caches."""
    return re.sub(
        r"[^\w.-]", "", f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}"
    )
