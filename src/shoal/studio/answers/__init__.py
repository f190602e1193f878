"""Quick answers for pages of the studio, computed by a permanent process while the user draws,
drags or moves a slider.
"""

from __future__ import annotations

import os
import re
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from shoal.core.checks import check_choice
from shoal.core.errors import ShoalError
from shoal.studio.answers import files, lab, papers, search, steering, vessels
from shoal.studio.folder import Folder
from shoal.studio.forms import sweep_forms
from shoal.studio.work import storable


def answer_all(connection: Connection, root: str) -> None:
    """Answer the questions of the studio's pages until the connection ends.

    A question is a tuple: the number of the question, a name in `ANSWERS`, and the data of the
    page. The answer is a tuple: the number of the question, followed by the result of `answer`.
    """
    os.chdir(root)
    folder = Folder(root)
    while True:
        try:
            number, what, about = connection.recv()
        except EOFError:
            return
        connection.send((number, *answer(folder, what, about)))


def answer(folder: Folder, what: str, about: dict[str, Any]) -> tuple[str, Any]:
    """Answer one question: the text "answer" and the data for the page, or "error" or "broken" and
    a sentence.

    "broken" stands for an error of Shoal itself, which no question should cause.
    """
    try:
        return "answer", storable(
            ANSWERS[check_choice(what, what="question", choices=ANSWERS)](folder, about)
        )
    except ShoalError as error:
        return "error", re.sub(r"^--(?=[a-z])", "", str(error))  # a form has fields, not options
    except MemoryError:
        return "error", "the preview needs more memory than the studio allows"
    except OSError as error:
        return "error", f"cannot read {error.filename or 'a file'}: {error.strerror or error}"
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        what = f"{type(error).__name__}: {error}"[:300]
        return (
            "broken",
            (
                f"Shoal itself made an error, please report it: {what}, in"
                f" {Path(frame.filename).name}, line {frame.lineno}"
            ),
        )


ANSWERS: dict[str, Callable[[Folder, dict[str, Any]], dict[str, Any]]] = {
    "page": files.page,
    "copies": files.copies,
    "save": files.save_problem,
    "map": vessels.map_,
    "photograph": vessels.photograph,
    "vessels": vessels.vessels,
    "sketch": vessels.sketch,
    "steer": steering.steer,
    "workspace": steering.workspace,
    "reach": steering.reach,
    "plan": search.plan,
    "missions": search.missions,
    "simulate": search.simulate,
    "draw": search.draw,
    "earth": search.earth,
    "papers": papers.papers,
    "lab-forms": sweep_forms,
    "sweeps": lab.sweeps,
    "sweep": lab.sweep,
    "new-sweep": lab.new_sweep,
    "picture": lab.episode_picture,
}
"""The functions that answer the questions of pages, keyed by the name of the question."""
