"""Archives of lowered kernels, one for each folder ``kernels``. Lowered means translated to LLVM
code, but not optimized.

Type inference and translation to LLVM code take three quarters of the compilation time, and do not
depend on the processor. LLVM optimizes the lowered code for the user's processor. Shoal uses an
archive only if the sources of the kernels, the versions of Python and Numba, and the platform have
not changed since ``make kernels`` wrote the archive. Without a usable archive, Shoal compiles a
kernel from its source at the kernel's first call. The file docs/adr/0013-kernels-lowered-ahead.md
contains the measurements of the compilation time.
"""

from __future__ import annotations

import sys
import zipfile
from functools import cache
from pathlib import Path

import llvmlite
import numba
from llvmlite import binding

from shoal.jit.folders import stamp

NAME = "lowered.zip"
noted: dict[Path, dict[str, bytes]] | None = None
"""Lowered code of the kernels compiled so far, by folder and name. The value is None, except while
``make kernels`` runs.
"""


def _fitting(part: Path) -> bytes:
    # Lowered code calls Python's C interface, whose objects have another layout in each version of
    # Python.
    versions = (
        f"{sys.implementation.cache_tag} numba {numba.__version__} llvmlite {llvmlite.__version__}"
    )
    return f"{stamp(part).hex()} {versions} {binding.get_process_triple()}".encode()


@cache
def _opened(part: Path) -> zipfile.ZipFile | None:
    return zipfile.ZipFile(part / NAME) if (part / NAME).is_file() else None


def fits(part: Path) -> bool:
    """Return whether the archive in a folder ``kernels`` matches the folder's sources, these
    versions and this platform.
    """
    archive = _opened(part)
    return archive is not None and archive.comment == _fitting(part)


def find(part: Path, kernel: str) -> bytes:
    """Return the lowered code of a kernel from the archive in a folder ``kernels``.

    Raises
    ------
    LookupError
        If the folder has no archive, or if the archive is out of date or does not contain the
        kernel.
    """
    archive = _opened(part)
    if archive is None or noted is not None or not fits(part):
        raise LookupError(part)
    return archive.read(kernel)


def note(part: Path, kernel: str, content: bytes) -> None:
    """Record the lowered code of a compiled kernel while ``make kernels`` runs."""
    if noted is not None:
        noted.setdefault(part, {})[kernel] = content


def write(part: Path) -> Path:
    """Write the recorded kernels of a folder ``kernels`` to the folder's archive. Return the path
    of the archive.
    """
    with zipfile.ZipFile(part / NAME, "w", zipfile.ZIP_LZMA) as archive:
        for kernel, content in sorted((noted or {}).get(part, {}).items()):
            archive.writestr(zipfile.ZipInfo(kernel), content, zipfile.ZIP_LZMA)
        archive.comment = _fitting(part)
    return part / NAME
