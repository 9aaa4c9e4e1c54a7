"""What is known beforehand: of a fish's numbers, of coefficients, of start values, waves and causes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import mjfish
from mjfish.data import Dataset, Trial, save
from mjfish.drive.wave import Wave
from mjfish.effects.catalogue import find
from mjfish.errors import InputError, MjfishError
from mjfish.estimation import Problem, fit
from mjfish.estimation.clocks import aligned
from mjfish.estimation.nominal import nominal_problem
from mjfish.fish import write_fish
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.inspection.after_fit import contradicted
from mjfish.noise import Noise
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

PIKE = (Path(mjfish.__file__).parent / "fish" / "fishes" / "pike.toml").read_text(encoding="utf-8")
SIGMA = np.array([0.006, 0.006, 0.04])


def written(tmp_path: Path, **changed: str) -> mjfish.Fish:
    """Return the pike with lines of its file replaced."""
    text = PIKE.replace('name = "pike"', 'name = "other"', 1)
    for old, new in changed.items():
        key, value = old.split("__"), new
        line = f"{key[0]} = "
        start = text.index(line)
        text = text[:start] + f"{line}{value}" + text[text.index("\n", start) :]
    path = tmp_path / "other.toml"
    path.write_text(text, encoding="utf-8")
    return mjfish.load_fish(path)


def known_head(tmp_path: Path) -> mjfish.Fish:
    """Return the pike whose head's mass, centre of mass and length are known roughly."""
    return written(
        tmp_path,
        length="{ value = 0.291, sd = 0.01 }",
        mass="{ value = 1.6, sd = 0.2 }",
        com="{ value = 0.17, sd = 0.01 }",
    )


def test_a_number_with_an_sd_is_free_and_comes_back_from_a_file(tmp_path: Path) -> None:
    fish = known_head(tmp_path)
    assert [p.name for p in fish.numbers] == ["length.head", "mass.head", "com.head"]
    assert [p.sd for p in fish.numbers] == [0.01, 0.2, 0.01]
    path = tmp_path / "again.toml"
    write_fish(path, fish)
    assert mjfish.load_fish(path) == fish


def test_a_longer_link_takes_its_outline_along(tmp_path: Path) -> None:
    fish = known_head(tmp_path)
    longer = fish.with_numbers({"length.head": 0.31})
    assert longer.length == pytest.approx(fish.length + 0.019)
    assert longer.sections[-1].end == pytest.approx(longer.length)
    assert longer.sections[0].end == pytest.approx(fish.sections[0].end * 0.31 / 0.291)
    assert longer.sections[-1].end - longer.sections[-1].start == pytest.approx(
        fish.sections[-1].end - fish.sections[-1].start
    )


def test_a_fish_that_was_fitted_is_known_as_before(tmp_path: Path) -> None:
    fish = known_head(tmp_path).with_numbers({"mass.head": 1.9})
    mass = fish.numbers[1]
    assert (mass.default, mass.expected) == (1.9, 1.6)
    path = tmp_path / "fitted.toml"
    write_fish(path, fish)
    assert mjfish.load_fish(path).numbers[1].expected == 1.6


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("{ value = 1.6 }", "neither sd nor low and high"),
        ("{ value = 1.6, sd = -0.1 }", "must be above 0"),
        ("{ value = 1.6, low = 2.0, high = 3.0 }", "outside its bounds"),
        ("{ value = 1.6, low = 2.0, high = 1.0 }", "empty"),
        ("{ value = 1.6, std = 0.1 }", "unknown key"),
    ],
)
def test_a_prior_that_contradicts_itself_is_refused_where_it_stands(tmp_path: Path, value: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        written(tmp_path, mass=value)
    assert "other.toml" in str(caught.value)
    assert "mass" in str(caught.value)


def test_a_number_of_the_servo_cannot_be_free(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"servo\.kp: this number cannot be free"):
        written(tmp_path, kp="{ value = 40.0, sd = 4.0 }")


def test_deviation_of_a_positive_number_is_a_factor() -> None:
    drag = Parameter("c_d.head", "-", 2.0, 0.0, 10.0, 2.0, 0.1, sd=1.0)
    assert drag.deviation(3.0) == pytest.approx(1.0)
    assert drag.deviation(2.0 / 1.5) == pytest.approx(-1.0)
    assert drag.deviation(1e-30) < -100.0
    shift = Parameter("com.head", "m", 0.1, -1.0, 1.0, 0.1, 0.01, sd=0.02)
    assert shift.deviation(0.06) == pytest.approx(-2.0)
    for p, at in ((drag, 3.3), (shift, 0.05)):
        slope = (p.deviation(at + 1e-6) - p.deviation(at - 1e-6)) / 2e-6
        assert p.deviation_rate(at) == pytest.approx(slope, rel=1e-6)


def test_an_sd_must_be_positive() -> None:
    with pytest.raises(MjfishError, match="sd is 0"):
        Parameter("c_d.head", "-", 2.0, 0.0, 10.0, 2.0, 0.1, sd=0.0)


def waved(known: dict[str, ParameterPrior], fish: mjfish.Fish | None = None) -> Dataset:
    """Return two runs of the pike whose joints a wave drives, with a clock of its own."""
    pool = mjfish.generate("pike" if fish is None else fish, ["v1"], duration=3.0)
    wave = Wave(2.0, (0.1, 0.2, 0.3, 0.4), (0.0, -0.5, -1.0, -1.5), (0.0, 0.0, 0.1, 0.1), free=True)
    trials = []
    for name, phase in (("one", 0.0), ("two", 0.7)):
        trial = replace(pool.trials[0], name=name, drive=(), wave=wave.moved(phase=phase), role="fit")
        start = mjfish.Model(pool.fish).predict(trial, pool.fish.values, velocity=np.array([0.2, 0.0, 0.0]))
        trials.append(replace(trial, velocity=start.velocity))
    return replace(pool, trials=tuple(trials), known=known)


EVERYTHING = {
    "wave.scale": ParameterPrior(sd=0.2),
    "*:wave.frequency": ParameterPrior(sd=0.02),
    "two:wave.scale": ParameterPrior(sd=0.1),
    "one:start.surge": ParameterPrior(mean=0.2, sd=0.01),
    "joint_zero_offset.joint_1": ParameterPrior(sd=0.05),
    "com_offset.shift": ParameterPrior(mean=0.002, sd=0.01),
}


def problem_of(dataset: Dataset) -> Problem:
    """Return the nominal problem of a dataset."""
    return nominal_problem(dataset, dataset.trials, Noise.white(SIGMA))


def slopes(problem: Problem, x: FloatArray) -> FloatArray:
    """Return the Jacobian by central differences."""
    columns = []
    for i, p in enumerate(problem.parameters):
        step = np.zeros_like(x)
        step[i] = 2e-3 * p.scale
        columns.append((problem.residual(x - step) - problem.residual(x + step)) / (4e-3 * p.scale))
    return np.stack(columns, axis=1)


def test_every_known_number_has_an_exact_derivative(tmp_path: Path) -> None:
    dataset = waved(EVERYTHING, known_head(tmp_path))
    problem = problem_of(dataset)
    x = problem.start() + 0.3 * np.array([p.scale for p in problem.parameters])
    exact, numeric = problem.jacobian(x).dense(), slopes(problem, x)
    size = np.abs(numeric).max(axis=0)
    assert np.all(size > 0.0)
    np.testing.assert_allclose(exact / size, numeric / size, atol=2e-5)


def test_a_known_cause_is_a_part_of_the_nominal_model_and_no_candidate() -> None:
    problem = problem_of(waved(EVERYTHING))
    assert problem.nominal == ("com_offset", "joint_zero_offset")
    assert problem.causes == ()
    candidates = {name: find(name) for name in ("com_offset", "servo_lag")}
    pool = mjfish.generate("pike", ["v1", "v3"], noise=tuple(SIGMA), duration=4.0)
    known = {"com_offset.shift": ParameterPrior(sd=0.001)}
    found = mjfish.diagnose(replace(pool, known=known), effects=candidates, jobs=1)
    assert "com_offset.shift" in found.nominal
    (candidate,) = [candidate for candidate in found.candidates if candidate.name == "com_offset"]
    assert not candidate.applicable
    assert "part of the nominal model" in candidate.remark


def test_what_is_known_comes_back_from_a_file(tmp_path: Path) -> None:
    dataset = waved(EVERYTHING)
    save(dataset, tmp_path / "pool")
    assert mjfish.load_dataset(tmp_path / "pool").known == EVERYTHING


@pytest.mark.parametrize("name", ["wave.size", "three:wave.frequency", "c_d.fin"])
def test_what_is_known_of_nothing_is_refused(name: str) -> None:
    with pytest.raises(MjfishError, match=f"unknown parameter '{name}'"):
        problem_of(waved({name: ParameterPrior(sd=0.1)}))


def test_a_prior_decides_where_the_data_say_nothing(tmp_path: Path) -> None:
    """Masses and coefficients have one common factor that no motion shows; the prior of the mass has the answer."""
    pool = mjfish.generate("pike", ["v1", "v3"], noise=tuple(SIGMA), duration=5.0)
    mass = pool.fish.links[0].mass
    fish = written(tmp_path, mass=f"{{ value = {mass}, sd = 0.02 }}")
    found = mjfish.identify(replace(pool, fish=fish), starts=1, jobs=1)
    assert found.fit.values["mass.head"] == pytest.approx(mass, abs=0.05)
    assert found.assessment is not None
    low, high = found.assessment.intervals.interval("mass.head")
    assert 0.02 < high - low < 0.12


def test_an_estimate_between_prior_and_data_is_at_the_mode() -> None:
    """One number: the mode is where the sum of both squares is least."""
    free = waved({"wave.scale": ParameterPrior(low=0.5, high=2.0)})
    starts = {p.name: p.start for p in problem_of(free).parameters if p.name != "wave.scale"}
    alone = {**starts, **free.fish.values}
    data = fit(replace(problem_of(free), fixed=alone))
    both = fit(replace(problem_of(waved({"wave.scale": ParameterPrior(mean=1.01, sd=0.001)})), fixed=alone))
    prior, weight = both.parameters[0], 1.0 / float(data.covariance[0, 0])

    def objective(scale: float) -> float:
        return weight * (scale - float(data.x[0])) ** 2 + prior.deviation(scale) ** 2

    mode = minimize_scalar(objective, bounds=(0.9, 1.2), method="bounded", options={"xatol": 1e-8}).x
    assert data.x[0] == pytest.approx(1.0, abs=1e-4)
    assert 1.0005 < both.x[0] < 1.0095
    assert both.x[0] == pytest.approx(mode, abs=2e-4)
    assert both.covariance[0, 0] == pytest.approx(1.0 / (weight + prior.deviation_rate(mode) ** 2), rel=0.1)


def test_a_number_far_from_what_the_data_say_is_a_finding(tmp_path: Path) -> None:
    """The centre of mass is 10 sd away, and the mass is right."""
    pool = mjfish.generate("pike", ["v1", "v3", "v5"], noise=tuple(SIGMA), duration=5.0)
    head = pool.fish.links[0]
    fish = written(
        tmp_path, mass=f"{{ value = {head.mass}, sd = 0.02 }}", com=f"{{ value = {head.com + 0.03}, sd = 0.003 }}"
    )
    problem = problem_of(replace(pool, fish=fish.with_coefficients({p.name: p for p in pool.fish.parameters})))
    found = list(contradicted(problem, fit(problem)))
    assert [finding.place for finding in found] == ["com.head"]
    assert found[0].code == "far-from-known"
    assert "sd away" in found[0].expected
    right = problem_of(replace(pool, fish=written(tmp_path, com=f"{{ value = {head.com}, sd = 0.003 }}")))
    assert list(contradicted(right, fit(right))) == []


def test_a_wave_of_the_wrong_frequency_is_said_and_taken_to_be_that_of_the_beat() -> None:
    """The files say 1 Hz, the fish beats at 2."""
    dataset = waved({})
    slow = replace(dataset, trials=tuple(replace(t, wave=replace(wave_of(t), frequency=1.0)) for t in dataset.trials))
    findings = [finding for finding in mjfish.inspect(slow).findings if finding.code == "wave-frequency"]
    assert [finding.trials for finding in findings] == [("one",), ("two",)]
    assert findings[0].found.startswith(
        (
            "the frequency of the drive is 1 Hz, the fish beats at 1.99",
            "the frequency of the drive is 1 Hz, the fish beats at 2",
        )
    )
    assert [wave_of(trial).frequency for trial in aligned(slow).trials] == pytest.approx([2.0, 2.0], abs=0.02)
    assert not [finding for finding in mjfish.inspect(dataset).findings if finding.code == "wave-frequency"]


def wave_of(trial: Trial) -> Wave:
    """Return the wave of a trial that has one."""
    assert trial.wave is not None
    return trial.wave
