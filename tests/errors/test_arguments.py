"""Arguments of another type than declared are refused; whatever does as well as the declared type is taken."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
import pytest

import mjfish
from mjfish.errors import InputError, UnknownNameError
from mjfish.errors.arguments import check, checked
from mjfish.numerics.arrays import FloatArray

TAKEN: list[tuple[Any, Any]] = [
    (3, float), (np.float32(1.5), float), (np.int64(3), float), (np.int64(3), int), (None, float | None),
    ("ode", Literal["ode", "mujoco"]), ({"a": np.float64(1.0)}, Mapping[str, float]), ({}, Mapping[str, float]),
    ([], Sequence[str]), ({"v1"}, Sequence[str]), (np.arange(3), Sequence[float]),
    (["a", Path()], Sequence[str | Path]),
    (np.zeros(3), FloatArray), (print, Callable[[str], None]), (object(), Any), ((1.0, 2.0), tuple[float, ...]),
    ((), tuple[float, ...]), (("a", 1.0), tuple[str, float]), ([[1.0], [2.0, 3.0]], Sequence[Sequence[float]]),
]  # fmt: skip
REFUSED: list[tuple[Any, Any, str]] = [
    (True, float, "found True (bool), expected float"),
    (1.5, int, "found 1.5 (float), expected int"),
    ("1", float | None, "found '1' (str), expected float | None"),
    ("od", Literal["ode", "mujoco"], "expected Literal['ode', 'mujoco']"),
    (np.zeros(3), Literal["ode", "mujoco"], "(ndarray), expected Literal"),
    ({"a": "x"}, Mapping[str, float], "found {'a': 'x'} (dict), expected Mapping[str, float]"),
    ({3: 1.0}, Mapping[str, float], "expected Mapping[str, float]"),
    ("v1", Sequence[str], "found 'v1' (str), expected Sequence[str]"),
    ({"v1": 1}, Sequence[str], "expected Sequence[str]"),
    (np.array(3.0), Sequence[float], "expected Sequence[float]"),
    (["v1", 3], Sequence[str], "found ['v1', 3] (list)"),
    (np.array(["a"]), FloatArray, "(ndarray), expected ndarray;"),
    (3, Callable[[str], None], "expected Callable[[str], None]"),
    (("a",), tuple[str, float], "expected tuple[str, float]"),
    (3, tuple[float, ...], "expected tuple[float, ...]"),
    ("pike", mjfish.Fish, "found 'pike' (str), expected Fish"),
]


@pytest.mark.parametrize(("value", "hint"), TAKEN)
def test_what_does_as_well_as_the_declared_type_is_taken(value: Any, hint: Any) -> None:
    check("here", value, hint)


@pytest.mark.parametrize(("value", "hint", "said"), REFUSED)
def test_another_type_is_refused_with_what_was_found_and_expected(value: Any, hint: Any, said: str) -> None:
    with pytest.raises(InputError) as error:
        check("here", value, hint)
    assert str(error.value).startswith("here: found ")
    assert said in str(error.value)
    assert str(error.value).endswith("; correct it")


class _Options(TypedDict, total=False):
    rate: float


@checked
def _example(first: int, *, second: str = "", **options: Unpack[_Options]) -> tuple[int, str, _Options]:
    """Return what is given."""
    return first, second, options


def test_a_checked_function_is_called_as_before() -> None:
    assert _example(1, second="a", rate=2.0) == (1, "a", {"rate": 2.0})
    assert _example.__doc__ == "Return what is given."


def test_a_checked_function_names_itself_and_the_argument() -> None:
    with pytest.raises(InputError, match=r"^_example: first: found 'a' \(str\), expected int"):
        _example("a")  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^_example: rate: found 'a'"):
        _example(1, rate="a")  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match=r"^unknown argument of _example 'rat'; known: rate$"):
        _example(1, rat=2.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="missing a required argument: 'first'"):
        _example()  # type: ignore[call-arg]


@checked
def _opening(path: str) -> str:
    return Path(path).read_text(encoding="utf-8")


@checked
def _failing() -> None:
    raise OSError("no file is to blame")


def test_what_the_system_says_of_a_file_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x: File name too long; give another file or folder$"):
        _opening("x" * 300)
    with pytest.raises(InputError, match=f"^{tmp_path}: Is a directory;"):
        _opening(str(tmp_path))
    with pytest.raises(OSError, match="no file is to blame"):
        _failing()


#: Public functions, and what they need beside their first argument.
FUNCTIONS: dict[str, dict[str, Any]] = {
    "check": {}, "compare": {"against": []}, "diagnose": {}, "generate": {"modes": []}, "identify": {}, "inspect": {},
    "load_dataset": {}, "load_diagnosis": {}, "load_fish": {},
    "new_fish": {"length": 1.0, "mass": 1.0, "joints": 1, "height": 0.1},
    "plan": {}, "sample": {}, "simulate": {},
}  # fmt: skip


def test_the_list_of_public_functions_is_complete() -> None:
    assert set(FUNCTIONS) == {name for name in mjfish.__all__ if name[0].islower()}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_is_checked_and_found_by_other_processes(name: str) -> None:
    function = getattr(mjfish, name)
    assert pickle.loads(pickle.dumps(function)) is function  # noqa: S301 - our own
    with pytest.raises(InputError, match=f"^{name}: "):
        function(object(), **FUNCTIONS[name])
