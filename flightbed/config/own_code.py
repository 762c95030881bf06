"""External code: loaded by name with the user's permission, and usable in flights while the permission lasts.

A scenario alone imports nothing. It may name ``module:Attribute`` or ``path/to/file.py:Attribute``, and flies only if exactly this name
is permitted: ``flightbed run --use NAME``, or ``with flightbed.using(NAME):``. See docs/extending.md.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import os
import pickle
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from flightbed.config import families
from flightbed.config.table import Settings
from flightbed.config.tracebacks import constructor_message, error_line, location
from flightbed.core.errors import ExtensionError, FlightbedError, did_you_mean
from flightbed.core.sources import digest, imports_sha256

if TYPE_CHECKING:
    pass

_METHODS = {
    "estimators": "update",
    "laws": "demand",
}  # method of a factory's product; the products of other families are functions


@dataclass(frozen=True)
class Extension:
    """Permitted external code.

    Attributes:
        name: its name in scenarios.
        factory: builds an estimator, law, failure or command from its settings and the further arguments of its family, or is the class
            of these settings, with a method ``build`` that takes the further arguments.
        sha256: hash of its source file at loading; None without a file, as in a notebook.
        files: source files of its traceback frames.
        imports: path -> hash of the files that its source file imports from its own folder or package, directly or through others.

    """

    name: str
    factory: Callable[..., Any]
    sha256: str | None
    files: frozenset[str]
    imports: Mapping[str, str] = field(default_factory=dict, hash=False)

    @property
    def identity(self) -> Mapping[str, Any]:
        """Return the hashes of its sources: what a fingerprint holds of it."""
        return {"sha256": self.sha256, "imports": dict(self.imports)}

    def maker(self, family: str) -> Callable[..., Any]:
        """Return the factory for a family; it checks the product, and its errors name the user's file and line."""

        def make(*arguments: Any) -> Any:
            try:
                made = arguments[0].build(*arguments[1:]) if _is_settings(self.factory) else self.factory(*arguments)
            except FlightbedError:
                raise
            except Exception as error:
                raise ExtensionError(constructor_message(error, self)) from error
            method = _METHODS.get(family, "__call__")
            if not callable(getattr(made, method, None)):
                needs = "is not callable" if method == "__call__" else f"has no method {method}()"
                raise ExtensionError(
                    f"own code {self.name}: returns a {type(made).__name__}, which {needs}; docs/extending.md shows the interface"
                )
            return made

        return make

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the code: by name, or, for an object given in Python, by its import location."""
        if ":" in self.name:
            return Packed, (self.name, None, self.sha256, dict(self.imports))
        try:
            return Packed, (self.name, pickle.dumps(self.factory), self.sha256, dict(self.imports))
        except Exception as error:
            raise ExtensionError(
                f"own code {self.name}: cannot be sent to other processes ({error_line(error)}); put it in a file and name it "
                "path/to/file.py:Attribute, or fly in this process"
            ) from error


@dataclass(frozen=True)
class Packed:
    """Pickled form of an Extension for another process, where ``unpack`` loads the code."""

    name: str
    pickled: bytes | None
    sha256: str | None
    imports: Mapping[str, str] = field(hash=False)

    def unpack(self) -> Extension:
        """Load the code. Raises ExtensionError if it cannot be loaded, or if its file has changed since it was packed."""
        found = self._load_factory()
        if found.sha256 != self.sha256:
            raise ExtensionError(
                f"own code {self.name}: its file has changed since the flights began; start the flights again"
            )
        for file, sha256 in self.imports.items():
            if found.imports.get(file) != sha256:
                raise ExtensionError(
                    f"own code {self.name}: {file}, which it imports, has changed since the flights began; start the flights again"
                )
        return found

    def _load_factory(self) -> Extension:
        if self.pickled is None:
            return load(self.name)
        try:
            return _from_object(self.name, pickle.loads(self.pickled))
        except Exception as error:
            raise ExtensionError(
                f"own code {self.name}: cannot be found in the other process ({error_line(error)}); put it in a file and name it "
                "path/to/file.py:Attribute, or fly in this process"
            ) from error


@contextmanager
def using(*own: str | Mapping[str, Callable[..., Any]]) -> Iterator[None]:
    """Permit external code inside the ``with`` block, in this thread: scenarios may name it and fly it.

    Args:
        own: names, ``"module:Attribute"`` or ``"path/to/file.py:Attribute"``, also searched in the working directory; or
            mappings ``{"mine": MyFilter}`` from names to classes or functions. Each is a factory with the arguments of the
            built-in ones: an estimator gets ``(settings, onboard)``, a law ``(settings, design, control_hz)``, a failure
            ``(settings, before, control_hz)``, a command ``(settings)``.

    Raises:
        ExtensionError: a name cannot be imported, is not callable, or is the name of a built-in or installed factory.

    """
    found = dict(families.in_use())
    for item in own:
        if not isinstance(item, str | Mapping):
            raise ExtensionError(
                f'flightbed.using: takes names, "my_filter:MyFilter", or mappings, {{"mine": MyFilter}} (got {item!r})'
            )
        for extension in [load(item)] if isinstance(item, str) else [_from_object(n, f) for n, f in item.items()]:
            found[extension.name] = extension
    with families.permit(found):
        yield


@contextmanager
def permit_packed(extensions: Iterable[Extension | Packed]) -> Iterator[None]:
    """Permit the extensions of a job inside the ``with`` block; those packed by another process are loaded first."""
    loaded = [e.unpack() if isinstance(e, Packed) else e for e in extensions]
    with families.permit({**families.in_use(), **{e.name: e for e in loaded}}):
        yield


def use_options(names: Iterable[str]) -> str:
    """Return the ``--use`` options that permit own code on a command line, given its names."""
    return "".join(f" --use {shlex.quote(name)}" for name in names if ":" in name)


def names_without_option(names: Iterable[str]) -> list[str]:
    """Return the names of own code that no command line can permit: classes and functions given in Python."""
    return [name for name in names if ":" not in name]


def load(name: str) -> Extension:
    """Import the object named ``module:Attribute`` or ``path/to/file.py:Attribute``. Raises ExtensionError."""
    place, colon, attribute = name.rpartition(":")
    if not colon or not place or not attribute:
        raise ExtensionError(
            f"own code {name}: must be module:Attribute or path/to/file.py:Attribute, for example my_filter:MyFilter"
        )
    source: bytes | None
    if place.endswith(".py"):
        module, source = _from_file(name, Path(place).expanduser())
        file = Path(place).expanduser()
        imports = imports_sha256(file, source, (file.resolve().parent, Path.cwd()))
    else:
        module = _from_module(name, place)
        source = _read(getattr(module, "__file__", None))
        imports = module_imports(module, source)
    found: Any = module
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise ExtensionError(
                _attribute_problem(name, module, part, [n for n in dir(found) if not n.startswith("_")])
            )
        found = getattr(found, part)
    if not callable(found):
        raise ExtensionError(
            f"own code {name}: is a {type(found).__name__}, which is not callable; name a class or a function"
        )
    sha256 = None if source is None else hashlib.sha256(source).hexdigest()
    return Extension(name, found, sha256, _files(found) | {str(getattr(module, "__file__", ""))}, imports)


def module_imports(module: ModuleType, source: bytes | None) -> Mapping[str, str]:
    """Return path -> SHA-256 of the files that a module imports from its own package, or from its folder if that is not an installation.

    Args:
        module: the module.
        source: content of its file; None without a file.

    """
    if source is None or not str(module.__file__).endswith(".py"):
        return {}
    file, parts = Path(str(module.__file__)).resolve(), module.__name__.split(".")
    depth = len(parts) - (0 if file.name == "__init__.py" else 1)
    root = file.parent if module.__name__ == "__main__" or depth >= len(file.parents) else file.parents[depth]
    installed = {"site-packages", "dist-packages"} & set(root.parts) or root == Path(os.__file__).resolve().parent
    return imports_sha256(file, source, (root,), only=parts[0] if installed else None)


def _from_object(name: str, factory: Callable[..., Any]) -> Extension:
    """Return the Extension of a class or function given in Python. Raises ExtensionError."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise ExtensionError(
            f"own code {name!r}: a name must be letters, digits, - and _, and start with a letter or digit"
        )
    for family in families.FAMILIES:
        if families.is_taken(family, name):
            raise ExtensionError(f"own code {name}: is the name of one of flightbed's {family}; choose another")
    if not callable(factory):
        raise ExtensionError(
            f"own code {name}: is a {type(factory).__name__}, which is not callable; give a class or a function"
        )
    try:
        source = _read(inspect.getsourcefile(_subject(factory)))
    except (TypeError, OSError):
        source = None
    sha256 = None if source is None else hashlib.sha256(source).hexdigest()
    module = sys.modules.get(_subject(factory).__module__)
    imports = {} if module is None or getattr(module, "__file__", None) is None else module_imports(module, source)
    return Extension(name, factory, sha256, _files(factory), imports)


@cache
def installed_sha256(family: str, name: str) -> str | None:
    """Return the hash of the sources of an installed kind: of its module and of all that this imports from its own package.

    None for a kind that is not installed by another package, and for one without a source file.
    """
    place = families.installed_module(family, name)
    if place is None:
        return None
    module = importlib.import_module(place)
    source = _read(getattr(module, "__file__", None))
    if source is None:
        return None
    imports = module_imports(module, source)
    return digest({"": source, **{path: sha256.encode() for path, sha256 in imports.items()}})


def _from_file(name: str, path: Path) -> tuple[ModuleType, bytes]:
    """Execute a file as a module, unless the same path and text were executed before."""
    try:
        source = path.read_bytes()
    except OSError as error:
        raise ExtensionError(f"own code {name}: {path} cannot be read: {error.strerror}") from None
    path = path.resolve()
    module_name = f"flightbed_own_{hashlib.sha256(str(path).encode() + source).hexdigest()[:16]}"
    if module_name in sys.modules:
        return sys.modules[module_name], source
    module = ModuleType(module_name)
    module.__file__ = str(path)
    with _importing(name, str(path.parent), str(Path.cwd())):
        code = compile(source, str(path), "exec")
        sys.modules[module_name] = module  # dataclasses and pickle look there
        try:
            exec(code, vars(module))
        except BaseException:
            del sys.modules[module_name]
            raise
    return module, source


def _from_module(name: str, place: str) -> ModuleType:
    importlib.invalidate_caches()  # the file may be newer than the cached listing of its folder
    try:
        with _importing(name, str(Path.cwd())):
            return importlib.import_module(place)
    except ExtensionError as error:
        cause = error.__cause__
        if isinstance(cause, ModuleNotFoundError) and cause.name and f"{place}.".startswith(f"{cause.name}."):
            raise ExtensionError(
                f"own code {name}: module '{cause.name}' is neither installed nor in the working directory; check the "
                "name, or give the file, as in path/to/my_filter.py:MyFilter"
            ) from cause
        raise


@contextmanager
def _importing(name: str, *folders: str) -> Iterator[None]:
    """Import with these folders at the end of sys.path; restore sys.path; raise ExtensionError for an import that fails."""
    before = list(sys.path)
    sys.path.extend(folders)
    try:
        yield
    except (Exception, SystemExit) as error:
        raise ExtensionError(f"own code {name}: cannot be imported: {location(error)}{error_line(error)}") from error
    finally:
        sys.path[:] = before


def _attribute_problem(name: str, module: ModuleType, part: str, known: Sequence[str]) -> str:
    file = getattr(module, "__file__", None) or "built in"
    place, _, attribute = name.rpartition(":")
    beside = Path(place.replace(".", "/") + ".py")
    if beside.is_file() and beside.resolve() != Path(file).resolve():
        return (
            f"own code {name}: module '{place}' was imported from {file}, which has no '{part}'; to use the file in the working "
            f"directory, name it {beside}:{attribute}"
        )
    return f"own code {name}: {file} has no '{part}'{did_you_mean(part, known) or '; check the name'}"


def _is_settings(factory: Any) -> bool:
    return isinstance(factory, type) and issubclass(factory, Settings)


def _subject(factory: Any) -> Any:
    """Return the class or function behind a factory: partials and decorators removed, an instance replaced by its class."""
    while isinstance(factory, partial):
        factory = factory.func
    factory = inspect.unwrap(factory)
    return factory if inspect.isroutine(factory) or isinstance(factory, type) else type(factory)


def _files(factory: Any) -> frozenset[str]:
    subject = _subject(factory)
    members = [subject, *(vars(subject).values() if isinstance(subject, type) else ())]
    codes = [getattr(inspect.unwrap(m) if callable(m) else m, "__code__", None) for m in members]
    return frozenset(code.co_filename for code in codes if code is not None)


def _read(file: str | None) -> bytes | None:
    try:
        return None if file is None else Path(file).read_bytes()
    except OSError:
        return None
