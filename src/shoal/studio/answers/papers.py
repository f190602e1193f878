"""Answers for the studio's page Papers: the figures of the papers, and Shoal's results beside the
published results.
"""

from __future__ import annotations

from typing import Any

from shoal.core.checks import parse_json, read_text
from shoal.parts import LARGEST_PROBLEM
from shoal.studio.folder import PAPERS, Folder


def papers(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the papers, each with its result, or with None if the figure was not
    reproduced in the folder.
    """
    from shoal.papers.reproduce import recipes

    told = []
    for name in recipes():
        recipe = recipes().get(name)
        one: dict[str, Any] = {
            "name": name,
            "source": recipe.source,
            "title": recipe.title,
            "result": None,
        }
        summary = folder.path(f"{PAPERS}/{name}.json")
        if summary.is_file():
            found = parse_json(
                read_text(summary, what="summary", most=LARGEST_PROBLEM), where=str(summary)
            )
            if isinstance(found, dict) and found.get("figure") == name:
                one["result"] = {
                    key: found.get(key) for key in ("verdict", "claims", "sentence", "files")
                }
        told.append(one)
    page_file = folder.path(f"{PAPERS}/index.html")
    return {"figures": told, "page": f"{PAPERS}/index.html" if page_file.is_file() else None}
