"""The cache of compiled kernels.

The cache folder is beside the sources, in the user's cache folder, in the folder SHOAL_CACHE, or in a private folder.

The cache holds one file for each combination of a kernel that Python calls, a signature and a processor. The machine code of a
kernel contains the code of the kernels that it calls. Therefore a kernel is compiled again if any kernel of its part has changed.
If a file is damaged, its kernel is compiled again and the file is replaced. A read-only folder or a full disk costs compilation
time but does not stop the run.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import NullCache
from numba.core.compiler import compile_result
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from shoal.core.notices import tell_once
from shoal.jit import lowered
from shoal.jit.libraries import Entry
from shoal.jit.watch import COMPILING

ENVIRONMENT = "SHOAL_CACHE"
"""Environment variable that names the cache folder."""


def cached(compiled: Any) -> Any:
    """Enable the disk cache of a compiled function if a cache folder exists. Return the function."""
    source = Path(compiled.py_func.__code__.co_filename)
    if not source.is_file():
        return compiled
    compiled._cache = _KernelCache(compiled.py_func.__qualname__, source)
    return compiled


@cache
def folder_of(sources: Path) -> Path | None:
    """Return the cache folder for the kernels of a source folder, or None if no folder is writable."""
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
    """Return whether files can be created in a folder. A missing folder is created."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def _private_folder() -> Path | None:
    """Return a folder for temporary files that only this user can write to, because the code in this folder is executed."""
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


class _KernelCache(NullCache):
    """The cache of one kernel, with the interface that Numba requires. Damaged or missing files never raise an error."""

    def __init__(self, name: str, source: Path) -> None:
        self._name = re.sub(r"[^\w.-]", "", f"{source.stem}.{name}")
        self._sources = source.parent
        self._part = next((one for one in source.parents if one.name == "kernels"), source.parent)

    @property
    def cache_path(self) -> str:
        return str(folder_of(self._sources))

    def load_overload(self, signature: Any, target: Any) -> Any:
        arguments = tuple(getattr(signature, "args", signature))
        with suppress(Exception):  # no file, or a damaged file: unpickling may raise anything
            return self._rebuilt(self._read(arguments, target), arguments, target)
        with suppress(Exception):  # no archive, or a damaged archive
            result = self._rebuilt(lowered.find(self._part, self._member(arguments)), arguments, target)
            self._save(result, target)
            return result
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        if not result.library.has_dynamic_globals:
            lowered.note(self._part, self._member(result.signature.args), self._reduced(result, None))
            self._save(result, result.target_context)

    def _member(self, arguments: tuple[Any, ...]) -> str:
        place = self._sources.relative_to(self._part).as_posix()
        return f"{self._name}-{_digest(place, arguments)}"

    def _file(self, arguments: tuple[Any, ...], target: Any) -> Path | None:
        folder = folder_of(self._sources)
        made_by = (numba.__version__, llvmlite.__version__, sys.implementation.cache_tag, target.codegen().magic_tuple())
        return folder and folder / f"{self._name}-{_digest(arguments, made_by)}.kernel"

    def _read(self, arguments: tuple[Any, ...], target: Any) -> bytes:
        file = self._file(arguments, target)
        content = b"" if file is None else file.read_bytes()
        if content[:16] != lowered.stamp(self._part):
            raise ValueError("compiled from other sources")
        return content[16:]

    def _save(self, result: Any, target: Any) -> None:
        file = self._file(result.signature.args, target)
        if file is None:
            return
        temporary = file.with_suffix(f".{os.getpid()}")
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            temporary.write_bytes(lowered.stamp(self._part) + self._reduced(result, result.library._get_compiled_object()))
            temporary.replace(file)
        except OSError as error:
            tell_once(f"compiled kernels cannot be kept in {self.cache_path}: {error.strerror or error}")
            with suppress(OSError):
                temporary.unlink()

    @staticmethod
    def _reduced(result: Any, code: bytes | None) -> bytes:
        """Return the stored form of a compiled kernel: its machine code, or the LLVM code from which this is made."""
        result.fndesc.typemap = result.fndesc.calltypes = None
        library = result.library
        # Code without constants never uses its environment, and importing the environment's module can be slow.
        environments = tuple(each for each in result._find_referenced_environments() if each.consts)
        about = (result.fndesc, result.environment, result.signature, tuple(result.reload_init), environments)
        return bytes(dumps((library.name, code, None if code else library.lowered, *about)))

    def _rebuilt(self, content: bytes, arguments: tuple[Any, ...], target: Any) -> Any:
        """Rebuild a compiled kernel from its stored form."""
        name, code, bitcode, description, environment, signature, reloads, environments = pickle.loads(content)
        if tuple(signature.args) != arguments:
            raise ValueError("compiled for other arguments")
        if b"NRT_" in (code or bitcode):
            rtsys.initialize(target)
        for function in reloads:
            function()
        if code is None:
            tell_once(COMPILING)
            library = Entry.of_lowered(target.codegen(), name, bitcode)
        else:
            symbols = (description.llvm_func_name, description.llvm_cpython_wrapper_name)
            library = Entry.of_machine_code(target.codegen(), name, code, symbols)
        callable_ = target.get_executable(library, description, environment)
        for each in environments:
            library.codegen.set_env(each.env_name, each)
        return compile_result(
            target_context=target, typing_context=target.typing_context, library=library, environment=environment,
            entry_point=callable_, fndesc=description, signature=signature, objectmode=False, lifted=(), type_annotation="",
            reload_init=list(reloads), referenced_envs=environments,
        )  # fmt: skip


def _digest(*things: Any) -> str:
    return hashlib.blake2b(repr(things).encode(), digest_size=8).hexdigest()
