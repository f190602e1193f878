"""Archives of lowered kernels: translated to LLVM code, but not optimized for a processor.

Type inference and translation take most of the time of a compilation, and depend neither on the
processor nor on the version of Python. Each folder ``kernels`` may have an archive ``lowered.zip``,
with one member for each combination of a kernel and the types of its arguments. The name of a
member contains a digest of all that was compiled. So a member either fits what a run needs, or the
run does not find it and Numba compiles the kernel from its source: a changed docstring, comment or
layout changes no name, and a changed kernel those of the kernels that call it.

``make kernels`` (`record_kernels`) adds missing members and removes those that no first call needs. The
file docs/adr/0017-kernels-keyed-by-content.md contains the measurements.
"""

from __future__ import annotations

import ast
import pickle
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

from shoal.core.files import digest
from shoal.jit.cache import content_key, described_code, settings_of_numba
from shoal.jit.loader import MachineCode, compiled_form, version_of_numba

if TYPE_CHECKING:
    import zipfile

NAME = "lowered.zip"
_IMPORTED = time.time_ns()  # sources that are newer may differ from what the process has imported
_recorded: dict[Path, dict[str, bytes]] | None = (
    None  # of the members in use, while `record_kernels` runs
)


def load_lowered(kernel: Any, kinds: Any) -> MachineCode | None:
    """Return the machine code that LLVM makes of a kernel's lowered code, or None if no archive has
    the kernel.
    """
    # no archive or member, or a damaged one: zipfile and pickle raise all
    with suppress(Exception):
        folder, name = _member(kernel, kinds)
        archive = _archive(folder)
        content = archive.read(name) if archive else b""
        from shoal.jit.compiler import finish  # imported only here, because Numba is slow

        code = finish(pickle.loads(content))
        if _recorded is not None:
            _recorded.setdefault(folder, {})[name] = content
        return code
    return None


def is_recording() -> bool:
    """Return whether `record_kernels` runs."""
    return _recorded is not None


def is_lowered(kernel: Any, kinds: Any) -> bool:
    """Return whether an archive has a kernel, and record that the kernel is in use."""
    folder, name = _member(kernel, kinds)
    with suppress(Exception):
        archive = _archive(folder)
        if archive is not None and _recorded is not None:
            _recorded.setdefault(folder, {})[name] = archive.read(name)
            return True
    return False


def note_lowered(kernel: Any, kinds: Any, content: bytes) -> None:
    """Record the lowered code of a kernel that was compiled, if `record_kernels` runs."""
    if _recorded is not None and Path(kernel.function.__code__.co_filename).is_file():
        folder, name = _member(kernel, kinds)
        _recorded.setdefault(folder, {})[name] = content


@contextmanager
def record_kernels() -> Iterator[dict[Path, tuple[int, int]]]:
    """Write the archives anew with the kernels that the block calls.

    Yields
    ------
    changes : dict
        After the block, by archive: how many members were added and how many were removed. An
        archive without changes is not written.
    """
    from numba.core.ir import Loc

    from shoal.jit.compiler import Entry

    global _recorded
    places: Any = Loc
    begin = places.__init__
    changes: dict[Path, tuple[int, int]] = {}
    _recorded, Entry.keep_lowered = {}, True
    # Places in Numba's sources, for error messages, are to name no folder of this machine.
    places.__init__ = lambda self, filename, *more, **others: begin(
        self, Path(filename).name, *more, **others
    )
    try:
        yield changes
        for folder, members in _recorded.items():
            archive = _archive(folder)
            before = set(archive.namelist()) if archive else set()
            if before != set(members):
                _write(folder / NAME, members)
                changes[folder / NAME] = len(set(members) - before), len(before - set(members))
    finally:
        _recorded, Entry.keep_lowered, places.__init__ = None, False, begin
        _archive.cache_clear()


def _write(file: Path, members: dict[str, bytes]) -> None:
    """Write an archive whose bytes depend on nothing but its members."""
    import zipfile

    new = file.with_suffix(".new")
    with zipfile.ZipFile(new, "w", zipfile.ZIP_LZMA) as archive:
        for name, content in sorted(members.items()):
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_LZMA)
    new.replace(file)


@cache
def _archive(folder: Path) -> zipfile.ZipFile | None:
    import zipfile

    return zipfile.ZipFile(folder / NAME) if (folder / NAME).is_file() else None


# Names of members


def _member(kernel: Any, kinds: Any) -> tuple[Path, str]:
    """Return the folder of the archive for a kernel, and the name of the member."""
    function = kernel.function
    source = Path(function.__code__.co_filename)
    folder = next((each for each in source.parents if each.name == "kernels"), source.parent)
    place = source.relative_to(folder).with_suffix("").as_posix().replace("/", ".")
    compiled = content_key(kernel, _source), compiled_form(kinds), place, _maker()
    key = digest(repr(compiled).encode(), size=16).hexdigest()
    return folder, f"{re.sub(r'[^A-Za-z0-9_.-]', '', f'{place}.{function.__qualname__}')}-{key}"


@cache
def _maker() -> tuple[Any, ...]:
    """Return the data that, with the code of a kernel, determine its lowered code."""
    import llvmlite
    from llvmlite import binding

    compiler = find_spec("shoal.jit.compiler")
    tree = ast.parse(Path(compiler.origin).read_text())  # type: ignore[union-attr, arg-type]
    code = ast.unparse(_without_docstrings(tree))
    versions = version_of_numba(), llvmlite.__version__, binding.get_process_triple()
    return *versions, code, settings_of_numba()


def _source(code: CodeType) -> Any:
    """Return the source of a function without comments, docstrings, decorators and layout, which is
    the same in all versions of Python, or else the byte code.
    """
    state = Path(code.co_filename).stat()
    if state.st_mtime_ns < _IMPORTED:
        functions = _functions(code.co_filename)
        if (code.co_firstlineno, code.co_name) in functions:
            return functions[code.co_firstlineno, code.co_name]
    return sys.implementation.cache_tag, described_code(code)


@cache
def _functions(file: str) -> dict[tuple[int, str], str]:
    sources = {}
    tree = _without_docstrings(ast.parse(Path(file).read_text()))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            line = min(node.lineno, *(each.lineno for each in node.decorator_list), node.lineno)
            node.decorator_list = []
            sources[line, node.name] = ast.unparse(node)
    return sources


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            is_docstring = ast.get_docstring(node, clean=False) is not None
            node.body = body[is_docstring:] or [ast.Pass()]
    return tree
