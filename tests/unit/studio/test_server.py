"""What the command refuses before it serves."""

from __future__ import annotations

import pytest

from shoal.cli import run
from shoal.core.errors import OutputError
from shoal.lab.store import locked
from shoal.studio.server import listening


def test_a_file_is_no_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert run(["studio", "file", "--no-browser"]) == 2
    assert "expected a folder" in capsys.readouterr().err


def test_a_folder_has_one_studio(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with locked(tmp_path / ".studio.sqlite", "studio"):
        assert run(["studio", ".", "--no-browser"]) == 2
    assert "no other studio serves" in capsys.readouterr().err


def test_a_port_that_is_taken(tmp_path):
    with listening(None) as first, pytest.raises(OutputError, match="cannot listen at port"):
        listening(first.getsockname()[1])


@pytest.mark.parametrize("port", ["0", "65536", "x"])
def test_ports_out_of_range(port, capsys):
    assert run(["studio", ".", "--port", port]) == 2
    assert "port" in capsys.readouterr().err
