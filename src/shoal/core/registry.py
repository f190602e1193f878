"""Names for objects: the built-ins of each kind and any third party's as ``module:attribute``, with options."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from shoal.core.errors import InvalidInputError, ShoalError, UnknownNameError

if TYPE_CHECKING:
    import inspect

T = TypeVar("T")

_FOLDERS: list[str] = []
"""Where modules of the user's own lie, besides those that Python finds by itself."""
_FROM_FOLDERS: list[str] = []
"""The modules that were found there."""
_NAMED: set[str] = set()
"""The modules that were named, wherever they lie."""


def look_in(folder: str) -> None:
    """Let ``module:attribute`` mean modules in a folder, too: after all that Python finds by itself, and nothing else.

    So a file ``email.py`` in the folder where a command is typed is not taken for Python's own.

    Examples
    --------
    >>> look_in("/nowhere")
    >>> Registry[type]("policy").get("math:pi")
    3.141592653589793
    """
    if folder not in _FOLDERS:
        _FOLDERS.append(folder)


def users_modules() -> tuple[list[str], list[str]]:
    """Return the folders and the modules found in them: what `load_users_modules` of a worker process needs."""
    return list(_FOLDERS), list(_FROM_FOLDERS)


def named_modules() -> dict[str, str]:
    """Return the files of the modules that ``module:attribute`` named so far and that are none of Python's or of a package."""
    found = {name: getattr(sys.modules.get(name), "__file__", None) or "" for name in _NAMED}
    return {name: file for name, file in found.items() if file.endswith(".py") and "site-packages" not in file}


def digest_of_module(name: str) -> str:
    """Return a digest of the source of a module as this process imports it; empty if it does not find it."""
    import hashlib

    with suppress(Exception, SystemExit), open(_imported(name).__file__ or "", "rb") as file:
        return hashlib.blake2b(file.read(), digest_size=8).hexdigest()
    return ""


def load_users_modules(folders: list[str], modules: list[str]) -> None:
    """Import in this process what the user named in another; what fails is told when it is used.

    Parameters
    ----------
    folders, modules : list of str
        As `users_modules` returns them.
    """
    for folder in folders:
        look_in(folder)
    for name in modules:
        with suppress(Exception, SystemExit):
            _imported(name)


def _imported(name: str) -> ModuleType:
    """Return a module that the user named; the folders of the user's own are on the path only meanwhile."""
    _NAMED.add(name)
    added = [folder for folder in _FOLDERS if folder not in sys.path]
    sys.path.extend(added)
    importlib.invalidate_caches()
    try:
        module = importlib.import_module(name)
    finally:
        for folder in added:
            with suppress(ValueError):
                sys.path.remove(folder)
    if name not in _FROM_FOLDERS and (getattr(module, "__file__", None) or "").startswith(tuple(added) or ("\0",)):
        _FROM_FOLDERS.append(name)
    return module


class Registry(Generic[T]):
    """A mapping from names to objects of one kind.

    Parameters
    ----------
    kind : str
        What the objects are, for error messages ("policy").
    open_to_others : bool
        Whether ``module:attribute`` is a name, too.
    functions : bool
        Whether the objects are functions, so that options are arguments of theirs.

    Examples
    --------
    >>> colours = Registry[int]("colour")
    >>> colours.add("red", 1)
    1
    >>> colours.get("red")
    1
    >>> colours.get("rad")
    Traceback (most recent call last):
    ...
    shoal.core.errors.UnknownNameError: unknown colour 'rad': did you mean 'red'? (known: red; or MODULE:ATTRIBUTE)
    """

    def __init__(self, kind: str, *, open_to_others: bool = True, functions: bool = False) -> None:
        self.kind, self.open_to_others, self.functions = kind, open_to_others, functions
        self._items: dict[str, T] = {}

    def add(self, name: str, item: T) -> T:
        """Register ``item`` under ``name`` and return it; a name is taken once."""
        if name in self._items:
            raise UnknownNameError(f"the {self.kind} name {name!r} is already taken")
        self._items[name] = item
        return item

    def register(self, name: str) -> Callable[[T], T]:
        """Return a decorator that registers what it decorates under ``name``."""
        return lambda item: self.add(name, item)

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def get(self, name: str) -> T:
        """Return the object called ``name``, or the one at ``module:attribute``.

        Raises
        ------
        UnknownNameError
            If there is none; the message suggests the nearest name.
        """
        if name in self._items:
            return self._items[name]
        if ":" in name and self.open_to_others:
            return self._import(name)
        raise UnknownNameError(f"unknown {self.kind} {name[:60]!r}: {self._suggestion(name)}")

    def _suggestion(self, name: str) -> str:
        import difflib  # slow to import, and `import shoal` is not to wait for it

        near = difflib.get_close_matches(name, self._items, n=1, cutoff=0.5)
        known = f"known: {', '.join(self._items)}{'; or MODULE:ATTRIBUTE' if self.open_to_others else ''}"
        return f"did you mean {near[0]!r}? ({known})" if near else f"({known})"

    def _import(self, name: str) -> T:
        module_name, _, attribute = name.partition(":")
        if module_name in self._items:
            raise UnknownNameError(f"the {self.kind} {module_name!r} takes no option {attribute!r}")
        try:
            found: T = getattr(_imported(module_name), attribute)
        except (Exception, SystemExit) as error:  # the module is somebody's: anything may happen in it
            what = " ".join(str(error).split())
            raise UnknownNameError(f"cannot import the {self.kind} {name!r}: {type(error).__name__}: {what}") from error
        return found


def name_of(thing: Any, registry: Registry[Any]) -> str:
    """Return the name by which an object can be made again: registered, with options, or ``module:attribute``.

    An object that has neither is told as what it is; nothing can be made from that.

    Examples
    --------
    >>> colours = Registry[int]("colour")
    >>> colours.add("red", 1)
    1
    >>> name_of(1, colours), name_of("red", colours)
    ('red', 'red')
    """
    if isinstance(thing, str):
        return thing
    for name in registry:
        if registry.get(name) is thing:
            return name
        if registry.get(name) is type(thing):
            changed = [f"{key}={value}" for key, value in vars(thing).items() if value != getattr(type(thing), key, None)]
            return f"{name}:{','.join(changed)}" if changed else name
    kind = thing if hasattr(thing, "__qualname__") else type(thing)
    module = sys.modules.get(kind.__module__)
    for attribute, found in vars(module).items() if module is not None else ():
        if (type(found) is type(thing) and found == thing) or (found is kind and _is_made_by(thing, kind)):
            return f"{kind.__module__}:{attribute}"
    return f"{kind.__module__}:{' '.join(repr(thing).split())[:80]}"


def _is_made_by(thing: Any, kind: Any) -> bool:
    """Tell whether a class without arguments makes such an object."""
    try:
        return bool(vars(kind()) == vars(thing))
    except (TypeError, ValueError):
        return False


def configured(registry: Registry[Any], text: str) -> Any:
    """Return the object that ``NAME`` or ``module:attribute`` means, with options as in ``NAME:option=value,option=value``.

    A value without ``option=`` goes to the first option. Options are converted to the type that their parameter is annotated with,
    or else of its default; where there is neither, to a number or bool if they read like one.

    Raises
    ------
    UnknownNameError
        If there is no such name.
    InvalidInputError
        If there is no such option, its value does not fit, or somebody's class cannot be made.

    Examples
    --------
    >>> registry = Registry[type]("count")
    >>> configured(registry, "fractions:Fraction:numerator=3")
    Fraction(3, 1)
    """
    parts = text.split(":", 1 if text.partition(":")[0] in registry else 2)
    options = parts.pop() if len(parts) > (1 if parts[0] in registry else 2) else ""
    name = ":".join(parts)
    import inspect  # slow to import, too

    kind: Any = registry.get(name)
    if not inspect.isclass(kind) and not options:
        return kind
    what, function = f"the {registry.kind} {name!r}", registry.functions and not inspect.isclass(kind)
    try:
        signature = inspect.signature(kind)
        own = {key: one for key, one in signature.parameters.items() if not function or one.default is not inspect.Parameter.empty}
        chosen = _options(what, text, options, own)
        if function:
            return partial(kind, **chosen)
        signature.bind(**chosen)
    except (TypeError, ValueError) as error:
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(f"the {registry.kind} {text!r}: expected a class without arguments: {error}") from None
    try:
        return kind(**chosen)
    except (Exception, SystemExit) as error:  # the class may be somebody's
        if isinstance(error, ShoalError):
            raise
        raise InvalidInputError(f"{what}: cannot be made: {type(error).__name__}: {' '.join(str(error).split())}") from error


def _options(what: str, whole: str, text: str, parameters: Mapping[str, inspect.Parameter]) -> dict[str, Any]:
    chosen: dict[str, Any] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals:
            key, value = next(iter(parameters), part), part
        if key not in parameters:
            has = f"has {', '.join(parameters)}" if parameters else "has none"
            raise InvalidInputError(f"{what} has no option {key!r} (it {has})")
        if key in chosen:
            raise InvalidInputError(f"{what}: expected the option {key!r} once, got it again in {whole!r}")
        chosen[key] = _converted(f"{what}: {key}", value, parameters[key])
    return chosen


_READ: dict[str, tuple[Callable[[str], object], str]] = {
    "bool": ({"true": True, "false": False}.__getitem__, "true or false"),
    "int": (int, "a whole number"),
    "float": (float, "a number"),
    "str": (str, "text"),
}


def _converted(what: str, value: str, parameter: inspect.Parameter) -> object:
    """Return the value of an option as the type that its parameter is annotated with or has by default."""
    for told in (parameter.annotation, type(parameter.default)):
        kind = getattr(told, "__name__", str(told))  # annotations may be texts
        if kind in _READ:
            read, expected = _READ[kind]
            try:
                return read(value)
            except (ValueError, KeyError):
                raise InvalidInputError(f"{what}: expected {expected}, got {value!r}") from None
    for read, _ in _READ.values():
        with suppress(ValueError, KeyError):
            return read(value)
    return value


def loaded_on_use(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package whose names are imported when they are first used, so that it is quick.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    homes : mapping of str to str
        The module of each name, from the package on.

    Examples
    --------
    >>> loaded_on_use("shoal", {"Status": "episode"})("Status").COMPLETE
    <Status.COMPLETE: 'complete'>
    """

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(f"{package}.{homes[name]}"), name)

    return get
