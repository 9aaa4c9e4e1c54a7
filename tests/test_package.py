"""The package's own names: the water is one import away, and costs nothing to those who do not ask."""

from __future__ import annotations

import subprocess
import sys

import pytest

import mjfish


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


def test_every_name_is_there() -> None:
    """Catches a name that is promised and was moved or renamed."""
    for name in mjfish.__all__:
        assert getattr(mjfish, name) is not None


def test_unknown_name_is_an_attribute_error() -> None:
    """`hasattr` and `from mjfish import x` rely on it; the message names what was asked for."""
    assert not hasattr(mjfish, "StripFluids")
    with pytest.raises(AttributeError, match="'StripFluids'"):
        mjfish.StripFluids  # noqa: B018
