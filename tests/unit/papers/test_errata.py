"""The errata of the papers: each is shown by its check, the record is that of the checks, and the
page needs nothing beside it.
"""

from __future__ import annotations

import re
import sys
from html import escape
from pathlib import Path

import pytest
from docs.errata import __main__ as documentation
from docs.errata.election import FreeCells, plays
from docs.errata.exploration import family, guaranteed

from shoal.papers import errata as module
from shoal.papers import reproduce
from shoal.papers.errata import check_errata, recorded
from shoal.papers.page import write_page


@pytest.fixture(scope="module")
def errata():
    """Checked as from another folder, where neither the folder docs nor the folder tests can be
    imported.
    """
    root = Path(__file__).parents[3]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys, "path", [folder for folder in sys.path if Path(folder).resolve() != root]
        )
        for name in [name for name in sys.modules if name.split(".")[0] in {"docs", "tests"}]:
            patch.delitem(sys.modules, name)
        return check_errata()


def test_every_erratum_is_shown_by_its_check(errata):
    assert [erratum.source for erratum in errata if not erratum.shown] == []
    assert all(re.search(r"\d", erratum.found) for erratum in errata)


def test_every_erratum_of_the_specs_has_its_check(errata):
    """The places that the three specs name, in their order."""
    sources = " | ".join(erratum.source for erratum in errata)
    places = [
        "paper D, eq. 2",
        "section III.A.2",
        "paper M, Fig. 5",
        "paper M, Fig. 6",
        "data of Fig. 10",
        "section III.B.1",
        "paper M, algorithm 2",
        "paper M, algorithm 3",
        "paper M, theorem 2",
        "paper M, Fig. 10",
        "section IV.A",
        "paper W, algorithm 1",
        "paper W, algorithm 2",
        *(f"IV.E, eq. {n}" for n in (2, 3, 4, 6, 7, 8)),
        "section IV.C",
        "section IV.D",
        "section IV.F",
        "paper W, Fig. 15",
        "section V.A",
        "paper H, section Efficiency",
        "Space-Filling Curves",
        "Further Research",
    ]
    assert [place for place in places if place not in sources] == []
    assert len({(erratum.source, erratum.printed) for erratum in errata}) == len(errata)


def test_checks_compute_what_they_say():
    """That the literal elect-particle cycles hangs on a search for states that come again; here one
    is seen by eye.
    """
    corner = FreeCells(frozenset({(0, 0), (0, 1), (1, 1)}))
    to = corner.moved(frozenset({(0, 0), (0, 1)}), (0, 1))
    # the one at the corner holds the other up, for ever
    assert to == {(0, 0): (0, 0), (0, 1): (0, 1)}
    assert corner.moved(frozenset({(0, 0)}), (0, 1)) == {(0, 0): (0, 1)}
    ended = [
        [plays(corner, seed, particles=2, handover=way) for seed in range(30)]
        for way in (False, True)
    ]
    assert False in ended[0]
    assert all(ended[1])
    regions = family(4)
    # fixed polyominoes by size, each cell a start
    assert len(regions) == 1 + 2 * 2 + 3 * 6 + 4 * 19
    assert {best for region, best in regions if len(region) == 4} == {4, 6}
    assert guaranteed(regions, 1, 1)
    assert not guaranteed([(region, best - 1) for region, best in regions], 1, 1)


def test_page_needs_nothing_beside_it(errata, tmp_path):
    result = reproduce("w-fig9", tmp_path, workers=0)
    text = write_page([result], errata, tmp_path / "index.html").read_text()
    assert "://" not in text
    assert text.count("data:image/png;base64,") == 1
    assert "What moves reach on a disk" in text
    for erratum in errata:
        assert escape(erratum.found) in text


def test_an_installed_shoal_shows_what_was_recorded(errata, tmp_path, monkeypatch):
    """The record and the page of the documentation are those of the checks; numbers may differ from
    machine to machine.
    """

    def said(found):
        return [(one.source, one.printed, one.holds, one.check, one.shown) for one in found]

    assert said(recorded()) == said(errata)
    assert documentation.PAGE.read_text() == documentation.page(recorded())
    monkeypatch.setattr(module, "CHECKS", tmp_path / "none")
    assert check_errata() == recorded()
