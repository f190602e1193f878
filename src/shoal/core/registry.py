"""Registries: mappings from names to objects. A name belongs to a built-in object, or has the form
``module:attribute``.

A name ``module:attribute`` refers to a third-party object. Options may follow a name, as in
``subset-coverage:fraction=0.2``.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from shoal.core.errors import InvalidInputError, ShoalError, UnknownNameError, describe_error

if TYPE_CHECKING:
    import inspect

T = TypeVar("T")

_FOLDERS: list[str] = []
"""Folders with modules of the user, which Shoal searches after Python's own search path."""
_FROM_FOLDERS: list[str] = []
"""Names of the modules that Shoal found in the folders added by `look_in`."""
_NAMED: set[str] = set()
"""Names of all modules that the user named as ``module:attribute``, wherever the files of the
modules are.
"""


def look_in(folder: str) -> None:
    """Add a folder in which Shoal searches for modules of the user, after Python's own search path.

    Because Shoal searches the added folder last, a file ``email.py`` in the folder does not replace
    Python's module ``email``.

    Examples
    --------
    >>> look_in("/nowhere")
    >>> Registry[type]("policy").get("math:pi")
    3.141592653589793
    """
    if folder not in _FOLDERS:
        _FOLDERS.append(folder)


def users_modules() -> tuple[list[str], list[str]]:
    """Return the folders that `look_in` added, and the names of the modules found in these folders.

    A worker process passes the list of folders and the list of modules to `load_users_modules`.
    """
    return list(_FOLDERS), list(_FROM_FOLDERS)


def named_modules() -> dict[str, str]:
    """Return the source files of the modules that the user named as ``module:attribute``, without
    installed packages.
    """
    files = {name: getattr(sys.modules.get(name), "__file__", None) or "" for name in _NAMED}
    return {
        name: file
        for name, file in files.items()
        if file.endswith(".py") and "site-packages" not in file
    }


def digest_of_module(name: str) -> str:
    """Return a digest of a module's source file. If the current process cannot import the module,
    return an empty text.
    """
    import hashlib

    with suppress(Exception, SystemExit), open(_imported(name).__file__ or "", "rb") as file:
        return hashlib.blake2b(file.read(), digest_size=8).hexdigest()
    return ""


def load_users_modules(folders: list[str], modules: list[str]) -> None:
    """Import, in a worker process, the modules that the main process found in the user's folders.

    A failed import is reported only when the module is used.

    Parameters
    ----------
    folders, modules : list of str
        The two lists that `users_modules` returned in the main process.
    """
    for folder in folders:
        look_in(folder)
    for name in modules:
        with suppress(Exception, SystemExit):
            _imported(name)


def _imported(name: str) -> ModuleType:
    """Import a module that the user named. Add the user's folders to Python's search path only
    during the import.
    """
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
    if name not in _FROM_FOLDERS and (getattr(module, "__file__", None) or "").startswith(
        tuple(added) or ("\0",)
    ):
        _FROM_FOLDERS.append(name)
    return module


class Registry(Generic[T]):
    """A mapping from names to objects of one kind.

    Parameters
    ----------
    kind : str
        The kind of the registered objects, such as "policy". Error messages name the kind of the
        object.
    open_to_others : bool
        Whether the registry accepts names of third-party objects (``module:attribute``).
    functions : bool
        Whether the registered objects are functions. The options in the name of a function are the
        function's keyword arguments.

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
        self._items: dict[str, Callable[[], T]] = {}

    def add(self, name: str, item: T) -> T:
        """Register ``item`` under ``name`` and return ``item``. Each name can be registered only
        once.
        """
        self.add_later(name, lambda: item)
        return item

    def add_later(self, name: str, find: Callable[[], T]) -> None:
        """Register under ``name`` the object that ``find`` returns. Its module need not be imported
        before the object is used, so that help, which only lists names, stays fast.
        """
        if name in self._items:
            raise UnknownNameError(f"the {self.kind} name {name!r} is already taken")
        self._items[name] = find

    def register(self, name: str) -> Callable[[T], T]:
        """Return a decorator that registers the decorated object under ``name``."""
        return lambda item: self.add(name, item)

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def get(self, name: str) -> T:
        """Return the object that is registered as ``name``, or the third-party object for a name
        like ``module:attribute``.

        Raises
        ------
        UnknownNameError
            Raised if no object has the given name. The error message suggests the nearest
            registered name.
        """
        if not isinstance(name, str):
            raise InvalidInputError(f"{self.kind}: expected a name, got {name!r:.80}")
        if name in self._items:
            return self._items[name]()
        if ":" in name and self.open_to_others:
            return self._import(name)
        raise UnknownNameError(f"unknown {self.kind} {name[:60]!r}: {self._suggestion(name)}")

    def _suggestion(self, name: str) -> str:
        import difflib  # slow to import, and `import shoal` must be fast

        near = difflib.get_close_matches(name, self._items, n=1, cutoff=0.5)
        known = (
            "known:"
            f" {', '.join(self._items)}{'; or MODULE:ATTRIBUTE' if self.open_to_others else ''}"
        )
        return f"did you mean {near[0]!r}? ({known})" if near else f"({known})"

    def _import(self, name: str) -> T:
        module_name, _, attribute = name.partition(":")
        if module_name in self._items:
            raise UnknownNameError(f"the {self.kind} {module_name!r} takes no option {attribute!r}")
        try:
            thing: T = getattr(_imported(module_name), attribute)
        except (Exception, SystemExit) as error:  # third-party code may raise any exception
            raise UnknownNameError(
                f"cannot import the {self.kind} {name!r}: {describe_error(error)}"
            ) from error
        return thing


def name_of(thing: Any, registry: Registry[Any]) -> str:
    """Return the name that recreates an object: its registered name with options, or
    ``module:attribute``.

    If no name recreates the object, return a description of the object.

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
            changed = [
                f"{key}={value}"
                for key, value in vars(thing).items()
                if value != getattr(type(thing), key, None)
            ]
            return f"{name}:{','.join(changed)}" if changed else name
    kind = thing if hasattr(thing, "__qualname__") else type(thing)
    module = sys.modules.get(kind.__module__)
    for attribute, found in vars(module).items() if module is not None else ():
        if (type(found) is type(thing) and found == thing) or (
            found is kind and _is_made_by(thing, kind)
        ):
            return f"{kind.__module__}:{attribute}"
    return f"{kind.__module__}:{' '.join(repr(thing).split())[:80]}"


def _is_made_by(thing: Any, kind: Any) -> bool:
    """Return whether calling the class ``kind`` without arguments makes an object equal to
    ``thing``.
    """
    try:
        return bool(vars(kind()) == vars(thing))
    except (TypeError, ValueError):
        return False


def configured(registry: Registry[Any], text: str) -> Any:
    """Return the object for a name with options, such as ``NAME:option=value`` or
    ``module:attribute:option=value``.

    Options are separated by commas. A value without ``option=`` sets the first option. Each option
    sets one parameter of the registered class or function. Shoal converts the value of an option to
    the annotated type of the parameter, or to the type of the parameter's default. For a parameter
    without annotation and default, texts such as ``2.5`` and ``true`` become numbers and booleans.

    Raises
    ------
    UnknownNameError
        Raised if no object has the given name.
    InvalidInputError
        Raised if an option does not exist, the value of an option is invalid, or the third-party
        class raises an error.

    Examples
    --------
    >>> registry = Registry[type]("count")
    >>> configured(registry, "fractions:Fraction:numerator=3")
    Fraction(3, 1)
    """
    parts = text.split(":", 1 if text.partition(":")[0] in registry else 2)
    options = parts.pop() if len(parts) > (1 if parts[0] in registry else 2) else ""
    name = ":".join(parts)
    import inspect  # also slow to import

    kind: Any = registry.get(name)
    if not inspect.isclass(kind) and not options:
        return kind
    what = f"the {registry.kind} {name!r}"
    function = registry.functions and not inspect.isclass(kind)
    try:
        signature = inspect.signature(kind)
        own = {
            key: one
            for key, one in signature.parameters.items()
            if not function or one.default is not inspect.Parameter.empty
        }
        chosen = _options(what, text, options, own)
        if function:
            return partial(kind, **chosen)
        signature.bind(**chosen)
    except (TypeError, ValueError) as error:
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(
            f"the {registry.kind} {text!r}: expected a class without arguments: {error}"
        ) from None
    try:
        return kind(**chosen)
    except (Exception, SystemExit) as error:  # the class may be third-party code
        if isinstance(error, ShoalError):
            raise
        raise InvalidInputError(f"cannot create {what}: {describe_error(error)}") from error


def _options(
    what: str, whole: str, text: str, parameters: Mapping[str, inspect.Parameter]
) -> dict[str, Any]:
    chosen: dict[str, Any] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = part.partition("=")
        if not equals:
            key, value = next(iter(parameters), part), part
        if key not in parameters:
            has = f"has {', '.join(parameters)}" if parameters else "has none"
            raise InvalidInputError(f"{what} has no option {key!r} (it {has})")
        if key in chosen:
            raise InvalidInputError(
                f"{what}: expected the option {key!r} once, got it again in {whole!r}"
            )
        chosen[key] = _converted(f"{what}: {key}", value, parameters[key])
    return chosen


_READ: dict[str, tuple[Callable[[str], object], str]] = {
    "bool": ({"true": True, "false": False}.__getitem__, "true or false"),
    "int": (int, "a whole number"),
    "float": (float, "a number"),
    "str": (str, "text"),
}


def _converted(what: str, value: str, parameter: inspect.Parameter) -> object:
    """Convert the value of an option to the annotated type of its parameter, or to the type of the
    parameter's default.
    """
    for annotation in (parameter.annotation, type(parameter.default)):
        kind = getattr(annotation, "__name__", str(annotation))  # annotations may be strings
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
