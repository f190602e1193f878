"""The job that writes missions: a zip archive with the mission files, a map of the missions, and the report of the linter.

Beside the zip archive, the job writes a copy of the missions' map.
"""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path
from typing import Any

from shoal.core.files import atomic
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import MissionOptions
from shoal.studio.folder import Folder
from shoal.studio.forms import as_command, checked_fields, checked_problem, checked_seed, mission_words
from shoal.studio.jobs.processes import Say

_EPOCH = (1980, 1, 1, 0, 0, 0)  # so that equal missions give equal archives


def missions_zip(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Plan a search, and write and check its missions. Return the names of the archive and the map, and the linter's report."""
    from shoal.search.missions import check_missions
    from shoal.views.search.mission_folder import MAP, MissionFolder, write_check

    problem, seed = checked_problem(spec["problem"], folder, part="search"), checked_seed(spec)
    assert isinstance(problem, SearchProblem)
    if problem.vehicle is None:
        problem = problem.replaced(vehicle="multirotor")
    options = checked_fields(MissionOptions, spec.get("missions") or {}, folder)
    problem.check_at_place()
    with tempfile.TemporaryDirectory() as place:
        inside, checked = Path(place, "missions"), Path(place, "check")
        made = MissionFolder(inside, problem, options)
        say("progress", (0.1, "planning"))
        plan = made.planned(seed=seed)
        say("progress", (0.4, "writing missions"))
        made.write(plan)
        say("progress", (0.7, "checking missions"))
        seen = tuple(plan.footprints.tolist())
        result = check_missions(
            inside, made.problem.place, seen if len({*seen}) > 1 else seen[0], angle=plan.grid.angle, cap=options.cap,
            separation=options.kept_apart, vehicle=plan.vehicle,
        )  # fmt: skip
        write_check(result, checked, drawn=False)
        stem = Path(str(problem.region)).name.partition(".")[0].replace(":", "-")
        name = folder.new_name(stem, ".missions.zip")
        with atomic(folder.path(name)) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(file for file in Path(place).rglob("*") if file.is_file()):
                archive.writestr(zipfile.ZipInfo(path.relative_to(place).as_posix(), _EPOCH), path.read_bytes())
        picture = folder.new_name(f"{stem}-missions-figure", ".png")
        with atomic(folder.path(picture)) as temporary:
            temporary.write_bytes((inside / MAP).read_bytes())
    command = " ".join([as_command(problem, seed=seed), "--missions=missions", *mission_words(options)])
    return {"file": name, "map": picture, "missions": made.report(plan), "check": result.report(), "command": command}
