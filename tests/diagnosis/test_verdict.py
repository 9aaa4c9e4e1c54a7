"""The rule that turns numbers into a verdict."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from mjfish.diagnosis.held_out import Confirmation, confirmation
from mjfish.diagnosis.table import Comparison, Row, Table
from mjfish.diagnosis.thresholds import Thresholds
from mjfish.diagnosis.verdict import Decision, decide
from mjfish.estimation.residual import Score

#: How a set stands: its margin, and what it leaves.
Standing = dict[str, Any]
CLEAN, SYSTEMATIC = {"candidates": 0.5, "waves": 0.5}, {"candidates": 1e-5, "waves": 0.5}
GOOD: Standing = {"rival_p": 1.0, "behind": 0.0, "tests": CLEAN, "excess": 0.0}
RIVAL: Standing = {"rival_p": 0.3, "behind": 7.0, "tests": CLEAN, "excess": 0.0}
BEATEN: Standing = {"rival_p": 0.001, "behind": 30.0}
LITTLE: Standing = {"rival_p": 1.0, "behind": 0.0, "tests": SYSTEMATIC, "excess": 2.0}
MISFIT: Standing = {**LITTLE, "excess": 200.0 / 3.0}
LIKE: Standing = {**LITTLE, "excess": 25.0}


def test_a_cause_as_likely_as_the_best_stays_a_rival() -> None:
    """Two causes that the data could have told apart, and that fit equally well: neither is named."""
    tied = _row("a", 100.0, {**GOOD, "rival_p": 0.03, "behind": 0.1})
    assert tied.stays()
    assert not replace(tied, behind=6.0).stays()
    assert replace(tied, rival_p=0.06, behind=6.0).stays()


def test_a_cause_whose_fit_was_stopped_stays_as_if_it_had_gained_what_a_step_more_promises() -> None:
    """It may be as good as the best: nothing is named then, but a cause of the same mechanism."""
    comparison = _compared({"a": GOOD, "b": {**BEATEN, "tests": CLEAN, "excess": 0.0}})
    assert _decided(_with(comparison, "b", promise=20.0)).sets == (("a",),)
    late = _with(comparison, "b", promise=28.0)
    assert (_decided(late).verdict, _decided(late).sets) == ("cannot_tell", (("a",), ("b",)))
    alike = _with(_with(late, "a", mechanisms=("roll",)), "b", mechanisms=("roll",))
    assert _decided(alike).verdict == "named"


def _row(names: str, gain: float, standing: Standing, held_out: Confirmation | None = None) -> Row:
    """Return a row whose last member was added first: sets go by their sorted names, not by this order."""
    return Row(
        names=tuple(names),
        causes={name: f"{name} acts" for name in reversed(names)},
        mechanisms=tuple(sorted(names)),
        learned=False,
        gain=gain,
        degrees_of_freedom=len(names),
        adjusted=gain,
        held_out=held_out,
        **standing,
    )


def _compared(
    standings: dict[str, Standing], held: dict[str, float | None] | None = None, chance: float = 1e-4
) -> Comparison:
    """Return a comparison of sets named by one letter a member; the first gains 100, the next 99."""
    rows = {}
    for k, (names, standing) in enumerate(standings.items()):
        gained = 5.0 if held is None else held.get(names)
        rows[tuple(names)] = _row(names, 100.0 - k, standing, None if gained is None else Confirmation(gained, chance))
    return Comparison(rows)


def _with(comparison: Comparison, names: str, **changed: Any) -> Comparison:
    """Return a comparison with a row changed."""
    return Comparison({**comparison.rows, tuple(names): replace(comparison.rows[tuple(names)], **changed)})


def _decided(single: Comparison, **more: Any) -> Decision:
    return decide(Table(1e-6, single, **more))


def _rule(
    standings: dict[str, Standing],
    held: dict[str, float | None] | None = None,
    p: float = 1e-6,
    several: dict[str, Standing] | None = None,
) -> Decision:
    return decide(Table(p, _compared(standings, held), None if several is None else _compared(several)))


def test_a_verdict_goes_by_its_thresholds_alone() -> None:
    """Catches a number in the rule that no threshold sets."""
    table = Table(0.02, _compared({"a": GOOD, "b": RIVAL, "c": BEATEN}))
    assert decide(table).verdict == "nothing_wrong"
    assert decide(table, Thresholds(alarm=0.03)).sets == (("a",), ("b",))
    assert decide(table, Thresholds(alarm=0.03, keep=0.4)).sets == (("a",),)
    assert decide(table, Thresholds(alarm=0.03, close=40.0)).sets == (("a",), ("b",))
    little = Table(1e-6, _compared({"a": LITTLE}))
    assert decide(little).verdict == "named"
    assert decide(little, Thresholds(remaining=0.01)).verdict == "cannot_tell"
    assert decide(little, Thresholds(remaining=0.01, resembles=0.01)).verdict == "unexplained"
    assert "It leaves" not in decide(little, Thresholds(goodness=1e-6)).message


def test_several_causes_may_leave_a_tenth_at_most_even_where_no_test_sees_it() -> None:
    """Catches two causes that imitate an unknown one, and are claimed because the tests are blunt."""
    pair = replace(_row("a", 90.0, GOOD), names=("a", "b"))
    assert replace(pair, excess=9.0).fits()
    assert not replace(pair, excess=11.0).fits()
    assert _row("a", 90.0, {**GOOD, "excess": 30.0}).fits()


def test_what_a_test_sees_beside_several_causes_is_too_little_for_a_further_one() -> None:
    """Catches two or three that imitate an unknown one, and are claimed because they leave little."""
    for names, excess, fits in (("a", 2.0, True), ("ab", 2.0, False), ("ab", 0.9, True), ("abc", 0.9, False)):
        assert _row(names, 98.0, {**LITTLE, "excess": excess}).fits() is fits
        assert _row(names, 98.0, {**LITTLE, "tests": CLEAN}).fits()


def test_the_remainder_is_a_share_of_what_held_out_runs_gain_too() -> None:
    assert replace(_row("a", 60.0, LITTLE), beyond=38.0).remaining == pytest.approx(0.02)


def test_rivals_that_fail_are_judged_by_the_same_thresholds() -> None:
    worse = Confirmation(5.0, 0.5, 1.07, 2.0)
    comparison = _with(_compared({"a": LITTLE, "b": {**BEATEN, "behind": 1.0}}), "b", held_out=worse)
    assert _decided(comparison).sets == (("a",), ("b",))
    assert decide(Table(1e-6, comparison), Thresholds(remaining=0.06)).sets == (("a",),)


def test_the_interval_of_the_remainder_is_that_of_a_noncentral_chi_squared() -> None:
    """Catches another variance, an end below 0, and a number where nothing was asked."""
    row = replace(_row("a", 100.0, GOOD), excess=50.0, rank=30)
    drawn = stats.ncx2(30, 50.0).rvs(20000, random_state=np.random.default_rng(0)) - 30
    low, high = (drawn.mean() + side * 1.96 * drawn.std() for side in (-1.0, 1.0))
    assert row.remaining_interval == pytest.approx((low / (100.0 + low), high / (100.0 + high)), rel=0.03)
    assert replace(row, excess=0.0).remaining_interval[0] == 0.0
    assert _row("a", 100.0, BEATEN).remaining_interval == (0.0, 1.0)


def test_a_row_says_how_far_its_figures_are_from_every_threshold() -> None:
    assert _row("a", 100.0, LITTLE).distances() == pytest.approx(
        {"keep": 20.0, "close": 0.0, "goodness": 0.002, "left": 0.2 / 1.02, "resembles": 0.06 / 1.02}
    )
    pair = _row("ab", 100.0, LITTLE)  # it may leave a hundredth of what it explains
    assert pair.distances()["left"] == pytest.approx((2.0 / 102.0) / (1.0 / 101.0))
    assert _row("a", 100.0, BEATEN).distances() == pytest.approx({"keep": 0.02, "close": 15.0 / np.log(10.0)})


def test_a_model_that_is_not_contradicted_has_nothing_wrong() -> None:
    assert _rule({"a": GOOD}, p=0.012).verdict == "nothing_wrong"
    assert _rule({"a": GOOD}, p=0.0119).verdict == "named"


def test_one_cause_that_stays_is_named() -> None:
    decision = _rule({"a": GOOD, "b": BEATEN})
    assert (decision.verdict, decision.sets) == ("named", (("a",),))


@pytest.mark.parametrize(("left", "verdict"), [(1e-5, "named"), (0.004, "cannot_tell")])
def test_a_cause_that_leaves_next_to_nothing_is_not_like_one_that_leaves_much_more(left: float, verdict: str) -> None:
    """Of 100, a leaves its share, b and that 2 more: ten times as much as a, or a hundredth, is alike."""
    best = {**LITTLE, "excess": 100.0 * left}
    comparison = _with(_compared({"a": best, "b": BEATEN}), "b", behind=2.0)
    assert _decided(comparison).verdict == verdict


def test_a_cause_that_explains_no_more_than_chance_is_not_named() -> None:
    """An alarm of the whole residual may find nobody behind it: 3.8 is what one parameter gains in 5 % of cases."""
    verdicts = []
    for gain in (3.7, 4.0):
        decision = _decided(Comparison({("a",): _row("a", gain, GOOD)}))
        assert decision.sets == (("a",),)
        assert decision.certain == ((), ("a",))[decision.verdict == "named"]
        assert decision.rivals == ()
        verdicts.append(decision.verdict)
    assert verdicts == ["cannot_tell", "named"]


def test_several_that_stay_are_rivals() -> None:
    decision = _rule({"a": GOOD, "b": RIVAL, "c": BEATEN})
    assert (decision.verdict, decision.sets) == ("cannot_tell", (("a",), ("b",)))


def test_a_best_cause_that_leaves_a_residual_is_no_explanation() -> None:
    assert _rule({"a": MISFIT, "b": BEATEN}).verdict == "unexplained"


def test_the_closest_is_the_best_of_all_trials_not_of_the_fitted_ones_alone() -> None:
    """A learned form that explains more of the fitted trials and mispredicts the held-out ones is not closest."""
    decision = _rule({"a": BEATEN, "b": MISFIT})
    assert (decision.verdict, decision.closest) == ("unexplained", ("b",))
    assert "the closest, b, leaves 40.2\N{NO-BREAK SPACE}% of the misfit" in decision.message
    assert _rule({"a": GOOD}).closest == ()


def test_of_sets_as_close_a_formula_is_the_closest() -> None:
    """A learned form has its formula as a limit, or nearly: a lead of less than a factor of ten says nothing."""
    for behind, closest in ((4.0, ("b",)), (5.0, ("a",))):
        comparison = _compared({"a": MISFIT, "b": {**MISFIT, "behind": behind}})
        assert _decided(_with(comparison, "a", learned=True)).closest == closest


def test_a_rival_that_fits_replaces_a_best_that_does_not() -> None:
    assert _rule({"a": MISFIT, "b": RIVAL}).sets == (("b",),)


@pytest.mark.parametrize(("held", "verdict"), [(-0.1, "unexplained"), (0.1, "named"), (None, "named")])
def test_a_cause_must_not_lose_on_held_out_trials(held: float | None, verdict: str) -> None:
    assert _rule({"a": GOOD}, {"a": held}).verdict == verdict


def test_a_loss_on_held_out_trials_that_noise_explains_is_no_failure() -> None:
    """A weak cause gains nothing there every other time."""
    assert _decided(_compared({"a": GOOD}, {"a": -0.1}, chance=0.2)).verdict == "named"


def test_where_the_best_fails_on_held_out_trials_others_are_compared_and_none_is_named() -> None:
    """The best may owe its lead to noise: what would do without it is told, and told as uncertain."""
    first, others = _compared({"a": GOOD, "b": BEATEN}, {"a": -5.0}), _compared({"b": GOOD})
    decision = _decided(first, others=others)
    assert (decision.verdict, decision.sets) == ("cannot_tell", (("b",), ("a",)))
    assert decision.rivals == (("b", "a"),)
    assert first.joined(others).rows[("b",)] is others.rows[("b",)]
    assert _decided(first, others=_compared({"b": MISFIT})).verdict == "unexplained"


@pytest.mark.parametrize(
    ("gained", "ratio", "said"),
    [
        (
            949.0,
            1.34,
            "is 34.0\N{NO-BREAK SPACE}% larger than without it, although its log-likelihood is 949 h",
        ),
        (
            -50.0,
            1.2,
            "is 20.0\N{NO-BREAK SPACE}% larger than without it, and its log-likelihood is 50.0 lower",
        ),
        (
            -50.0,
            0.9,
            "is 10.0\N{NO-BREAK SPACE}% smaller than without it, although its log-likelihood is 50.0 l",
        ),
    ],
)
def test_a_failure_on_held_out_trials_is_said_by_both_measures(gained: float, ratio: float, said: str) -> None:
    """The table has the log-likelihood, the gain the nRMSE. Catches a sentence that one of them contradicts."""
    comparison = _with(_compared({"a": GOOD}), "a", held_out=Confirmation(gained, 1e-4, ratio))
    assert said in _decided(comparison).message
    assert said in _decided(comparison, others=_compared({"b": GOOD})).message


def test_a_prediction_that_is_hardly_known_makes_a_loss_likelier() -> None:
    """|d|^2 = 16 and a fall of -16 are four sigma of noise; a size known to a quarter doubles the variance."""
    base = np.zeros(16)
    apart = np.ones(16)
    scores = Score((), (), (base,)), Score((), (), (base + apart,))
    sure, unsure = confirmation(*scores), confirmation(*scores, (apart[:, None], apart[:, None]))
    assert sure.gained == unsure.gained == pytest.approx(-8.0)
    assert sure.probability == pytest.approx(stats.norm.cdf(-4.0))
    assert unsure.probability == pytest.approx(stats.norm.cdf(-4.0 / np.sqrt(17.0)))


def test_the_chance_of_a_gain_allows_for_what_the_fit_could_not_tell() -> None:
    """Linear models with one and with five parameters, fitted to few samples, hold out more: a true one seldom fails.

    Catches a chance that takes the extended prediction for known, or its size for all that is not.
    """
    rng = np.random.default_rng(7)
    fitted, held = rng.standard_normal((40, 5)), 1.5 * rng.standard_normal((60, 5))
    truth = np.array([1.0, 0.1, 0.0, 0.05, 0.0])
    doubts = tuple(held[:, :k] @ np.linalg.cholesky(np.linalg.inv(fitted[:, :k].T @ fitted[:, :k])) for k in (1, 5))
    chances, known = [], []
    for _ in range(600):
        here, there = (block @ truth + rng.standard_normal(len(block)) for block in (fitted, held))
        sizes = [np.linalg.lstsq(fitted[:, :k], here, rcond=None)[0] for k in (1, 5)]
        scores = [Score((), (), (there - held[:, : len(size)] @ size,)) for size in sizes]
        chances.append(confirmation(scores[0], scores[1], (doubts[0], doubts[1])).probability)
        known.append(confirmation(scores[0], scores[1]).probability)
    assert np.mean(np.array(chances) < 0.01) < 0.03
    assert np.mean(np.array(known) < 0.01) > 0.1
    assert np.mean(chances) == pytest.approx(0.5, abs=0.12)


@pytest.mark.parametrize(("size", "sign"), [(0.5, 1.0), (0.5, -1.0), (3.0, 1.0)])
def test_the_chance_of_a_gain_is_that_of_the_extended_model(size: float, sign: float) -> None:
    """Drawn from the extended model (sign 1) the chances are uniform; from its mirror image they are none."""
    rng = np.random.default_rng(5)
    apart = size * rng.standard_normal(300) / np.sqrt(300.0) * 5.0
    chances = []
    for _ in range(400):
        noise = rng.standard_normal(300)
        scores = [Score((), (), (noise + sign * apart - base,)) for base in (0.0 * apart, apart)]
        chances.append(confirmation(scores[0], scores[1]).probability)
    mean = float(np.mean(chances))
    assert (abs(mean - 0.5) < 0.05) if sign > 0.0 else mean < 0.05


def test_several_causes_are_named_only_where_no_single_one_leaves_nothing() -> None:
    """Catches a rule that prefers the larger set because it always explains more."""
    assert _rule({"a": GOOD}, several={"ab": GOOD}).sets == (("a",),)
    assert _rule({"a": MISFIT}, several={"ab": GOOD}).sets == (("a", "b"),)
    assert _rule({"a": LITTLE}, several={"ab": GOOD}).sets == (("a", "b"),)


def test_a_single_cause_that_leaves_little_is_named_where_no_set_does_better() -> None:
    assert _rule({"a": LITTLE}).sets == (("a",),)
    assert _rule({"a": LITTLE}, several={"ab": MISFIT}).sets == (("a",),)
    assert _rule({"a": MISFIT}, several={"ab": MISFIT}).verdict == "unexplained"


def test_a_small_lack_of_fit_is_accepted_with_rivals_too() -> None:
    """The best, 100, leaves 2; who is 1 behind leaves 3 % of 102, who is 20 behind leaves a fifth."""
    near, far = {**BEATEN, "behind": 1.0}, {**BEATEN, "behind": 20.0}
    comparison = _compared({"a": LITTLE, "b": near, "c": far})
    decision = _decided(comparison)
    assert (decision.verdict, decision.sets) == ("cannot_tell", (("a",), ("b",)))
    assert _decided(_with(comparison, "a", **GOOD)).sets == (("a",),)
    assert _decided(_with(comparison, "b", held_out=Confirmation(-5.0, 1e-4))).sets == (("a",),)


def test_what_a_named_cause_leaves_is_said() -> None:
    assert "It leaves 1.96\N{NO-BREAK SPACE}% of the misfit" in _rule({"a": LITTLE}).message
    assert "leaves" not in _rule({"a": GOOD}).message


def test_what_explains_most_in_another_form_is_told_and_not_named() -> None:
    near = {**BEATEN, "behind": 10.0}
    comparison = _compared({"a": LIKE, "b": near})
    far = _with(comparison, "b", behind=30.0)
    decision = _decided(far)
    assert (decision.verdict, decision.sets, decision.certain) == ("cannot_tell", (("a",),), ())
    assert "a explains 80.0\N{NO-BREAK SPACE}% of it and leaves something systematic" in decision.message
    rivals = _decided(comparison)
    assert rivals.sets == (("a",), ("b",))
    assert "cannot tell what: a explains" in rivals.message
    assert "; also possible: b." in rivals.message
    assert "also possible" not in decision.message
    many = _compared({"a": LIKE, "b": near, "c": near, "d": near})
    assert _decided(many).verdict == "unexplained"
    forms = _with(_with(many, "c", mechanisms=("x",)), "d", mechanisms=("x",))
    assert _decided(forms).verdict == "cannot_tell"
    assert _decided(_with(far, "a", held_out=Confirmation(-5.0, 1e-4))).verdict == "unexplained"


def test_sets_that_cannot_be_told_apart_are_all_listed() -> None:
    decision = _rule({"a": MISFIT}, several={"ab": GOOD, "ac": RIVAL})
    assert (decision.verdict, decision.sets) == ("cannot_tell", (("a", "b"), ("a", "c")))
    assert decision.certain == ("a",)
    assert decision.rivals == (("b", "c"),)
    assert decision.message == "a is at work; these data cannot tell whether the other cause is b or c."
    both = _rule({"a": MISFIT}, several={"abc": GOOD, "abd": RIVAL})
    assert both.message == "a and b are at work; these data cannot tell whether the other cause is c or d."
    apart = _rule({"a": MISFIT}, several={"ab": GOOD, "cd": RIVAL})
    assert apart.certain == ()
    assert "a with b or c with d" in apart.message


@pytest.mark.parametrize(("learned", "excess", "little"), [(True, 2.9, True), (True, 3.1, False), (False, 2.9, False)])
def test_a_learned_form_that_leaves_little_needs_no_larger_set(learned: bool, excess: float, little: bool) -> None:
    """The refit gains 100: three per cent of it a learned form may leave, one per cent a formula."""
    comparison = _compared({"a": {**LITTLE, "excess": excess}})
    assert _with(comparison, "a", learned=learned).exhausted() is little


def test_forms_of_one_mechanism_are_no_rivals() -> None:
    """Two formulas fit, and both are of one mechanism: it is named, the first of them shown."""
    comparison = _compared({"a": GOOD, "b": RIVAL})
    for name in "ab":
        comparison = _with(comparison, name, mechanisms=("drag_law",))
    decision = _decided(comparison)
    assert (decision.verdict, decision.sets) == ("named", (("a",), ("b",)))
    assert "The mechanism is drag_law" in decision.message
