"""The compiled code of the swarm part: plain functions on packed words.

Kernels never raise errors and never check their arguments. The package `shoal.swarm` checks all arguments before it calls a kernel.
With ``NUMBA_DISABLE_JIT=1``, kernels also run without the compiler, but slowly.

A board is a set of cells, stored as a flat array of words with 64 bits, one bit for each cell. Word k of row r is ``words[r * width
+ k]``. Row r of a layer of a 3-D board is row ``layer * rows + r``. The rim of a board contains no free cell. If a shift carries a
bit over the end of a row, the bit falls on a rim cell and has no effect. Most kernels are therefore loops over all words without
branches, which the compiler turns into vector instructions. Several short loops are often faster than one loop with branches.
"""
