"""Arguments of another type than declared are refused in a sentence, before anything is computed with them."""

from __future__ import annotations

import functools
import inspect
import re
import reprlib
from collections.abc import Callable, Collection, Mapping, Sequence
from numbers import Integral, Real
from types import UnionType
from typing import Any, Literal, TypeVar, Union, Unpack, get_args, get_origin, get_type_hints

import numpy as np

from mjfish.errors import InputError, UnknownNameError, system_refusals

F = TypeVar("F", bound=Callable[..., Any])
_hints = functools.cache(get_type_hints)


def checked(function: F) -> F:
    """Return a public function or method of mjfish that refuses arguments of another type than it declares.

    Raises:
        InputError: by the returned function; says which argument, what was found, and what was expected. Also where
            the system refuses a file.
        UnknownNameError: by the returned function: a keyword that its ``**`` does not declare.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def call(*args: Any, **keywords: Any) -> Any:
        hints = _hints(function)
        for name, value in signature.bind(*args, **keywords).arguments.items():
            hint = hints.get(name, Any)  # of self there is none
            if get_origin(hint) is Unpack:
                _check_options(function.__name__, value, *get_args(hint))
            else:
                check(f"{function.__name__}: {name}", value, hint)
        with system_refusals():
            return function(*args, **keywords)

    return call  # type: ignore[return-value]  # of the same signature


def _check_options(function: str, given: Mapping[str, Any], declared: type) -> None:
    """Check the keywords that a function takes by ``**``, declared by a TypedDict."""
    hints = _hints(declared)
    for name, value in given.items():
        if name not in hints:
            raise UnknownNameError(f"argument of {function}", name, hints)
        check(f"{function}: {name}", value, hints[name])


def check(place: str, value: object, hint: Any) -> None:
    """Refuse a value of another type than `hint`; `place` opens the message.

    Raises:
        InputError: says what was found, and what was expected.
    """
    if not _fits(value, hint):
        raise InputError(
            f"{place}: found {' '.join(reprlib.repr(value).split())} ({type(value).__name__}), expected {_words(hint)}"
            "; correct it"
        )


def _fits(value: Any, hint: Any) -> bool:
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_fits(value, one) for one in inner)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if hint is Any:
        return True
    if origin is Mapping:
        return isinstance(value, Mapping) and all(_fits(k, inner[0]) and _fits(v, inner[1]) for k, v in value.items())
    if origin is Sequence:
        listed = isinstance(value, Collection) and not isinstance(value, (str, bytes, Mapping))
        return listed and getattr(value, "shape", None) != () and all(_fits(item, inner[0]) for item in value)
    if origin is tuple:
        inner = inner[:1] * len(value) if inner[1:] == (...,) and isinstance(value, (tuple, list)) else inner
        return isinstance(value, (tuple, list)) and len(value) == len(inner) and all(map(_fits, value, inner))
    if hint in (float, int):
        return isinstance(value, Real if hint is float else Integral) and not isinstance(value, bool)
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype.kind in "buif"
    return not isinstance(kind := origin or hint, type) or isinstance(value, kind)


def _words(hint: Any) -> str:
    """Return a type as Python writes it, without the modules of its names."""
    return re.sub(r"\w+\.|(?<=ndarray)\[tuple.*?\]\]", "", inspect.formatannotation(hint))
