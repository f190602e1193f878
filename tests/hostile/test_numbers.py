"""Numbers that no option takes, in every option of every command that takes one: exit code 2 and
one sentence that names it.
"""

from __future__ import annotations

import pytest

from shoal.cli import run
from shoal.cli.commands import COMMANDS, command

ENOUGH = {
    "map": "line:9 -n 2",
    "cover": "line:9 -n 2",
    "gather": "line:9 -n 2",
    "maps": "line:9",
    "drive": "line:9 --particles 2",
    "steer": "square",
    "line": "--cells 9 --particles 2",
    "schedule": "--scan-cost 1 --move-cost 1",
    "reach": "square",
    "demo": "",
    "studio": ".",
    "search": "square:60 --robots 2 --footprint 10",
    "tour": "comb cave:20x15",
    "adversary": "closest-frontier",
    "robot": "none --radio udp:lo:9000,127.0.0.1:9001 --id 1",
    "rehearse": "none",
    "reproduce": "m-fig1",
    "replay": "none.npz",
    "figure": "none.npz --out figure.png",
    "missions check": "none square:60 --footprint 10",
    "missions upload": "none --connect udpin:127.0.0.1:9 --systems 1=1 --dry-run",
    "missions start": "none --connect udpin:127.0.0.1:9 --systems 1=1 --arm",
    "missions watch": "none --connect udpin:127.0.0.1:9 --systems 1=1",
    "missions flown": "none a.tlog --region square:60 --footprint 10",
    "sweep run": "none.toml --store none",
    "sweep status": "none",
    "sweep summary": "none",
    "sweep plot": "none --out a.png",
    "sweep export": "none --out a.csv",
    "sweep merge": "a b --out c",
    "sweep check": "none",
    "bench run": "closest-frontier --suite mapping-easy",
    "bench table": "none",
}
"""What else a command needs; some of it a file, which is not there: its absence may be
said first.
"""

WITHOUT_EFFECT = {
    ("map", "--label"),
    ("cover", "--label"),
    *((name, "--seed") for name in ("tour", "schedule", "line")),
}
OTHERWISE_CALLED = {"--monte-carlo": "trials"}


@pytest.mark.parametrize("name", [name for name in COMMANDS if name])
def test_no_option_takes_such_a_number(name, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    numeric = [
        one
        for one in command(name).params
        if getattr(one, "type_descriptor", None) and one.param_type_name == "option"
    ]
    numeric = [
        one
        for one in numeric
        if any(kind in str(one.type_descriptor.annotation) for kind in ("int", "float"))
    ]
    for option in numeric:
        spelled = max(option.opts, key=len)
        words = ENOUGH[name].split()
        if spelled in words:
            del words[words.index(spelled) : words.index(spelled) + 2]
        for value in ("nan", "-" + "9" * 401):
            if (name, spelled) in WITHOUT_EFFECT and value != "nan":
                continue
            assert run([*name.split(), *words, f"{spelled}={value}"]) == 2, (spelled, value)
            said = capsys.readouterr().err
            assert said.count("\n") == 1, said
            assert len(said) < 400, said
            names = (
                spelled.lstrip("-"),
                option.name.rstrip("_"),
                OTHERWISE_CALLED.get(spelled, spelled),
            )
            absent = ("none: expected", "none.npz: expected", "none.toml: expected", "a: expected")
            assert any(one in said for one in (*names, *absent)), said
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_more_cells_than_can_be_counted(capsys):
    assert run(["line", "--cells", "9" * 401, "--particles", "2"]) == 2
    assert "cells: expected a whole number from 1 to 9007199254740992" in capsys.readouterr().err
    assert run(["line", "--cells", str(2**53), "--particles", "2", "--json"]) == 0
