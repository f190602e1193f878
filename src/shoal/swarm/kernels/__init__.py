"""The only compiled code of the swarm part: plain functions on packed words.

Kernels never raise and never check; `shoal.swarm` does both before it calls them. They run unchanged, slowly, with
``NUMBA_DISABLE_JIT=1``.

A board is flat here: word k of row r is ``words[r * width + k]``, rows of a 3-D board are ``layer * rows + r``. No free cell lies
in the rim, so bits that a shift carries over the end of a row fall on cells that are never free, and most queries are one loop over
all words without a branch, which the compiler turns into vector instructions. That is why they are cut into several short loops.
"""
