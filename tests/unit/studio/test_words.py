"""What is wrong is said at its field, in the words of the form."""

from __future__ import annotations

import re

import pytest

from shoal.core.errors import InvalidInputError
from shoal.missions.options import MissionOptions
from shoal.search.flight.vehicle import Vehicle
from shoal.search.problem import SearchProblem
from shoal.steering.problem import SteeringProblem
from shoal.studio.answers import answer
from shoal.studio.folder import Folder
from shoal.studio.forms import schema_of
from shoal.studio.words import fault_of
from shoal.swarm.problem import SwarmProblem

FORMS = {
    "map": (SwarmProblem, {"kind": "swarm", "map": "line:9", "particles": 3}),
    "workspace": (SteeringProblem, {"kind": "steering", "workspace": "square"}),
    "plan": (SearchProblem, {"kind": "search", "region": "square:60", "footprint": "10"}),
}
WRONG = {"integer": "no number", "number": "no number", "string": "zzz", "text": "zzz"}
CODE = re.compile(r"--[a-z]|MODULE|\bpip\b|[a-z]_[a-z]")


def types(schema):
    kind = schema.get("type", "text")
    return kind[0] if isinstance(kind, list) else kind


@pytest.mark.parametrize("question", FORMS)
def test_a_wrong_value_of_each_field_is_said_at_the_field(question, tmp_path):
    form, given = FORMS[question]
    folder, said = Folder(str(tmp_path)), 0
    for name, schema in schema_of(form)["properties"].items():
        if types(schema) == "boolean":
            continue
        problem = given | {name: WRONG[types(schema)]}
        word, told = answer(folder, question, {"problem": problem})
        fault = told if word == "error" else told.get("problem")
        # names of tables: a region or file of that name is looked for later, by a run
        if fault is None:
            assert types(schema) in ("text", "string")
            continue
        said += 1
        assert (fault["field"], fault["label"]) == (name, name.replace("_", " "))
        assert not CODE.search(fault["error"]), fault["error"]
    assert said > 14


@pytest.mark.parametrize(
    ("field", "form", "request_"),
    [
        ("vehicle", Vehicle, lambda wrong: {"problem": FORMS["plan"][1] | {"vehicle": wrong}}),
        (
            "missions",
            MissionOptions,
            lambda wrong: {"problem": FORMS["plan"][1], "missions": wrong},
        ),
    ],
)
def test_a_form_inside_of_the_form_has_its_own_fields(field, form, request_, tmp_path):
    for name, schema in schema_of(form)["properties"].items():
        if types(schema) in ("integer", "number"):
            _, fault = answer(Folder(str(tmp_path)), "plan", request_({name: "no number"}))
            assert fault["field"] == f"{field}.{name}"
            assert fault["error"].endswith("got no number.")


@pytest.mark.parametrize(
    ("message", "field", "sentence"),
    [
        ("drawn part 1: expected a ring", None, "Drawn part 1: expected a ring."),
        ("no_go.kml: expected a region file", "no_go", "no_go.kml: expected a region file."),
        (
            "goal_x, goal_y: expected both or none",
            "goal_x",
            "Goal x, goal y: expected both or none.",
        ),
        ("the task 'mapping' has no option 'x'", None, "The task 'mapping' has no option 'x'."),
        ("seed: expected 0 or more, got -1", "seed", "Expected 0 or more, got -1."),
    ],
)
def test_a_message_names_its_field_or_the_value_of_one(message, field, sentence):
    kind = "steering" if "goal" in message else "search"
    problem = {"kind": kind, "region": "square:60", "no_go": ["no_go.kml"], "robots": -1}
    fault = fault_of(InvalidInputError(message), {"problem": problem})
    assert (fault["field"], fault["error"]) == (field, sentence)
