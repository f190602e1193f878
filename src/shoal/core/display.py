"""What notebooks show of an object. What draws registers itself here, so that what is drawn does not know it.

Like ``shoal/__init__.py``, this module imports nothing.
"""

_DISPLAYS = {}  # type: ignore[var-annotated]  # "html" and "png": functions of an object


def register_display(kind: str, display: object) -> None:
    """Register the function that draws objects for notebooks as ``kind``: "html" or "png"."""
    _DISPLAYS[kind] = display


def displayed(kind: str, thing: object) -> object:
    """Return what a notebook shows of an object; None, for which it prints the object, if nothing draws it."""
    return _DISPLAYS[kind](thing) if kind in _DISPLAYS else None
