"""The problem as plain functions: an optimiser that knows nothing of mjfish finds what `fit` finds."""

from __future__ import annotations

import textwrap
from dataclasses import replace

import numpy as np
import pytest
from pike_coefficients import COEFFICIENTS
from scipy.optimize import least_squares
from synthetic_swimming import SIGMA, TRUTH, as_measured, problem, swimming

from mjfish.data import Dataset
from mjfish.errors import InputError, ParameterError, UnknownNameError
from mjfish.estimation import fit
from mjfish.estimation.nominal import first_sigma, residual_function
from mjfish.fish import Fish


@pytest.fixture(scope="module")
def synthetic(pike: Fish) -> Dataset:
    return swimming(pike, ("v1", "v3", "v5"), held_out=["v3"])


def test_scipy_alone_finds_the_optimum_of_fit(synthetic: Dataset) -> None:
    """Catches held-out trials let in, a jacobian of the prediction (the other sign), weights that differ."""
    residual, jacobian, names, start, low, high = residual_function(synthetic)
    assert names == COEFFICIENTS
    found = least_squares(residual, start, jac=jacobian, bounds=(low, high), x_scale="jac", ftol=1e-12, xtol=1e-12)
    own = fit(problem(synthetic), tolerance=1e-12)
    assert found.success
    assert 2.0 * found.cost == pytest.approx(own.sse, rel=1e-9)
    sigma = np.array([own.sigma[name] for name in names])
    np.testing.assert_allclose(found.x / sigma, own.x / sigma, rtol=0, atol=1e-3)


def test_the_example_runs_as_it_stands(synthetic: Dataset, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (residual_function.__doc__ or "").split("Example:\n", 1)[1]
    exec(textwrap.dedent(lines), {"dataset": synthetic, "residual_function": residual_function})  # noqa: S102
    assert "'c_m.head': " in capsys.readouterr().out


def test_the_jacobian_is_that_of_the_residual(synthetic: Dataset) -> None:
    one = residual_function(synthetic, fixed={"c_m.head": 0.5})
    x = one.start * 1.1
    exact = one.jacobian(x)
    assert one.names == COEFFICIENTS[1:]
    assert exact.shape == (2 * 3 * 151, 8)
    for k in range(8):
        step = np.zeros(8)
        step[k] = 1e-5 * x[k]
        difference = (one.residual(x + step) - one.residual(x - step)) / (2.0 * step[k])
        np.testing.assert_allclose(exact[:, k], difference, rtol=0, atol=1e-5 * np.abs(difference).max())


def test_start_and_bounds_are_those_of_the_dataset(synthetic: Dataset) -> None:
    declared = synthetic.fish.parameters
    one = residual_function(synthetic)
    for values, key in ((one.start, "start"), (one.low, "low"), (one.high, "high")):
        assert values.tolist() == [getattr(p, key) for p in declared]
        assert not values.flags.writeable


def test_what_belongs_to_a_trial_alone_is_free_too(pike: Fish, synthetic: Dataset) -> None:
    """Start velocities of measured joints, a free clock; they come after the coefficients, by the trial's name."""
    late = replace(as_measured(synthetic.trials[0], pike), role="fit")
    one = residual_function(replace(synthetic, trials=(late, synthetic.trials[2]), clock="free"))
    assert one.names[9:] == ("v1:start.surge", "v1:start.sway", "v1:start.yaw_rate", "v1:clock.offset",
                             "v5:clock.offset")  # fmt: skip
    np.testing.assert_array_equal(one.start[9:12], late.velocity[0])
    assert one.jacobian(one.start).shape[1] == 14


def test_noise_divides_the_residual(synthetic: Dataset) -> None:
    """Given, stated by the dataset, or a first one where neither is."""
    truth = np.array(list(TRUTH.values()))
    stated = residual_function(synthetic).residual(truth)
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(
        residual_function(synthetic, noise=2.0 * SIGMA).residual(truth), 0.5 * stated, rtol=1e-12
    )
    first = residual_function(replace(synthetic, noise=None)).residual(truth)
    sigma = first_sigma(synthetic.split()[0])
    np.testing.assert_allclose(first.reshape(-1, 3) * sigma, stated.reshape(-1, 3) * SIGMA, rtol=1e-12)


def test_misuse_is_named(synthetic: Dataset) -> None:
    with pytest.raises(UnknownNameError, match=r"coefficient 'c_d\.fin'; known: c_d\.body"):
        residual_function(synthetic, fixed={"c_d.fin": 1.0})
    with pytest.raises(ParameterError, match=r"c_d\.head: value 9 - is outside its bounds"):
        residual_function(synthetic, fixed={"c_d.head": 9.0})
    for noise in (np.zeros(3), np.ones(2), np.array([1.0, np.nan, 1.0])):
        with pytest.raises(InputError, match="expected three numbers above 0: surge, sway, yaw rate"):
            residual_function(synthetic, noise=noise)
    with pytest.raises(InputError, match=r"x has shape \(8,\), expected \(9,\)"):
        residual_function(synthetic).residual(np.ones(8))
