"""The compiled code of the swarm part: plain functions on packed words.

Kernels never raise and never check their arguments; `shoal.swarm` does both before it calls them. They also run, slowly, without
the compiler (``NUMBA_DISABLE_JIT=1``).

Boards are flat arrays: word k of row r is ``words[r * width + k]``, and rows of a 3-D board are ``layer * rows + r``. The rim
contains no free cell, so bits that a shift carries over the end of a row fall on cells that are never free. Most queries are
therefore one loop over all words without a branch, which the compiler turns into vector instructions. This is the reason for the
many short loops.
"""
