"""Two forms of kernel code: an entry, which Python calls, and a part, which other kernels call.

Numba links a part into the code of other kernels, without optimization. LLVM optimizes an entry
together with all parts of the entry.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary

_WRAPPER = "_ZN7cpython"  # prefix of the names of functions that accept Python objects


class LinkedPart(JITCodeLibrary):
    """The code of a kernel that other kernels call.

    Numba never optimizes a part alone, and never generates machine code for a part alone.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class Entry(JITCodeLibrary):
    """The code of a kernel that Python calls. No other code links to an entry, so Shoal keeps only
    the entry's machine code.
    """

    lowered = b""
    """LLVM code of the entry and of all its parts, before optimization. LLVM code does not depend
    on features of the processor.
    """

    def _optimize_final_module(self) -> None:
        self.lowered = self._final_module.as_bitcode()
        _hide_parts(self._final_module)
        super()._optimize_final_module()

    @classmethod
    def of_lowered(cls, codegen: Any, name: str, lowered: bytes) -> Entry:
        """Optimize lowered code (LLVM code) for this processor, and generate machine
        code from it.
        """
        self = cls(codegen, name)
        self.enable_object_caching()
        self._final_module = binding.parse_bitcode(lowered)
        _hide_parts(self._final_module)
        super(Entry, self)._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()
        return self


def _hide_parts(module: Any) -> None:
    """Tell LLVM that no code outside the module calls the parts of an entry.

    Without calls from outside, LLVM inlines each part that has only one call, and removes unused
    arguments. In LLVM code, one array argument consists of seven arguments.
    """
    wrappers = [one.name for one in module.functions if one.name.startswith(_WRAPPER)]
    called = {*wrappers, *(name.replace(_WRAPPER, "_ZN", 1) for name in wrappers)}
    for function in module.functions:
        if not function.is_declaration and function.name not in called:
            function.linkage = binding.Linkage.internal
