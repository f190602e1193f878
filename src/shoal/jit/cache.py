"""The cache of machine code: its folders, its files, and the content key of a kernel.

For each kernel that Python calls, the cache has one file for each processor and each combination of
argument types. A file begins with a checksum and with the content key of its kernel (see
`content_key`), so that a damaged file, or the file of a kernel that has changed since, is never
run. Shoal then compiles the kernel again and replaces the file. If the cache folder is read-only or
the disk is full, Shoal compiles kernels again in each run, but the run continues.
"""

from __future__ import annotations

import enum
import os
import pickle
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from operator import itemgetter
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from shoal.core.files import digest, users_cache, with_checksum, without_checksum
from shoal.core.notices import tell_once
from shoal.jit.loader import compiled_form, link, version_of_numba

ENVIRONMENT = "SHOAL_CACHE"
"""Name of the environment variable that sets the cache folder."""


@cache
def folder_of(sources: Path) -> Path | None:
    """Return the cache folder for the kernels of a source folder, or None if no folder
    is writable.
    """
    subfolder = f"{sources.name}-{digest(str(sources).encode(), size=6).hexdigest()}"
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
        status = folder.lstat()
        if hasattr(os, "getuid") and (
            folder.is_symlink() or status.st_uid != user or status.st_mode & 0o077
        ):
            return None
    except OSError:
        return None
    return folder if _is_usable(folder) else None


# Files


def load_machine_code(kernel: Any, kinds: Any) -> Any:
    """Load a kernel's machine code for given argument types from the cache, or return None if Numba
    must compile the kernel.
    """
    # no file, a damaged one, or one that this version of Python cannot read
    with suppress(Exception):
        file = _file_of(kernel.function, kinds)
        if file is not None:
            header, content = _header(file, kernel), without_checksum(file.read_bytes())
            if content.startswith(header):
                return link(pickle.loads(content[len(header) :]), kernel.function)
    return None


def save_machine_code(kernel: Any, kinds: Any, stored: bytes) -> None:
    """Write a kernel's pickled machine code for given argument types to the cache."""
    file = _file_of(kernel.function, kinds)
    if file is None:
        return
    temporary = file.with_suffix(f".{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(with_checksum(_header(file, kernel) + stored))
        temporary.replace(file)
    except OSError as error:
        tell_once(f"compiled kernels cannot be kept in {file.parent}: {error.strerror or error}")
        with suppress(OSError):
            temporary.unlink()


def _header(file: Path, kernel: Any) -> bytes:
    """Return the beginning of a cache file: what it was compiled from, and its name, so that no
    file is taken for another one.
    """
    return content_key(kernel) + file.name.encode() + b"\n"


def _file_of(function: Callable[..., Any], kinds: Any) -> Path | None:
    source = Path(function.__code__.co_filename)
    folder = folder_of(source.parent) if source.is_file() else None
    made_of = digest(repr((compiled_form(kinds), _maker())).encode(), size=8).hexdigest()
    name = re.sub(r"[^\w.-]", "", f"{source.stem}.{function.__qualname__}")
    return folder and folder / f"{name}-{made_of}.kernel"


@cache
def _maker() -> tuple[Any, ...]:
    """Return the data that, with the code of a kernel, determine its machine code: versions,
    settings and the processor.
    """
    import llvmlite
    from llvmlite import binding

    compiler = find_spec("shoal.jit.compiler")
    code = compiler.loader.get_code(compiler.name)  # type: ignore[union-attr]
    versions = version_of_numba(), llvmlite.__version__, sys.implementation.cache_tag
    processor = (
        binding.get_process_triple(),
        binding.get_host_cpu_name(),
        binding.get_host_cpu_features().flatten(),
    )
    return (
        *versions,
        digest(repr(described_code(code)).encode(), size=64).hexdigest(),
        settings_of_numba(),
        *processor,
    )


def settings_of_numba() -> list[tuple[str, str]]:
    """Return the environment variables that change what Numba compiles."""
    return sorted((name, value) for name, value in os.environ.items() if name.startswith("NUMBA_"))


# Content keys


def content_key(kernel: Any, describe: Callable[[CodeType], Any] | None = None) -> bytes:
    """Return a digest of the code that is compiled with a kernel: its own, that of all kernels that
    it calls, and constants.

    Changes of docstrings, comments, layout and places in files leave the key as it is. So do
    changes of kernels and constants that the kernel does not use. ``describe`` turns the code of a
    function into what the key is made of: by default its byte code, which is at hand, but differs
    between versions of Python.
    """
    key, waiting, seen = digest(size=16), [kernel], {id(kernel)}
    while waiting:
        described, called = _own_content(waiting.pop(0), describe)
        key.update(described)
        for one in called:
            if id(one) not in seen:
                seen.add(id(one))
                waiting.append(one)
    return key.digest()


@cache
def _own_content(
    kernel: Any, describe: Callable[[CodeType], Any] | None
) -> tuple[bytes, tuple[Any, ...]]:
    """Return a description of a kernel without those that it calls, and the kernels and functions
    that it calls, in order.
    """
    function = getattr(kernel, "function", kernel)
    called: list[Any] = []
    closure = [cell.cell_contents for cell in function.__closure__ or ()]
    used = [
        *sorted(_globals_used(function.__code__, function.__globals__), key=itemgetter(0)),
        *zip(function.__code__.co_freevars, closure, strict=True),
    ]
    values = [(name, _content(value, called)) for name, value in used]
    defaults = _content(
        (function.__defaults__, tuple(sorted((function.__kwdefaults__ or {}).items()))), called
    )
    options = sorted(getattr(kernel, "options", {}).items())
    code = (describe or described_code)(function.__code__)
    return repr((code, values, defaults, options)).encode(), tuple(called)


def _globals_used(code: CodeType, known: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the names and values of the globals that code uses, and of the attributes of modules
    that are not libraries.
    """
    for name in code.co_names:
        if name in known:
            yield name, known[name]
            if isinstance(known[name], ModuleType) and not _is_library(known[name].__name__):
                yield from (
                    (each, vars(known[name])[each])
                    for each in code.co_names
                    if each in vars(known[name])
                )
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _globals_used(constant, known)


def described_code(code: Any) -> Any:
    """Return what code does, without docstrings and places: byte code and constants."""
    if isinstance(code, frozenset):
        return "frozenset", *sorted(repr(described_code(each)) for each in code)
    if isinstance(code, tuple):
        return tuple(described_code(each) for each in code)
    if not isinstance(code, CodeType):
        return code
    constants = code.co_consts
    # the first constant of a function is its docstring or None
    has_docstring = (
        bool(code.co_flags & _OF_FUNCTION)
        and isinstance((*constants, None)[0], str)
        and code.co_name[0] != "<"
    )
    if has_docstring:
        constants = (None, *constants[1:])
    names = code.co_name, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    counts = code.co_argcount, code.co_kwonlyargcount, code.co_posonlyargcount, code.co_flags
    return code.co_code, code.co_exceptiontable, names, counts, described_code(constants)


_OF_FUNCTION = 0x2  # CO_NEWLOCALS, a flag of Python's code objects


def _content(value: Any, called: list[Any]) -> Any:
    """Return a description of a value that a kernel uses. Kernels and functions are added to
    ``called``.
    """
    if hasattr(value, "function") or (
        isinstance(value, FunctionType) and not _is_library(value.__module__)
    ):
        called.append(value)
        return "calls", value.__qualname__
    if isinstance(value, tuple):
        return type(value).__qualname__, *(_content(each, called) for each in value)
    if isinstance(value, np.ndarray):
        return "array", value.dtype.descr, value.shape, value.tobytes()
    if isinstance(value, ModuleType):
        return "module", value.__name__
    if isinstance(value, type):
        members = list(value) if issubclass(value, enum.Enum) else getattr(value, "_fields", ())
        return value.__module__, value.__qualname__, repr(members)
    try:
        return type(value).__qualname__, pickle.dumps(value)
    except Exception:  # pickle raises anything
        return os.urandom(16)  # what cannot be described never equals what was stored


def _is_library(module: str | None) -> bool:
    return (module or "").split(".")[0] in {
        "builtins",
        "math",
        "numba",
        "numpy",
        "_operator",
        "operator",
    }
