"""Storage of compiled kernels with Numba's cache interface: lowered code in archives, and machine
code in a cache.

Lowered code is LLVM code that is not yet optimized for a processor. For each kernel that Python
calls, the cache of machine code has one file for each processor and each combination of argument
types.

Shoal compiles a kernel again after a change of any source file in the kernel's folder (see
`part_of`), because the code of a kernel contains the code of all kernels that it calls. If the
cache file of a kernel is damaged, Shoal compiles the kernel again and replaces the file. If the
cache folder is read-only or the disk is full, Shoal compiles kernels again in each run, but the run
continues.
"""

from __future__ import annotations

import hashlib
import pickle
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core import event
from numba.core.caching import NullCache
from numba.core.compiler import compile_result
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from shoal.core.notices import tell_once
from shoal.jit import lowered
from shoal.jit.folders import folder_of, kernel_name, part_of
from shoal.jit.libraries import Entry
from shoal.jit.machine_code import MachineCode, save_machine_code
from shoal.jit.watch import COMPILING, Compiling


class _Watch(event.Listener):
    """Print a notice when Numba compiles a kernel, and measure the time that Numba needs for
    loading and compiling.
    """

    def on_start(self, event: Any) -> None:
        if event.kind == "numba:compiler_lock":
            Compiling().__enter__()
        else:
            tell_once(COMPILING)

    def on_end(self, event: Any) -> None:
        if event.kind == "numba:compiler_lock":
            Compiling().__exit__()


for _kind in ("numba:compile", "numba:compiler_lock"):
    event.register(_kind, _Watch())


def cached(compiled: Any) -> Any:
    """Connect a compiled function to the archives and the cache, and return the function.

    A function whose source is not a file gets no cache.
    """
    if Path(compiled.py_func.__code__.co_filename).is_file():
        compiled._cache = _KernelCache(compiled.py_func)
    return compiled


class _KernelCache(NullCache):
    """The stored forms of one kernel, with the interface that Numba requires. Damaged or missing
    files never raise an error.
    """

    def __init__(self, function: Any) -> None:
        self._function, self._part = function, part_of(function)
        self.kinds: Any = (
            None  # the argument types for which Numba compiles the kernel, or None if unknown
        )

    @property
    def cache_path(self) -> str:
        return str(folder_of(Path(self._function.__code__.co_filename).parent))

    def load_overload(self, signature: Any, target: Any) -> Any:
        arguments = tuple(getattr(signature, "args", signature))
        with suppress(
            Exception
        ):  # without an archive, find raises; with a damaged archive, pickle may raise any error
            result = self._rebuilt(
                lowered.find(self._part, self._member(arguments)), arguments, target
            )
            self._save(result)
            return result
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        if not result.library.has_dynamic_globals:
            lowered.note(self._part, self._member(result.signature.args), _reduced(result))
            self._save(result)

    def _member(self, arguments: tuple[Any, ...]) -> str:
        place = Path(self._function.__code__.co_filename).parent.relative_to(self._part).as_posix()
        return f"{kernel_name(self._function)}-{hashlib.blake2b(repr((place, arguments)).encode(), digest_size=8).hexdigest()}"

    def _save(self, result: Any) -> None:
        if self.kinds is not None and not result.reload_init:
            save_machine_code(self._function, self.kinds, dumps(_machine_code(result)))

    def _rebuilt(self, content: bytes, arguments: tuple[Any, ...], target: Any) -> Any:
        """Generate machine code for a kernel from its lowered form."""
        name, bitcode, description, environment, signature, reloads, environments = pickle.loads(
            content
        )
        if tuple(signature.args) != arguments:
            raise ValueError("compiled for other arguments")
        if b"NRT_" in bitcode:
            rtsys.initialize(target)
        for function in reloads:
            function()
        tell_once(COMPILING)
        library = Entry.of_lowered(target.codegen(), name, bitcode)
        callable_ = target.get_executable(library, description, environment)
        for each in environments:
            library.codegen.set_env(each.env_name, each)
        return compile_result(
            target_context=target,
            typing_context=target.typing_context,
            library=library,
            environment=environment,
            entry_point=callable_,
            fndesc=description,
            signature=signature,
            objectmode=False,
            lifted=(),
            type_annotation="",
            reload_init=list(reloads),
            referenced_envs=environments,
        )


def _environments(result: Any) -> tuple[Any, ...]:
    """Return the environments of a kernel (Numba's objects for global data), and omit environments
    without constants.

    Environments without constants are useless, and their loading would take time for imports.
    """
    return tuple(each for each in result._find_referenced_environments() if each.consts)


def _reduced(result: Any) -> bytes:
    """Return the lowered form of a compiled kernel as pickled bytes."""
    result.fndesc.typemap = result.fndesc.calltypes = None
    library = result.library
    about = (
        result.fndesc,
        result.environment,
        result.signature,
        tuple(result.reload_init),
        _environments(result),
    )
    return bytes(dumps((library.name, library.lowered, *about)))


def _machine_code(result: Any) -> MachineCode:
    """Return the machine code of a compiled kernel, with the data that a call of the
    kernel needs.
    """
    description, module = result.fndesc, result.library._final_module
    outside = [
        one.name for one in (*module.functions, *module.global_variables) if one.is_declaration
    ]
    return MachineCode(
        code=result.library._get_compiled_object(),
        name=description.qualname.split(".")[-1],
        entry=description.llvm_cpython_wrapper_name,
        own=description.env_name,
        constants={
            each.env_name: list(each.consts)
            for each in (result.environment, *_environments(result))
        },
        required=tuple(name for name in outside if not name.startswith("llvm.")),
    )
