"""How an imagined plan goes on: the command that settles most now; if none does, the whole way to the nearest frontier cell."""

from __future__ import annotations

from shoal.swarm.kernels.compiling import kernel
from shoal.swarm.kernels.foresight import advance, prospects
from shoal.swarm.kernels.ways import TOO_FAR, way


@kernel
def most(gains, last):
    """Return the command that settles most, the last one if it is among them; -1 if none settles anything."""
    best = last if last >= 0 and gains[last] > 0 else -1
    for command in range(gains.shape[0]):
        if gains[command] > (gains[best] if best >= 0 else 0):
            best = command
    return best


@kernel
def complete(scene, state, space, plan, length, horizon, discount):
    """Imagine the first ``length`` commands of a plan and then go on by the base policy, writing its commands behind them.

    Changes ``state``. Returns (time, value, length, moves): when the last cell was settled, ``horizon`` if some are left then; the cells
    settled, discounted; the commands in the plan; and how many were imagined.
    """
    value, weight, last, finished = 0.0, 1.0, -1, 0
    at = 0
    while at < horizon:
        if at >= length:
            prospects(scene, state, space.gains)
            command = most(space.gains, last)
            if command >= 0:
                plan[at] = command
                length = at + 1
            else:
                found = way(scene, state, space.planes, plan, at, horizon - at, 0)
                if found == TOO_FAR:
                    return horizon, value, at, at
                if found == 0:
                    return finished, value, at, at
                length = at + found
        command = plan[at]
        settled = advance(scene, state, command)
        at += 1
        if settled > 0:
            value += weight * settled
            finished = at
        weight *= discount
        last = command
    return horizon, value, min(length, at), at
