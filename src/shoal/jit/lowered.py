"""Kernels that were typed and lowered ahead of time, one archive beside the kernels of each part.

That takes three quarters of a compilation and depends on no processor; LLVM optimizes what is here for the processor that it is
run on. Where an archive does not fit, since a kernel was changed, or Numba or the platform is another one, all of it is done
when a kernel is first called. ``make kernels`` writes the archives; docs/adr/0013-kernels-lowered-ahead.md has the measurements.
"""

from __future__ import annotations

import hashlib
import zipfile
from functools import cache
from pathlib import Path

import llvmlite
import numba
from llvmlite import binding

NAME = "lowered.zip"
noted: dict[Path, dict[str, bytes]] | None = None
"""What was compiled so far, by part and kernel; None but for who writes archives, for whom all is compiled."""


@cache
def stamp(part: Path) -> bytes:
    """Return a digest of all kernels of a part, and of how they are compiled."""
    digest = hashlib.blake2b(digest_size=16)
    for file in (Path(__file__).with_name("compiler.py"), *sorted(part.rglob("*.py"))):
        digest.update(file.read_bytes())
    return digest.digest()


def _fitting(part: Path) -> bytes:
    versions = f"numba {numba.__version__} llvmlite {llvmlite.__version__} {binding.get_process_triple()}"
    return f"{stamp(part).hex()} {versions}".encode()


@cache
def _opened(part: Path) -> zipfile.ZipFile | None:
    return zipfile.ZipFile(part / NAME) if (part / NAME).is_file() else None


def fits(part: Path) -> bool:
    """Tell whether there is an archive made of these sources, by this version of Numba, for this platform."""
    archive = _opened(part)
    return archive is not None and archive.comment == _fitting(part)


def find(part: Path, kernel: str) -> bytes:
    """Return what was kept of a lowered kernel.

    Raises
    ------
    LookupError
        If there is no archive of the part, or it does not fit, or does not hold this kernel.
    """
    archive = _opened(part)
    if archive is None or noted is not None or not fits(part):
        raise LookupError(part)
    return archive.read(kernel)


def note(part: Path, kernel: str, content: bytes) -> None:
    """Remember a kernel that was compiled, if anybody writes archives."""
    if noted is not None:
        noted.setdefault(part, {})[kernel] = content


def write(part: Path) -> Path:
    """Write the archive of what was noted of a part; return its path."""
    with zipfile.ZipFile(part / NAME, "w", zipfile.ZIP_LZMA) as archive:
        for kernel, content in sorted((noted or {}).get(part, {}).items()):
            archive.writestr(zipfile.ZipInfo(kernel), content, zipfile.ZIP_LZMA)
        archive.comment = _fitting(part)
    return part / NAME
