"""The only compiled code of the swarm part: plain functions on packed words.

Kernels never raise and never check; `shoal.swarm` does both before it calls them. They run unchanged, slowly, with
``NUMBA_DISABLE_JIT=1``. Rows of a board are flattened: row ``layer * rows + r``.
"""
