"""Errata of the papers: for each erratum, the printed statement, the correct statement, and the
result of a check.

The folder ``docs/errata`` of the repository contains the checks of the errata. Without the
repository, an installed Shoal shows the recorded results of the checks.
"""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.files import write_text

RECORD = Path(__file__).with_suffix(".json")
CHECKS = Path(__file__).parents[3] / "docs" / "errata" / "__init__.py"


@dataclass(frozen=True)
class Erratum:
    """An erratum of a paper with the result of its check.

    Parameters
    ----------
    source : str
        Paper and location of the wrong statement.
    printed, holds : str
    check : str
        Description of the check of the erratum.
    found : str
        The numbers that the check has computed, as text.
    shown : bool
        Whether the check confirms the erratum.
    """

    source: str
    printed: str
    holds: str
    check: str
    found: str
    shown: bool


def check_errata() -> list[Erratum]:
    """Run the checks of all errata, in the order of their papers.

    If the repository is missing, the function returns the recorded results of the checks.
    """
    if not CHECKS.exists():
        return recorded()
    name = "shoal_errata"  # without a parent package, so that the checks run from any folder
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            name, CHECKS, submodule_search_locations=[str(CHECKS.parent)]
        )
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    checks: Any = sys.modules[name]
    errata: list[Erratum] = checks.check_all()
    return errata


def recorded() -> list[Erratum]:
    """Return the recorded results of the checks of all errata."""
    return [Erratum(**one) for one in json.loads(RECORD.read_text(encoding="utf-8"))]


def record(errata: Sequence[Erratum]) -> None:
    """Record the results of the checks in a file of the package."""
    write_text(
        RECORD, json.dumps([asdict(one) for one in errata], indent=1, ensure_ascii=False) + "\n"
    )
