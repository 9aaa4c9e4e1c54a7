"""Cases of the sealed generator: strengths as asked for, truths as sealed, datasets as the solver wants them."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from mjfish.data import Trial, load_dataset
from mjfish.effects import find
from mjfish.errors import InputError
from mjfish.model import Model
from studies.battery.generator import case as cases
from studies.battery.generator import draft, forcing, noise, size
from studies.battery.generator.case import make_case, scaled_case
from studies.battery.generator.classes import CAUSES
from studies.battery.generator.truth import Truth
from studies.battery.generator.world import FINE

#: Noise of a film, 1 mm and 0.3 deg, and of the joint angles, 0.3 deg.
FILMED = noise.Noise("poses", (0.001, 0.001, 0.005), rate=50.0, angle=0.005)


@pytest.mark.parametrize(
    ("cause", "kind"),
    [
        pytest.param("servo_saturation", "white", marks=pytest.mark.slow),
        ("fin_lift", "drift"),
        pytest.param("tether", "white", marks=pytest.mark.slow),
    ],
)
def test_a_case_has_the_strength_asked_for(cause: str, kind: noise.Kind) -> None:
    """A size that is found in other units than those of the noise; measured here over runs of full accuracy."""
    case = scaled_case(11, cause, 150.0, kind)
    assert case.truth.reached[cause]
    made = case.draft
    measure = size.ruler(made, [i for i, run in enumerate(made.plan.runs) if not run.held_out])
    plain = [made.clean(i, {}, FINE) for i in measure.numbers]
    clean = [case.clean[i] for i in measure.numbers]
    whole = [noise.whiten(made.noise, a - b).ravel() for a, b in zip(clean, plain, strict=True)]
    assert np.sum(measure.beyond(np.concatenate(whole)) ** 2) == pytest.approx(150.0, rel=0.15)


def test_strength_from_poses_counts_neither_where_a_run_started_nor_what_joints_hide() -> None:
    """A path that is moved and turned says nothing; joints that are known say more than measured ones."""
    measured = replace(draft.draft(11, noise_kind="poses"), noise=replace(FILMED, joints="measured"))
    known = replace(measured, noise=replace(FILMED, joints="cpg"))
    of_both = [size.ruler(made, (0, 1)) for made in (measured, known)]
    ends = np.cumsum([0, *(3 * len(measured.time(i)) for i in (0, 1))])
    path = measured.clean(1, {})
    moved = np.zeros(ends[2])
    turned = np.column_stack([0.1 - 0.01 * path[:, 1], 0.01 * path[:, 0], np.full(len(path), 0.01)])
    moved[ends[1] :] = noise.whiten(FILMED, turned).ravel()
    assert moved @ moved > 1e4
    assert of_both[1].beyond(moved) == pytest.approx(np.zeros(ends[2]), abs=1e-6)
    less, more = (measure.strength({"munk_moment.kappa": 0.05}) for measure in of_both)
    assert 0.0 < less < 0.9 * more


def test_strength_is_that_of_the_solvers_own_sensitivities() -> None:
    """A strength that only the generator believes in: the same number from the solver's Jacobian."""
    case = scaled_case(12, "munk_moment", 100.0, "white", stated=True)
    fitted = tuple(trial for trial in case.dataset.trials if trial.role == "fit")
    model = Model(case.dataset.fish, (find("munk_moment"),))
    given = {**model.values(), **case.truth.theta}
    sigma = np.array(case.truth.noise["sigma"])
    names = list(case.truth.theta)
    jacobian = np.column_stack([_change(model, fitted, sigma, given, {name: given[name] * 1.02}) for name in names])
    basis, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    signature = _change(model, fitted, sigma, given, dict(case.truth.psi))
    left = signature - basis @ (basis.T @ signature)
    assert left @ left == pytest.approx(case.truth.strength["munk_moment"], rel=0.1)


def _change(
    model: Model, trials: tuple[Trial, ...], sigma: np.ndarray, given: dict[str, float], new: dict[str, float]
) -> np.ndarray:
    def stacked(values: dict[str, float]) -> np.ndarray:
        parts = [model.predict(trial, values).velocity for trial in trials]
        return np.concatenate([(part / sigma).ravel() for part in parts])

    return stacked({**given, **new}) - stacked(given)


def test_two_causes_have_their_strengths_beyond_each_other() -> None:
    """Strengths of each alone: partners that alias would both be invisible."""
    case = scaled_case(13, ["time_offset", "servo_saturation"], [200.0, 100.0], "white")
    assert case.truth.kind == "two"
    assert case.truth.strength == pytest.approx({"time_offset": 200.0, "servo_saturation": 100.0}, rel=0.1)
    measure = size.ruler(case.draft, [i for i, run in enumerate(case.draft.plan.runs) if not run.held_out])
    alone = measure.strength({"time_offset.offset": case.truth.psi["time_offset.offset"]})
    assert alone > case.truth.strength["time_offset"]


@pytest.mark.slow
def test_a_structurally_unidentifiable_cause_cannot_be_made_strong() -> None:
    """A mass error that seems strong because the refit was linear."""
    case = scaled_case(14, "mass_error", 100.0, "white", runs=5)
    made = case.draft
    measure = size.ruler(made, [0, 1])
    assert measure.strength({"mass_error.error": 0.1}) < 1e-3


@pytest.mark.parametrize("kind", ["none", "one", "two", "off_list", "decoy"])
def test_every_kind_gives_a_case_with_its_truth(kind: cases.Kind) -> None:
    """A class that cannot be drawn."""
    case = make_case(3, kind, strength=100.0)
    truth = case.truth
    assert truth.kind == kind
    assert len(truth.causes) == {"none": 0, "two": 2}.get(kind, 1)
    assert (kind == "none") == (not truth.causes)
    assert all(CAUSES[name].listed for name in truth.causes) or kind in ("off_list", "decoy")
    fitted, held = case.dataset.split()
    assert tuple(t.name for t in fitted) == truth.runs[0]
    assert tuple(t.name for t in held) == truth.runs[1]
    assert len(held) in (2, 3)
    assert truth.n == sum(t.velocity.size for t in fitted)


@pytest.mark.parametrize("kind", noise.KINDS)
def test_a_case_is_written_and_read_back(kind: noise.Kind, tmp_path: Path) -> None:
    """A trial that the solver's reader refuses: gaps, poses, times."""
    case = make_case(4, "none", noise_kind=kind)
    back = load_dataset(case.write(tmp_path / "case"))
    for ours, theirs in zip(case.dataset.trials, back.trials, strict=True):
        assert np.array_equal(ours.velocity, theirs.velocity)
        assert ours.drive == theirs.drive
        assert ours.gaps == theirs.gaps
    assert (back.noise is None) == (not case.truth.stated)


def test_the_same_seed_gives_the_same_case_and_splits_never_meet() -> None:
    """A test seed that was tuned on under another name."""
    first, again = (make_case(5, "none") for _ in range(2))
    assert np.array_equal(first.dataset.trials[0].velocity, again.dataset.trials[0].velocity)
    others = [make_case(5, "none", split=split).truth.theta for split in ("calibration", "test")]
    assert first.truth.theta not in others
    assert others[0] != others[1]
    with pytest.raises(InputError, match="999999"):
        draft.draft(1_000_000)


def test_the_seal_of_a_truth_is_that_of_all_of_it() -> None:
    """A truth that was changed after the diagnosis."""
    truth = scaled_case(6, "time_offset", 50.0).truth
    back = Truth.of(json.loads(json.dumps(asdict(truth))))
    assert back == truth
    assert back.seal == truth.seal
    assert replace(truth, kind="none").seal != truth.seal


def test_force_noise_moves_the_fish_by_its_level() -> None:
    """Force noise whose size is a force, and so another thing at every frequency."""
    for kind in ("forces", "drift"):
        made = draft.draft(7, noise_kind="white", level=1.0)
        pushes, told = forcing.draw(made, kind, 1.5)
        moved = [
            (made.clean(i, {}, disturbance=push) - made.clean(i, {})) / np.array(made.noise.sigma)
            for i, push in enumerate(pushes)
        ]
        assert np.sqrt(np.mean(np.concatenate(moved) ** 2)) == pytest.approx(1.5, rel=0.15)
        assert told["kind"] == kind


def test_a_decoy_at_its_bound_has_a_coefficient_there() -> None:
    """A decoy without its trap."""
    case = make_case(8, "decoy", cause="coefficient_at_bound")
    bounds = {p.name: (p.low, p.high) for p in case.dataset.fish.parameters}
    assert any(value in bounds[name] for name, value in case.truth.theta.items())


@pytest.mark.slow
def test_rivals_know_that_a_clock_looks_like_a_lag() -> None:
    """Correlations taken before the refit, or with the cause itself."""
    case = scaled_case(9, "time_offset", 100.0, "white", rivals=True, pose=True)
    rho = case.truth.rho["time_offset"]
    assert "time_offset" not in rho
    assert all(0.0 <= value <= 1.0 + 1e-9 for value in rho.values())
    assert max(rho["servo_lag"], rho["servo_backlash"]) > rho["ambient_current"]
    assert case.truth.rho_max["time_offset"] == max(rho.values())


@pytest.mark.parametrize(("how", "share"), [("cpg", 1e-4), ("commanded", 0.01), ("measured", 0.01)])
def test_a_film_shows_what_the_solver_predicts_of_the_truth(
    how: noise.Joints, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Places and headings of another sign, clock or frame than the solver's, or joints that it reads otherwise.

    Where the drive changes, velocities jump: integrated across it, a heading was off by 0.002 rad. What recorded joints
    did between two samples there is not known.
    """
    filmed = noise.Noise("poses", (1e-5, 1e-5, 1e-5), rate=100.0, joints=how)
    monkeypatch.setattr(noise, "draw", lambda *_: filmed)
    case = scaled_case(21, (), (), "poses", runs=3)
    drives = [run.drive for run in draft.draft(21, noise_kind="poses", runs=3).plan.runs]
    number = (max if how == "cpg" else min)(range(3), key=lambda k: len(drives[k]))
    assert (len(drives[number]) > 1) == (how == "cpg")
    model, trial = Model(case.dataset.fish), case.dataset.trials[number]
    assert not trial.measured.any()
    assert (trial.joint_angle is None) == (how == "cpg")
    assert trial.commanded == (how == "commanded")
    position, heading = trial.sensors
    start = np.array([*position.values[0], heading.values[0, 0]])
    predicted = model.predict(trial, {**model.values(), **case.truth.theta}, pose=start)
    for sensor, read in zip(trial.sensors, predicted.sensors, strict=True):
        left = sensor.values - read
        assert np.sqrt(np.mean(left**2)) < share * np.ptp(sensor.values)


@pytest.mark.parametrize("psi", [{"servo_lag.time_constant": 0.02}, {"fading_battery.rate": 1e-3}])
def test_a_cause_of_the_servos_is_never_hidden_behind_measured_joints(psi: dict[str, float]) -> None:
    """Measured angles are what the servos did: nothing would be wrong."""
    drafts = [draft.draft(seed, noise_kind="poses") for seed in range(12)]
    assert {made.noise.joints for made in drafts} == {"cpg", "commanded", "measured"}
    assert {cases.with_seen_joints(made, psi).noise.joints for made in drafts} == {"cpg", "commanded"}
    unmoved = {cases.with_seen_joints(made, {"inertia_error.error": 0.1}).noise.joints for made in drafts}
    assert unmoved == {"cpg", "commanded", "measured"}
