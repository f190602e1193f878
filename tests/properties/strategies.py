"""Random workspaces with particles in them."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from shoal.swarm import GridWorkspace

RULES = ("block", "merge", "tilt")


@st.composite
def workspaces(draw, *, ndim=None):
    """Small workspaces, 2-D or 3-D, with at least one free cell; widths around a word of 64 cells
    among them.
    """
    ndim = draw(st.sampled_from([2, 2, 3])) if ndim is None else ndim
    width = draw(st.one_of(st.integers(1, 12), st.sampled_from([61, 62, 63, 64, 65, 126])))
    shape = (*draw(st.tuples(*[st.integers(1, 6)] * (ndim - 1))), width)
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    free = rng.random(shape) < draw(st.sampled_from([0.5, 0.7, 0.9, 1.0]))
    free.flat[draw(st.integers(0, free.size - 1))] = True
    return GridWorkspace(free)


@st.composite
def swarms(draw, *, ndim=None):
    """A workspace and the start cells of 1 to all of its free cells."""
    workspace = draw(workspaces(ndim=ndim))
    n = draw(st.integers(1, workspace.n_free))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    return workspace, workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]


def commands(ndim, *, most=30):
    """Command strings for that many dimensions."""
    return st.text(alphabet="lurdio"[: 2 * ndim], max_size=most)
