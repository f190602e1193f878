"""Jobs of the lab: run the missing trials of a sweep, and write the table or a figure of a sweep."""

from __future__ import annotations

import warnings
from typing import Any

from shoal.core.checks import check_choice, check_text
from shoal.core.errors import InvalidInputError
from shoal.core.files import write_text
from shoal.lab.coordinator import run_sweep
from shoal.lab.storage.export import SUFFIXES, export
from shoal.lab.storage.store import Store
from shoal.lab.summaries import summarise
from shoal.lab.sweeps.progress import SweepProgress
from shoal.lab.versions import MixedVersionsWarning
from shoal.studio.folder import Folder
from shoal.studio.jobs.processes import Say
from shoal.studio.sweeps import checked_sweep

FIGURES = ("png", "svg")
"""File suffixes for the figures of a sweep."""


def run(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Run the missing trials of a sweep.

    The job first records the sweep in the store, and then writes the sweep file beside the store.
    """
    text = check_text(spec.get("toml"), what="toml")
    sweep = checked_sweep(text, folder)
    store = check_text(spec.get("store", f"{sweep.name}.sqlite"), what="store")
    path = folder.path(store)
    if path.suffix != ".sqlite":
        raise InvalidInputError(f"store: expected a name that ends with .sqlite, got {store!r}")
    begun = False

    def tell(progress: SweepProgress) -> None:
        nonlocal begun
        if not begun:
            begun = True
            write_text(path.with_suffix(".toml"), text)
        failed = f", {progress.failures} failed" * bool(progress.failures)
        say("progress", (progress.done / progress.total, f"{progress.done} of {progress.total} trials{failed}"))

    processors = spec.get("processors", 1)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", MixedVersionsWarning)
        status = run_sweep(sweep, path, workers=0 if processors == 1 else processors, extend=True, on_progress=tell)
    mixed = next((str(one.message) for one in said if issubclass(one.category, MixedVersionsWarning)), None)
    return {"file": store, "sweep": sweep.name, "done": status.done, "failures": status.failures, "warning": mixed}


def write(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Write the table of a sweep, or a figure of one measure of the sweep."""
    kind = check_choice(spec.get("format"), what="format", choices=(*(suffix[1:] for suffix in SUFFIXES), *FIGURES))
    path, measure = folder.path(str(spec.get("store"))), str(spec.get("measure"))
    say("progress", (0.0, f"reading {path.name}"))
    with Store(path) as store:
        name = store.only(spec.get("sweep"))
        if kind not in FIGURES:
            file = folder.new_name(name, f".{kind}")
            export(store, name, folder.path(file))
            return {"file": file}
        from shoal.views import save_figure
        from shoal.views.drawing.means import PointMean, means_figure

        rows = summarise(store, name, measure)
        means = [PointMean(row.values, row.estimate.mean, row.estimate.low, row.estimate.high) for row in rows if row.estimate]
        file = folder.new_name(f"{name}-{measure}-figure", f".{kind}")
        save_figure(means_figure(means, title=name, measure=measure), folder.path(file))
    return {"file": file}
