"""Answers for the tab Watch of the studio's page Search: who does what in a search that robots
carry out, from what is on the air.
"""

from __future__ import annotations

import time
from typing import Any

from shoal.studio.folder import Folder

_FORGET = 30.0  # seconds without a question after which a watch ends
_watches: dict[tuple[str, str], tuple[float, Any]] = {}  # by task and radio, with the last question


def watch(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return what is known of a search by now. The first question opens the radio; the watch ends
    when nobody has asked for a while.

    The key "outline" holds the outline of each cell's viewpoint in metres, as points (x, y).
    """
    from shoal.robots.radios import open_radio
    from shoal.robots.tasks import read_task
    from shoal.robots.watching import SearchWatch

    now = time.monotonic()
    asked = about["task"], about["radio"]
    for key, (last, old) in list(_watches.items()):
        if key != asked and now - last > _FORGET:
            old.radio.close()
            del _watches[key]
    if about.get("ends"):
        _, old = _watches.pop(asked, (0.0, None))
        if old is not None:
            old.radio.close()
        return {"ended": True}
    if asked in _watches:
        found = _watches[asked][1]
    else:
        task = read_task(folder.path(about["task"]))
        found = SearchWatch(task, open_radio(about["radio"]))
    _watches[asked] = now, found
    found.listen(now)
    told: dict[str, Any] = found.report(now)
    if about.get("places"):
        told["places"] = found.task.cells[:, :2].round(2).tolist()
        told["cell_m"] = found.task.plan.grid.size
    told["done"] = _done(found)
    return told


def _done(found: Any) -> list[int]:
    """Return the cells that are searched."""
    bits = 0
    for some in found.searched.values():
        bits |= some
    return [cell for cell in range(len(found.task.cells)) if bits >> cell & 1]
