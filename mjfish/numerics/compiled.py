"""Compilation by numba, cached on disk so that a later process starts at once.

numba's own cache looks at the file of a function only: after an edit in another file that the function calls, it
would return stale machine code, and in a fresh copy of the same sources it would find nothing. Here the cache folder
carries a hash of the code of every compiled source and of the versions below it. Comments, docstrings, the place of
the package and the dates of its files do not count.
"""

from __future__ import annotations

import contextlib
import copyreg
import functools
import gc
import hashlib
import importlib
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from types import CodeType
from typing import Any, TypeVar, cast

import numba
from numba.core.caching import _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parents[1]
#: Where functions are compiled; sources elsewhere do not end up in machine code.
_COMPILED = (
    *(f"{folder}/**/*.py" for folder in ("drive", "hydro", "ode", "mujoco", "effects", "noise")),
    "diagnosis/description.py",
    "estimation/sensor_noise.py",
    "fish/outline.py",
)


@functools.cache
def cache_folder() -> Path:
    """Return the folder of compiled code for exactly these sources and these libraries."""
    digest = hashlib.sha256()
    for library in ("numba", "llvmlite", "numpy", "mujoco"):
        digest.update(f"{library} {version(library)}\n".encode())
    sources = [Path(__file__)]  # how functions are compiled
    for pattern in _COMPILED:
        sources += sorted(_PACKAGE.glob(pattern))
    for source in sources:
        code = compile(source.read_bytes(), "", "exec", dont_inherit=True, optimize=2)
        digest.update(f"{source.relative_to(_PACKAGE)} {_instructions(code)}\n".encode())
    return _root() / digest.hexdigest()[:16]


def _root() -> Path:
    """Return the folder of all compiled code of this user."""
    folder = os.environ.get("XDG_CACHE_HOME")
    return (Path(folder) if folder else Path("~/.cache").expanduser()) / "mjfish"


@functools.cache
def keeps_code() -> bool:
    """Return whether compiled code is kept on disk; where it cannot be, say so once.

    Nothing else is tried: code in a folder that others write to would be theirs.
    """
    if numba.config.CACHE_LOCATOR_CLASSES:
        return True  # the user's own
    try:
        folder = Path(numba.config.CACHE_DIR or _root())
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except (OSError, RuntimeError) as error:  # the latter without any home
        warnings.warn(
            f"compiled code cannot be kept ({error}): every start compiles anew, which takes half a minute; "
            "set XDG_CACHE_HOME to a folder that you can write to",
            stacklevel=3,
        )
        return False
    return True


def _instructions(code: CodeType) -> tuple[object, ...]:
    """Return what a code object does, without its place in the file."""
    constants = [_instructions(item) if isinstance(item, CodeType) else repr(item) for item in code.co_consts]
    return code.co_code, code.co_names, code.co_varnames, code.co_freevars, constants


class SourceLocator(_CacheLocator):  # type: ignore[misc]
    """Tells numba where the machine code of a function of this package lies: see the top of this file."""

    def __init__(self, file: Path) -> None:
        self._py_file = str(file)  # numba names it in its warnings
        self._folder = cache_folder() / file.relative_to(_PACKAGE).with_suffix("")

    def get_cache_path(self) -> str:
        """Return the folder of the machine code of this file."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """Return nothing: the folder's name carries the hash of the sources."""
        return ""

    def get_disambiguator(self) -> str:
        """Return nothing: functions of one name differ in their bytecode, which is in numba's key."""
        return ""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> SourceLocator | None:
        """Return the locator of a function of this package; None for others and where nothing can be written."""
        del py_func
        file = Path(py_file)
        if not file.is_relative_to(_PACKAGE):
            return None
        locator = cls(file)
        try:
            locator.ensure_cache_path()
        except OSError:
            return None
        return locator


def compiled(function: F) -> F:
    """Compile `function` for the CPU, without the GIL; IEEE division; cached on disk.

    Functions of a user's own file are compiled anew in every process: what they read from other files is not hashed.
    """
    return _cached(function)


def _by_name(dispatcher: Any) -> Any:
    """Return how a compiled function is pickled: of this package by its name, of others as numba does it."""
    function = dispatcher.py_func
    if getattr(sys.modules[function.__module__], function.__name__, None) is dispatcher and is_ours(function):
        return _named, (function.__module__, function.__name__)
    return dispatcher.__reduce__()


def _named(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)


copyreg.pickle(CPUDispatcher, _by_name)


def inlined(function: F) -> F:
    """Compile like `compiled`, but as a part of every compiled function that calls it: for the innermost loops."""
    return _cached(function, inline="always")


def borrowing(function: F) -> F:
    """Compile like `compiled`, for functions that allocate nothing: their views of arrays are not counted."""
    return _cached(function, _nrt=False)


def part(function: F, *, allocates: bool = False) -> F:
    """Compile as a part of the compiled functions that call it.

    It is typed once, unlike what is `inlined`, and becomes machine code only within its callers: that takes half the
    time of functions compiled one by one, each with all that it calls.

    Args:
        function: the function.
        allocates: whether it may make arrays; else its views of arrays are not counted.
    """
    return cast(F, _Part(function, {**_OF_PARTS, "_nrt": allocates}))


def merged(function: F) -> F:
    """Compile like `part`, and let LLVM put it into every function that calls it."""
    return cast(F, _Part(function, {**_OF_PARTS, "_nrt": False, "forceinline": True}))


_OPTIONS = {"nopython": True, "boundscheck": None, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_OF_PARTS = {**_OPTIONS, "no_cpython_wrapper": True}


def _cached(function: F, **options: Any) -> F:
    kernel: Any = _Kernel(function, targetoptions={**_OPTIONS, **options})
    if is_ours(function) and keeps_code():
        with _CacheDir():
            kernel.enable_caching()
    return cast(F, kernel)


def is_ours(function: Callable[..., Any]) -> bool:
    """Return whether a function is of this package: only of those is the code kept."""
    return Path(function.__code__.co_filename).is_relative_to(_PACKAGE)


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Hold the collection of reference cycles: numba makes so many objects that it takes a tenth of the time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Kernel(CPUDispatcher):  # type: ignore[misc]
    """A function that Python calls, compiled for each of the types it is called with."""

    def compile(self, sig: Any) -> Any:
        """Compile for types of arguments, or load from disk."""
        with _no_collection():
            return super().compile(sig)


class _Part(CPUDispatcher):  # type: ignore[misc]
    """A function that becomes machine code only within its callers."""

    def __init__(self, function: Callable[..., Any], options: Any) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_PartCompiler)

    def __reduce__(self) -> Any:
        """Be the same in every process: numba's key of a cached closure over it is made of this."""
        function = self.py_func
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        return str, (repr((function.__module__, function.__qualname__, _instructions(function.__code__), cells)),)

    def compile(self, sig: Any) -> Any:
        """Compile for types of arguments; constants are values of their types, not a signature of their own."""
        return super().compile(tuple(numba.types.unliteral(kind) for kind in sig))

    def __call__(self, *arguments: Any) -> Any:
        """Call it from Python, compiled on its own."""
        return self._whole(*arguments)

    @functools.cached_property
    def _whole(self) -> Any:
        return compiled(self.py_func)


class _PartCompiler(Compiler):  # type: ignore[misc]
    """Puts the code of a part into a library of its own kind."""

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a function."""
        self.state.library = _PartLibrary(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code that callers link; neither optimised as a whole nor made machine code here."""

    def _optimize_final_module(self) -> None:
        """Leave it to the callers."""

    def _finalize_final_module(self) -> None:
        """Keep the module out of the engine."""
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return that there is no machine code, and so no wrapper for Python."""
        del name
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """The generator of code; of code that is complete, one that knows no place to write to."""
        return _NoPlace if self._finalized else self._codegen


class _NoPlace:
    """Stands for the engine, in which the code of a part is not."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Write nothing: what carries the name is in the callers."""


def c_callback(signature: Any, *, cached: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function to a C callback of the numba `signature`; cached on disk like `compiled`.

    Args:
        signature: of the callback.
        cached: False for a closure over compiled code, whose key is another one in every process: its entries would
            never be found again and pile up.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        cache = cached and keeps_code()
        with _CacheDir(), _no_collection():
            return numba.cfunc(signature, cache=cache, error_model="numpy")(function)

    return decorate


class _CacheDir:
    """Makes numba look into the cache folder while a function is decorated: it decides then and only then.

    A folder that the user set (NUMBA_CACHE_DIR) is left to numba.
    """

    def __enter__(self) -> None:
        self._before = numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES
        if not any(self._before) and keeps_code():
            numba.config.CACHE_DIR = str(cache_folder())  # where the file is no file of ours
            numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.SourceLocator,UserProvidedCacheLocator"

    def __exit__(self, *_: object) -> None:
        numba.config.CACHE_DIR, numba.config.CACHE_LOCATOR_CLASSES = self._before
