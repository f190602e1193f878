"""Quick answers for pages of the studio, computed by a permanent process while the user draws, drags or moves a slider."""

from __future__ import annotations

import os
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from shoal.core.checks import check_choice
from shoal.core.errors import ShoalError
from shoal.studio.answers import files, lab, papers, search, steering, vessels
from shoal.studio.folder import Folder
from shoal.studio.jobs.work import storable
from shoal.studio.sweeps import sweep_forms


def answer_all(connection: Connection, root: str) -> None:
    """Answer the questions of the studio's pages until the connection ends.

    A question is a tuple: the number of the question, a name in `ANSWERS`, and the data of the page. The answer is a tuple: the
    number of the question, the text "answer" or "error", and the data for the page or the error message.
    """
    os.chdir(root)
    folder = Folder(root)
    while True:
        try:
            number, what, about = connection.recv()
        except EOFError:
            return
        try:
            connection.send(
                (number, "answer", storable(ANSWERS[check_choice(what, what="question", choices=ANSWERS)](folder, about)))
            )
        except ShoalError as error:
            connection.send((number, "error", str(error)))
        except MemoryError:
            connection.send((number, "error", "the preview needs more memory than the studio allows"))
        except OSError as error:
            connection.send((number, "error", f"cannot read {error.filename or 'a file'}: {error.strerror or error}"))
        except Exception as error:  # as a last resort, the browser gets any exception as text
            connection.send((number, "error", f"{type(error).__name__}: {error}"[:300]))


ANSWERS: dict[str, Callable[[Folder, dict[str, Any]], dict[str, Any]]] = {
    "page": files.page, "copies": files.copies, "save": files.save_problem,
    "map": vessels.map_, "photograph": vessels.photograph, "vessels": vessels.vessels, "sketch": vessels.sketch,
    "steer": steering.steer, "workspace": steering.workspace, "reach": steering.reach,
    "plan": search.plan, "missions": search.missions, "simulate": search.simulate, "draw": search.draw, "earth": search.earth,
    "papers": papers.papers,
    "lab-forms": sweep_forms, "sweeps": lab.sweeps, "sweep": lab.sweep, "new-sweep": lab.new_sweep,
    "picture": lab.episode_picture,
}  # fmt: skip
"""The functions that answer the questions of pages, keyed by the name of the question."""
