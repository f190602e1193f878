"""Answers for the studio's page Lab: the sweeps in the folder, their results, drafts of new sweeps,
and pictures of episodes.
"""

from __future__ import annotations

import base64
from dataclasses import asdict
from typing import Any

from shoal.core.checks import check_text, parse_toml
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.files import as_json
from shoal.lab.statistics import compare_along, first_measure, summarise
from shoal.lab.store import Store, StoredSweep
from shoal.lab.sweep import Sweep, as_toml, is_extended, trial_seed
from shoal.parts import PARTS
from shoal.studio.folder import Folder, episode_in
from shoal.studio.forms import checked_seed, checked_sweep, sweep_copies

MOST_SHOWN = 300
"""Maximum number of points of a sweep that a page shows. An exported table contains all points of
the sweep.
"""


def sweeps(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the sweeps in all stores of the folder, with the progress of each sweep."""
    answer: list[dict[str, Any]] = []
    for file in folder.files():
        if file["kind"] == "store":
            try:
                with Store(folder.path(file["name"])) as store:
                    answer += [
                        {"store": file["name"], **_status(store, name)} for name in store.names
                    ]
            except ShoalError as error:
                answer.append({"store": file["name"], "error": str(error)})
    return {"sweeps": answer}


def _status(store: Store, name: str) -> dict[str, Any]:
    status, form = store.status(name), store.stored(name).form
    more = {
        "complete": status.complete,
        "left": status.left,
        "kind": form.problem.get("kind"),
        "paired": form.paired,
    }
    return asdict(status) | more | {"axes": list(form.axes)}


def sweep(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the results of one sweep: means with confidence intervals, and comparisons of settings
    with equal seeds.
    """
    with Store(folder.path(str(about["store"]))) as store:
        name = store.only(about.get("sweep"))
        stored = store.stored(name)
        first = next(store.rows(name), None)
        measures = [
            measure
            for k, measure in enumerate(stored.measures)
            if first is None or not isinstance(first[len(stored.axes) + 2 + k], str)
        ]
        measure = (
            about.get("measure") if about.get("measure") in measures else first_measure(measures)
        )
        axis = next(iter(stored.form.paired), None)
        rows = summarise(store, name, measure) if measure else []
        pairs = compare_along(store, name, measure, axis) if axis and measure else []
        text = as_toml(stored.spec)
        answer = _status(store, name) | {
            "measures": measures,
            "measure": measure,
            "compared": axis,
            "toml": text,
            "problem": {
                field: value
                for field, value in as_json(stored.form.problem).items()
                if field != "kind" and field not in stored.form.axes
            },
        }
        answer["failed"] = [error for *_, error in store.failures(name, limit=3)]
    watched = _first_trials(stored, folder, text)
    answer["points"] = [
        row.report() | {"watch": watch}
        for row, watch in zip(
            rows[:MOST_SHOWN], watched[:MOST_SHOWN] or [None] * len(rows), strict=False
        )
    ]
    answer["comparisons"] = [
        {"axes": others, "first": first, "second": second, "comparison": found and asdict(found)}
        for others, first, second, found in pairs[:MOST_SHOWN]
    ]
    return answer | {"n_points": len(rows), "n_comparisons": len(pairs)}


def _first_trials(stored: StoredSweep, folder: Folder, text: str) -> list[Any]:
    """Return the problem and the seed of the first trial at each point of a sweep, so that a page
    can play these trials.

    Return an empty list if the trials of the sweep are not episodes, or if the sweep needs
    third-party code.
    """
    if stored.form.problem.get("kind") not in PARTS:
        return []
    try:
        made = checked_sweep(text, folder)
    except ShoalError:
        return []
    return [
        {"problem": point.problem.to_dict(), "seed": str(trial_seed(made.seed, point.seeds, 0))}
        for point in made.points[:MOST_SHOWN]
    ]


def new_sweep(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Convert the draft of a sweep from fields to TOML, or from TOML to fields. Return the draft as
    fields and as TOML.

    For an invalid draft, the answer contains the error message.
    """
    text = about.get("toml")
    if (text is None) == (about.get("sweep") is None):
        raise InvalidInputError(
            "new sweep: expected either its fields or its TOML text, got both or none"
        )
    answer: dict[str, Any] = {"error": None}
    try:
        if text is None:
            fields = about["sweep"] | {"seed": checked_seed(about["sweep"])}
            answer["toml"] = text = as_toml(fields)
        else:
            text = check_text(text, what="toml")
            fields = parse_toml(text, where="sweep")
            as_toml(fields)  # refuses dates, which JSON has not
        # as text, because numbers in pages have 53 bits
        answer["sweep"] = as_json(fields) | {"seed": str(fields.get("seed", 0))}
        made = checked_sweep(text, folder)
    except ShoalError as error:
        return answer | {"error": str(error)}
    store = f"{made.name}.sqlite"
    return answer | {
        "points": made.n_points,
        "trials": made.total,
        "store": store,
        "taken": folder.path(store).exists(),
        "other": _other_name(folder, made),
        "copies": sweep_copies(made, store, text),
    }


def _other_name(folder: Folder, sweep: Sweep) -> str | None:
    """Return an unused name if the store of a sweep holds another sweep with its name, which it
    does not extend; None if the sweep can have its name.
    """
    path = folder.path(f"{sweep.name}.sqlite")
    if not path.is_file():
        return None
    with Store(path) as store:
        if sweep.name not in store.names:
            return None
        stored = store.stored(sweep.name)
        if store.status(sweep.name).done == 0 or is_extended(stored.sweep(), sweep):
            return None
    return folder.new_name(sweep.name, ".sqlite").removesuffix(".sqlite")


def episode_picture(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a small figure of an episode, and a sentence with the result of the episode."""
    from shoal.views import figure
    from shoal.views.drawing.encoding import encode_figure

    episode: Any = episode_in(folder.path(str(about["file"])))
    drawn = figure(episode)
    drawn.set_dpi(72)
    return {
        "picture": base64.b64encode(encode_figure(drawn)).decode(),
        "sentence": episode.sentence,
        "part": episode.part,
    }
