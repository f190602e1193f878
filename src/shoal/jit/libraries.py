"""Two forms of kernel code: an entry, which Python calls, and a part, which other kernels call.

A part is only linked into other code. An entry is optimized together with all its parts.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary


class LinkedPart(JITCodeLibrary):
    """The code of a part. A part is never optimized or compiled to machine code by itself."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class Entry(JITCodeLibrary):
    """Code that Python calls. No other code links to an entry, so only the machine code of an entry is kept."""

    lowered = b""
    """LLVM code of the entry and all its parts before optimization. It is independent of the processor's features."""

    def _optimize_final_module(self) -> None:
        self.lowered = self._final_module.as_bitcode()
        super()._optimize_final_module()

    @classmethod
    def of_lowered(cls, codegen: Any, name: str, lowered: bytes) -> Entry:
        """Optimize lowered code for this processor and generate its machine code."""
        self = cls(codegen, name)
        self.enable_object_caching()
        self._final_module = binding.parse_bitcode(lowered)
        super(Entry, self)._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()
        return self
