"""The compiled code of the swarm part: plain functions on packed words.

Kernels never raise errors and never check their arguments. The package `shoal.swarm` checks all
arguments before it calls a kernel. With ``NUMBA_DISABLE_JIT=1``, kernels run without the compiler,
but slowly.

A board is a set of cells, stored as a flat array of words with 64 bits, one bit for each cell. Word
k in row r of a board is ``words[r * width + k]``, where ``width`` is the number of words per row.
In a 3-D board, row r of a layer is row ``layer * rows + r`` of the board. The rim of a board
contains no free cell, so a shift over the end of a row moves a bit only to a cell that is never
free. Most kernels therefore need no tests at the ends of rows, and are loops over all words without
branches. The compiler turns such loops into vector instructions.
"""
