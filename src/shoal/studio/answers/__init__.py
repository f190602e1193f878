"""Quick answers for pages of the studio, computed by a permanent process while the user draws,
drags or moves a slider.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from shoal.core.checks import check_choice
from shoal.core.dataclass import dataclass
from shoal.core.errors import ShoalError, describe_error
from shoal.core.files import as_json
from shoal.studio.answers import files, lab, search, steering, vessels, watch, welcome
from shoal.studio.folder import Folder
from shoal.studio.forms import sweep_forms
from shoal.studio.requests import (
    LIST,
    MAYBE_BOOL,
    MAYBE_INTEGER,
    MAYBE_LIST,
    MAYBE_OBJECT,
    MAYBE_TEXT,
    OBJECT,
    SEED,
    TEXT,
    Field,
)
from shoal.studio.tiles import tiles
from shoal.studio.words import fault_of


def answer_all(connection: Connection, root: str) -> None:
    """Answer the questions of the studio's pages until the connection ends.

    A question is a tuple: the number of the question, a name in `QUESTIONS`, and the data of the
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
    """Answer one question: the text "answer" and the data for the page, "error" and what `fault_of`
    returns, or "broken" and a sentence.

    "broken" stands for an error of Shoal itself, which no question should cause.
    """
    try:
        return "answer", as_json(
            QUESTIONS[check_choice(what, what="question", choices=QUESTIONS)].answer(folder, about)
        )
    except ShoalError as error:
        return "error", fault_of(error, about)
    except MemoryError:
        return "error", fault_of(
            ShoalError("the preview needs more memory than the studio allows"), {}
        )
    except OSError as error:
        words = f"cannot read {error.filename or 'a file'}: {error.strerror or error}"
        return "error", fault_of(ShoalError(words), {})
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        what = describe_error(error, most=300)
        return (
            "broken",
            (
                f"Shoal itself made an error, please report it: {what}, in"
                f" {Path(frame.filename).name}, line {frame.lineno}"
            ),
        )


@dataclass(frozen=True)
class Question:
    """A question of a page: the function that answers it, and the fields that a request has."""

    answer: Callable[[Folder, dict[str, Any]], dict[str, Any]]
    fields: dict[str, Field]


QUESTIONS: dict[str, Question] = {
    "page": Question(files.page, {"file": TEXT}),
    "settings": Question(files.settings, {"file": TEXT}),
    "copies": Question(
        files.copies,
        {"problem": MAYBE_OBJECT, "missions": MAYBE_OBJECT, "file": MAYBE_TEXT, "seed": SEED},
    ),
    "save": Question(files.save_problem, {"problem": OBJECT, "name": MAYBE_TEXT, "seed": SEED}),
    "map": Question(vessels.map_, {"problem": OBJECT, "cells": MAYBE_OBJECT, "seed": SEED}),
    "photograph": Question(vessels.photograph, {"file": TEXT}),
    "vessels": Question(vessels.vessels, {"problem": OBJECT, "exact": MAYBE_BOOL}),
    "sketch": Question(
        vessels.sketch, {"shape": LIST, "free": TEXT, "name": MAYBE_TEXT, "over": MAYBE_TEXT}
    ),
    "steer": Question(steering.steer, {"problem": OBJECT, "seed": SEED}),
    "workspace": Question(steering.workspace, {"problem": OBJECT, "seed": SEED}),
    "reach": Question(steering.reach, {"problem": OBJECT, "moves": MAYBE_INTEGER, "seed": SEED}),
    "plan": Question(
        search.plan,
        {
            "problem": OBJECT,
            "drawing": MAYBE_OBJECT,
            "missions": MAYBE_OBJECT,
            "frame": MAYBE_LIST,
            "seed": SEED,
        },
    ),
    "simulate": Question(
        search.simulate,
        {
            "problem": OBJECT,
            "drawing": MAYBE_OBJECT,
            "missions": MAYBE_OBJECT,
            "seed": SEED,
        },
    ),
    "outlines": Question(
        search.outlines, {"problem": OBJECT, "drawing": MAYBE_OBJECT, "frame": MAYBE_LIST}
    ),
    "draw": Question(search.draw, {"problem": OBJECT, "drawing": MAYBE_OBJECT}),
    "tiles": Question(tiles, {"file": TEXT}),
    "earth": Question(search.earth, {"frame": LIST}),
    "watch": Question(
        watch.watch, {"task": TEXT, "radio": TEXT, "places": MAYBE_BOOL, "ends": MAYBE_BOOL}
    ),
    "example": Question(welcome.example, {"name": TEXT}),
    "open": Question(welcome.open_, {"file": TEXT}),
    "papers": Question(files.papers, {}),
    "lab-forms": Question(sweep_forms, {}),
    "sweeps": Question(lab.sweeps, {}),
    "sweep": Question(lab.sweep, {"store": TEXT, "sweep": MAYBE_TEXT, "measure": MAYBE_TEXT}),
    "new-sweep": Question(lab.new_sweep, {"toml": MAYBE_TEXT, "sweep": MAYBE_OBJECT}),
    "picture": Question(lab.episode_picture, {"file": TEXT}),
}
"""The questions of pages. Each may also have the field ``slow``."""
