"""The water inside MuJoCo's own fitter, which builds models and rolls them out by itself, in threads."""

from __future__ import annotations

import copy
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from doc_blocks import ROOT, module
from mujoco import sysid

from mjfish import StripFluid
from mjfish.numerics.arrays import FloatArray


def test_the_extra_is_whole() -> None:
    """`import mujoco.sysid` swallows a missing package and leaves the module empty: then all below would fail oddly."""
    assert hasattr(sysid, "optimize"), "pip install 'mujoco[sysid]', or all of requirements.lock"
    assert hasattr(sysid, "default_report")


def _plate() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(ROOT / "models" / "xml" / "towed_plate.xml"))


def _swimmer(links: int) -> mujoco.MjSpec:
    """The swimmer of docs/mujoco-plugin.md, its water written into custom numerics."""
    page: ModuleType = module(ROOT / "docs" / "mujoco-plugin.md", "swimmer")
    spec = page.chain(links)
    spec.option.timestep = 0.002
    for water in page.strips(links, height=0.1, c_d=1.3, c_m=0.8):
        body = water.pop("body")
        for key, value in water.items():
            spec.add_numeric(name=f"strip_fluid/{body}/{key}", data=[value])
    for joint in ("rootx", "rooty"):
        kind = mujoco.mjtSensor.mjSENS_JOINTVEL
        spec.add_sensor(name=joint, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
    return spec


def _measure(spec: mujoco.MjSpec, commands: FloatArray, noise: float = 0.0) -> sysid.ModelSequences:
    """Roll the model out in its own water, one sequence for each of `commands` (sequences, steps, nu)."""
    water = StripFluid(spec.compile())
    model = water.model
    start = sysid.create_initial_state(model, np.zeros(model.nq), np.zeros(model.nv))
    with water.installed():
        states, sensors = mujoco.rollout.rollout(model, mujoco.MjData(model), start, commands[:, :-1])
    sensors = sensors + noise * np.random.default_rng(3).normal(size=sensors.shape)
    time = model.opt.timestep * np.arange(commands.shape[1])
    return sysid.ModelSequences(
        "model",
        spec,
        [f"run_{k}" for k in range(len(commands))],
        [start] * len(commands),
        [sysid.TimeSeries(time, command) for command in commands],
        [sysid.TimeSeries.from_names(states[0, :, 0], sensor, model) for sensor in sensors],
    )


def _tows() -> FloatArray:
    time = 0.002 * np.arange(1500)
    slow, fast = 6.0 * np.sin(np.pi * time), 20.0 * np.sin(4.0 * np.pi * time)
    return np.array([3.0 + slow + fast, fast - 2.0])[..., None]


def _waves(links: int) -> FloatArray:
    time = 0.002 * np.arange(500)[:, None]
    station = np.arange(1, links) / links
    return np.array([b / links * np.sin(2.0 * np.pi * (station - f * time)) for b, f in ((4.0, 1.0), (2.0, 2.5))])


def _parameters(spec: mujoco.MjSpec, guesses: dict[str, float]) -> sysid.ParameterDict:
    """Coefficients that all links share, written where `StripFluid(model)` reads them."""
    parameters = sysid.ParameterDict()
    bodies = {name.split("/")[1] for name in (n.name for n in spec.numerics) if name.endswith("/c_d")}
    for key, guess in guesses.items():

        def write(spec: mujoco.MjSpec, parameter: sysid.Parameter, key: str = key) -> None:
            for body in bodies:
                spec.numeric(f"strip_fluid/{body}/{key}").data = parameter.value

        parameters.add(sysid.Parameter(key, guess, 0.05, 6.0, modifier=write))
    return parameters


def _build(parameters: sysid.ParameterDict, spec: mujoco.MjSpec) -> mujoco.MjModel:
    model = sysid.apply_param_modifiers(parameters, spec)
    StripFluid(model)
    return model


def _fit(measured: sysid.ModelSequences, guesses: dict[str, float], **options: Any) -> tuple[Any, Any, Any]:
    residual = sysid.build_residual_fn(models_sequences=[measured], build_model=_build, n_threads=2)
    start = _parameters(measured.spec, guesses)
    with StripFluid(measured.spec.compile()).installed():
        found, result = sysid.optimize(start, residual, verbose=False, **options)
    return found, result, residual


@pytest.mark.parametrize("optimizer", ["mujoco", "scipy_parallel_fd"])
def test_fit_recovers_drag_and_added_mass_of_the_plate(optimizer: str) -> None:
    """True values 1.9 and 1, started at half and less; every finite difference is a model with water of its own.

    Catches models that share one water, and a model that is dry in a thread or was left with the water before it.
    """
    _, result, _ = _fit(_measure(_plate(), _tows()), {"c_d": 0.7, "c_m": 0.3}, optimizer=optimizer)
    np.testing.assert_allclose(result.x, [1.9, 1.0], rtol=1e-7)


def test_fit_recovers_the_coefficients_of_a_swimmer() -> None:
    """Six links with joint limits, coupling "inertia", from the velocity of the head and the torques."""
    _, result, _ = _fit(_measure(_swimmer(6), _waves(6)), {"c_d": 0.5, "c_m": 2.0})
    np.testing.assert_allclose(result.x, [1.3, 0.8], rtol=1e-6)


def test_with_noise_the_fit_is_as_good_as_the_noise_allows(tmp_path: Path) -> None:
    """Within its own intervals, which are narrow; and what the fitter saves is the MJCF with the water found."""
    measured = _measure(_plate(), _tows(), noise=0.01)
    start = _parameters(measured.spec, {"c_d": 0.7, "c_m": 0.3})
    found, result, residual = _fit(measured, {"c_d": 0.7, "c_m": 0.3})
    with StripFluid(measured.spec.compile()).installed():
        sysid.save_results(tmp_path, [measured], start, found, result, residual)
        residuals, _, _ = residual(result.x, found)
    _, half = sysid.calculate_intervals(residuals, result.jac, alpha=1e-3)
    assert np.all(np.abs(result.x - [1.9, 1.0]) < half)
    assert np.all(half < 0.02)
    (link,) = StripFluid(mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))).links
    np.testing.assert_allclose([link.c_d, link.c_m], result.x, rtol=1e-6)


def test_threads_do_not_change_the_residual() -> None:
    """Two threads roll models with different water out at once, bitwise as one thread does."""
    measured = _measure(_swimmer(6), _waves(6))
    columns = np.array([[1.3, 0.6, 2.0], [0.8, 1.1, 0.2]])

    def residual(threads: int) -> FloatArray:
        parameters = _parameters(measured.spec, {"c_d": 1.0, "c_m": 1.0})
        evaluate = sysid.build_residual_fn(models_sequences=[measured], build_model=_build, n_threads=threads)
        with StripFluid(measured.spec.compile()).installed():
            return np.array(evaluate(columns, parameters)[0])

    one = residual(1)
    np.testing.assert_array_equal(residual(2), one)
    assert np.abs(one[..., 0]).max() < 1e-12, "the truth fits"
    assert np.all(np.abs(one[..., 1:]).max(axis=(0, 1)) > 1e-3)


def test_models_are_dry_outside_the_block_and_lost_water_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the how-to warns of. A copy that outlives its original must not be dry: the fitter stops."""
    monkeypatch.chdir(tmp_path)  # MuJoCo logs there that the steps are spoilt
    measured = _measure(_plate(), _tows())
    parameters = _parameters(measured.spec, {"c_d": 1.9, "c_m": 1.0})
    truth = np.array([1.9, 1.0])

    def lost(parameters: sysid.ParameterDict, spec: mujoco.MjSpec) -> mujoco.MjModel:
        return copy.copy(_build(parameters, spec))

    def worst(build: Any) -> float:
        residual = sysid.build_residual_fn(models_sequences=[measured], build_model=build)
        return float(np.abs(np.concatenate(residual(truth, parameters)[0])).max())

    assert worst(_build) > 0.1
    with StripFluid(measured.spec.compile()).installed():
        assert worst(_build) < 1e-12
        with pytest.raises(ValueError, match="times must be strictly increasing"):
            worst(lost)
