"""Detection of no-go zones in files, from a property such as ``no_go`` or from a name such as "No-fly zone 3"."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

_ZONE = r"(no[\W_]*(go|fly|entry)|nfz|exclusion|excluded?|keep[\W_]*out|restricted)([\W_]*(zone|area|polygon|region)s?)?"
_KEY = re.compile(rf"(is[\W_]*)?{_ZONE}", re.IGNORECASE)
_NAME = re.compile(rf"(?<![^\W_]){_ZONE}(?![^\W\d_])", re.IGNORECASE)
_NAMES = {
    "name", "title", "label", "id", "type", "kind", "class", "category", "zone", "zonetype", "areatype", "role", "purpose", "usage",
    "use", "status", "description", "desc", "comment",
}  # fmt: skip
_NO = {"", "0", "0.0", "false", "no", "n", "none", "null", "off"}


def can_mark(key: str) -> bool:
    """Return whether a property with the name ``key`` can mark a no-go zone.

    Examples
    --------
    >>> [can_mark(key) for key in ("noGo", "NO_FLY_ZONE", "exclusion", "Name", "zone_type", "height")]
    [True, True, True, True, True, False]
    """
    return _KEY.fullmatch(key.strip()) is not None or re.sub(r"[\W_]", "", key).lower() in _NAMES


def is_no_go(told: Mapping[str, Any], *names: Any) -> bool:
    """Return whether a feature of a file is marked as a no-go zone.

    If a property such as ``no_go`` is false, the function ignores the names of the feature.

    Parameters
    ----------
    told : mapping
        The properties of the feature by name.
    names
        Names of the feature besides those in ``told``, such as its identifier. The function ignores names that are not texts.

    Examples
    --------
    >>> [is_no_go({key: value}) for key, value in (("no-go", True), ("noGo", 1), ("nofly", "yes"), ("type", "exclusion zone"))]
    [True, True, True, True]
    >>> is_no_go({}, "NFZ 3"), is_no_go({"no_go": 0}, "No-Go: pond"), is_no_go({}, "Airport no fly zone")
    (True, False, True)
    """
    marks = [value for key, value in told.items() if value is not None and _KEY.fullmatch(key.strip())]
    said = [str(value).strip().lower() for value in marks]
    if said:
        return any(value not in _NO for value in said)
    texts = [(re.sub(r"[\W_]", "", key).lower(), value) for key, value in told.items() if isinstance(value, str)]
    kinds = [value for key, value in texts if key in _NAMES]
    return any(_NAME.match(value.strip()) for value in kinds) or any(
        _NAME.search(name) for name in (*names, *(value for key, value in texts if key == "name")) if isinstance(name, str)
    )


def names_no_go(name: Any) -> bool:
    """Return whether the name of a folder, a collection or a layer marks its content as no-go zones.

    Examples
    --------
    >>> names_no_go("No-go zones"), names_no_go("Search area and no-go zones")
    (True, False)
    """
    return isinstance(name, str) and _NAME.match(name.strip()) is not None
