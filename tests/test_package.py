"""The package's own names: each is one import away, described in full, and costs nothing to those who do not ask."""

from __future__ import annotations

import doctest
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mjfish

NAMES = [name for name in mjfish.__all__ if name != "__version__"]


def test_import_is_light_until_the_water_is_asked_for() -> None:
    """Catches an import of MuJoCo, or of anything that compiles, at the top of the package."""
    script = (
        "import sys, mjfish\n"
        "heavy = {'mujoco', 'numba', 'numpy'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "assert 'StripFluid' in dir(mjfish)\n"
        "mjfish.StripFluid\n"
        "assert heavy <= set(sys.modules)\n"
    )
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_the_package_shows_its_names_and_nothing_else() -> None:
    """Also after they were used, and their modules with them. Catches a name that is promised and was moved."""
    assert all(getattr(mjfish, name) is not None for name in mjfish.__all__)
    assert dir(mjfish) == sorted(mjfish.__all__)
    assert set(mjfish.__all__) == {*mjfish._HOME, "__version__"}
    unsaid = [name for name in mjfish.__all__ if name != "__version__" and f"`{name}`" not in (mjfish.__doc__ or "")]
    assert not unsaid


def test_no_module_below_the_package_hides_a_function() -> None:
    """`import mjfish.plan` would replace the function by the module."""
    folder = Path(mjfish.__file__).parent
    assert not {path.stem for path in folder.iterdir()} & set(NAMES)


def test_unknown_name_is_an_attribute_error() -> None:
    """`hasattr` and `from mjfish import x` rely on it; the message names what was asked for."""
    assert not hasattr(mjfish, "StripFluids")
    with pytest.raises(AttributeError, match="'StripFluids'"):
        mjfish.StripFluids  # noqa: B018


def _described(text: str, section: str) -> dict[str, str]:
    """Return the entries of a section of a Google-style docstring: description by name, entries of many names split."""
    found = re.search(rf"^{section}:\n((?:[ \t]+.*\n?|\n)*)", text, re.MULTILINE)
    entries: dict[str, str] = {}
    entry = r"^    ([\w, *]+):((?:.*\n?)(?:     .*\n?|\n)*)"
    for names, description in re.findall(entry, found[1] if found else "", re.MULTILINE):
        entries.update({name.strip(" *"): description for name in names.split(",")})
    return entries


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_is_described_in_full(name: str) -> None:
    """Each argument or attribute; the shape and unit of arrays; the errors of functions; an example."""
    value = getattr(mjfish, name)
    text = inspect.getdoc(value) or ""
    assert re.match(r"[A-Z`].*\.$", text.splitlines()[0]), "a sentence first"
    assert ">>> " in text, "an example"
    if inspect.isclass(value):
        entries = {**_described(text, "Attributes"), **_described(text, "Args")}
        fields = {k: str(v) for k, v in getattr(value, "__annotations__", {}).items() if not k.startswith("_")}
        fields = {} if issubclass(value, Exception) else fields
    else:
        entries = _described(text, "Args")
        parameters = inspect.signature(value).parameters
        fields = {k: str(p.annotation) for k, p in parameters.items()}
        assert _described(text, "Raises"), "its errors"
    assert set(fields) <= set(entries), f"not described: {sorted(set(fields) - set(entries))}"
    for field, annotation in fields.items():
        if "FloatArray" in annotation and "Mapping" not in annotation:
            assert re.search(r"\(\w+,.*?\)", entries[field]), f"the shape of {field}"


@pytest.mark.parametrize("name", NAMES)
def test_the_example_of_every_public_name_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = inspect.getdoc(getattr(mjfish, name)) or ""
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    example = doctest.DocTestParser().get_doctest(text, {"mjfish": mjfish}, name, None, 0)
    assert example.examples, "no example"
    printed: list[str] = []
    failures = doctest.DocTestRunner(optionflags=flags).run(example, out=printed.append)
    assert failures.failed == 0, "".join(printed)
