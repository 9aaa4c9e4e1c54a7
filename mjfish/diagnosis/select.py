"""Which causes: the confidence set by test inversion, and the goodness of fit of its members.

A set l of causes stays as long as, were l the truth, the best rival would beat it by the observed margin more often
than in 5 % of cases; or as long as the likelihood of the best is less than ten times its own: where two causes that can
be told apart are as likely as each other, the data are odd under both, and name neither. With whitened predictions
eta_k at the refits and d_k = eta_k - eta_l,

    LR_k - LR_l = 2 d_k' eps - |d_k|^2,    eps ~ N(0, 1),    were l true,

jointly over all rivals k ([Cox1961] for separate families, here with the fitted curves themselves, so that causes which
are not linear in their amplitudes, or not smooth, need no linearisation). Held-out trials take part with the likelihood
that they have, given the fitted ones (docs/notes/018): often they were swum otherwise, and rivals differ most there.

[Cox1961] D. R. Cox, Tests of separate families of hypotheses, Proc. 4th Berkeley Symposium.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.data import Trial
from mjfish.diagnosis.by_run import Drawn
from mjfish.diagnosis.constancy import linearised
from mjfish.diagnosis.evidence import gather, tail
from mjfish.diagnosis.failures import blamed, finite
from mjfish.diagnosis.held_out import Confirmation, HeldOut
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.sign_flips import flipped_p
from mjfish.effects.effect import Effect
from mjfish.effects.mechanism import without_form

Key = TypeVar("Key", bound=Hashable)
Names = tuple[str, ...]
#: A cause is kept in the confidence set above this p value.
KEEP = 0.05
#: Or within this fall of the sum of squares, 2 ln 10, of the best.
CLOSE = 2.0 * float(np.log(10.0))
#: A cause that fits worse than this in any of six tests is no explanation. A true one is lost by chance in six of ten
#: thousand cases at most; more often because its form differs a little from the catalogue's, which should not make it a
#: riddle.
GOODNESS = 1e-4
#: What is left may be this share of all there was to explain: a cause's form is a model, too.
LEFT = 0.1
#: This share where all mechanisms are numbers without a form: there is no other one that could leave it.
_EXACT = 0.03
#: The tests of common and of weighed waves, of sizes and of coefficients by run see the slightest error of form. Below
#: this share of the gain, what they see does not count.
_SLIGHT = 0.01
#: And up to this share, it is like the truth, if nothing else is.
RESEMBLES = 1.0 / 3.0
#: A set must explain this share more than every smaller one; the second where one of both has a learned form: its basis
#: has its limits, and it may mend much.
SHARE, LEARNED_SHARE = 0.01, 0.03
DRAWS = 4000
#: Rows of residuals that are compared at a time.
_ROWS = 2**16


@dataclass(frozen=True)
class Standing:
    """How a refit stands against the others.

    Attributes:
        rival_p: p value of the margin by which the best rival beats it.
        behind: that margin, a fall of the sum of squares over all trials, adjusted for parameters.
        saturated_p: of the joint score of all other candidates at its refit; where it is small, the larger of those for
            Gaussian noise and for noise with outliers.
        omnibus_p: the same, of the omnibus basis.
        excess: what is left at its refit beyond chance, of the sum of squares.
        left: the same as a share of all there was to explain.
        common_p: of the few waves of the omnibus basis that are the same in all runs.
        constancy_p: of the sizes of the causes being the same in all runs.
        weighed_p: of the omnibus basis, each wave weighed by how well it is seen.
        steady_p: of the coefficients being the same in all runs.
        tolerance: share that may be left.
    """

    rival_p: float
    behind: float
    saturated_p: float = 0.0
    omnibus_p: float = 0.0
    excess: float = np.inf
    left: float = 1.0
    common_p: float = 1.0
    constancy_p: float = 1.0
    weighed_p: float = 1.0
    steady_p: float = 1.0
    tolerance: float = LEFT

    @property
    def in_set(self) -> bool:
        """Whether the data cannot tell it from the best."""
        return self.rival_p >= KEEP or self.behind < CLOSE

    @property
    def fit_p(self) -> float:
        """The least p value of the tests of what it leaves."""
        of_all = min(self.saturated_p, self.omnibus_p, self.common_p, self.weighed_p)
        return min(of_all, self.constancy_p, self.steady_p)

    @property
    def clean(self) -> bool:
        """Whether nothing systematic is left once it is in the model."""
        return self.fit_p >= GOODNESS

    @property
    def fits(self) -> bool:
        """Whether nothing systematic is left that matters."""
        return self.clean or self.left < self.tolerance

    @property
    def resembles(self) -> bool:
        """Whether it explains the most of what there was to explain."""
        return self.left < RESEMBLES


def _rivalry(refits: Mapping[Key, Refit], held_out: HeldOut, rng: np.random.Generator) -> dict[Key, Standing]:
    """Return, per refit, the margin by which the best rival beats it and its p value; goodness of fit is not tested."""
    names, beyond = list(refits), held_out.of_rivals(refits)
    residuals = np.empty((len(names), refits[names[0]].fit.count + len(beyond[names[0]])))
    for row, name in zip(residuals, names, strict=True):
        row[:] = np.concatenate([refits[name].fit.residual, beyond[name]])
    gains = np.array([refits[name].adjusted - float(beyond[name] @ beyond[name]) for name in names])
    result = {}
    for index, name in enumerate(names):
        inner = sum(_inner(residuals[:, at : at + _ROWS], index) for at in range(0, residuals.shape[1], _ROWS))
        values, vectors = np.linalg.eigh(inner)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        margin = 2.0 * rng.standard_normal((DRAWS, len(names))) @ root.T - np.diag(inner)
        observed = gains.max() - gains[index]
        finite("the comparison of the candidates", float(observed), *margin.sum(axis=0))
        p_value = float((1 + np.count_nonzero(margin.max(axis=1) >= observed - 1e-9)) / (1 + DRAWS))
        result[name] = Standing(p_value, float(observed))
    return result


def _inner(residuals: FloatArray, index: int) -> FloatArray:
    """Return the inner products of eta_k - eta_l over some rows, of all k and one l."""
    apart = residuals[index] - residuals
    return np.asarray(apart @ apart.T)


def tolerated(mechanisms: Sequence[str]) -> float:
    """Return the share that causes of these mechanisms may leave, systematic as it is."""
    return _EXACT if all(without_form(name) for name in mechanisms) else LEFT


def sharp_p(test: tuple[float, int], gain: float) -> float:
    """Return the p value of a sharp test, a statistic with its rank; 1 where it is slight beside the gain."""
    statistic, rank = test
    return 1.0 if statistic - rank < _SLIGHT * gain else tail(statistic, rank)


def _drawn(test: Drawn, cleared: FloatArray, gain: float) -> tuple[float, float]:
    """Return what a test of random sizes sees beyond chance, and its p value.

    This is 1 where it is slight beside the gain, that of flips if larger.
    """
    if test.beyond < _SLIGHT * gain:
        return test.beyond, 1.0
    return test.beyond, test.p if test.p >= GOODNESS else max(test.p, test.flipped_p(cleared))


class Goodness:
    """The goodness of fit of refits, each computed once.

    Args:
        candidates: causes whose joint score at a refit says whether it leaves anything.
        held_out: trials in which causes should have the size that they have in the others.
    """

    def __init__(self, candidates: Sequence[Effect], held_out: tuple[Trial, ...] = ()) -> None:
        self.candidates, self.held_out = tuple(candidates), held_out
        self.known: dict[Refit, dict[str, float]] = {}

    def left(self, refit: Refit) -> float:
        """Return what is left at a refit beyond chance, as a share of all there was to explain."""
        return self._measured(refit)["left"]

    def of(self, refit: Refit, standing: Standing) -> Standing:
        """Return the standing of a refit with its goodness of fit."""
        return replace(standing, **self._measured(refit))

    def _measured(self, refit: Refit) -> dict[str, float]:
        if refit not in self.known:
            with blamed(refit.names[-1]):
                self.known[refit] = self._tested(refit)
                if np.isnan([*self.known[refit].values()]).any():
                    raise FloatingPointError("a test of what it leaves is no number")
        return self.known[refit]

    def _tested(self, refit: Refit) -> dict[str, float]:
        sizes, (steady, steady_p) = self._by_run(refit)
        after = gather(refit.problem, refit.fit, self.candidates)
        common, (weighed, weighed_p) = after.common(), _drawn(after.weighed(), after.cleared, refit.gain)
        beyond = [steady, weighed, *(statistic - rank for statistic, rank in (common, sizes))]
        excess = max(after.saturated_excess(), after.omnibus_excess(), *beyond, 0.0)
        saturated_p, omnibus_p = after.saturated_p(), after.omnibus_p()
        if saturated_p < GOODNESS:  # outliers of the noise may be what is left
            saturated_p = max(saturated_p, flipped_p(after.signatures, after.cleared))
        if omnibus_p < GOODNESS:
            omnibus_p = max(omnibus_p, after.waves.flipped_p(after.cleared))
        return {
            "saturated_p": saturated_p,
            "omnibus_p": omnibus_p,
            "excess": excess,
            "left": excess / max(refit.gain + excess, 1e-9),
            "common_p": sharp_p(common, refit.gain),
            "constancy_p": sharp_p(sizes, refit.gain),
            "weighed_p": weighed_p,
            "steady_p": steady_p,
            "tolerance": tolerated(refit.mechanisms),
        }

    def _by_run(self, refit: Refit) -> tuple[tuple[float, int], tuple[float, float]]:
        """Return the test of the sizes by run; what that of the coefficients sees beyond chance, and its p value."""
        every = linearised(refit, self.held_out)
        steady = every.coefficients().drawn(every.cleared, refit.problem.noise.doubt)
        return every.sizes(), _drawn(steady, every.cleared, refit.gain)


def standings(
    refits: Mapping[Key, Refit], goodness: Goodness, held_out: HeldOut, rng: np.random.Generator
) -> dict[Key, Standing]:
    """Return the standing of every refit; the goodness of fit only of those in the confidence set."""
    return {
        name: goodness.of(refits[name], standing) if standing.in_set else standing
        for name, standing in _rivalry(refits, held_out, rng).items()
    }


def share_of(refit: Refit) -> float:
    """Return the share of its gain by which a refit and a set of another size must differ."""
    return LEARNED_SHARE if refit.learned else SHARE


def leaves_little(refit: Refit, standing: Standing) -> bool:
    """Return whether a refit leaves less than what a larger set would have to explain beyond it."""
    return standing.excess < share_of(refit) * refit.gain


@dataclass(frozen=True, eq=False)
class Comparison:
    """Combinations of causes of one size, and what speaks for them.

    Attributes:
        refits: of the sets.
        standings: of the sets.
        held_out: what sets in the confidence set gain on held-out trials, against the best refit with one member less,
            single causes against the nominal model; None where there are no such trials.
    """

    refits: Mapping[Names, Refit]
    standings: Mapping[Names, Standing]
    held_out: Mapping[Names, Confirmation | None] = field(default_factory=dict)

    def fails(self, names: Names) -> bool:
        """Return whether a set is known to fail on the held-out trials."""
        return (confirmation := self.held_out.get(names)) is not None and confirmation.failed

    def retained(self, *, clean: bool) -> tuple[Names, ...]:
        """Return the sets in the confidence set that fit and do not fail on held-out trials, best first."""
        kept = [
            names
            for names, standing in self.standings.items()
            if standing.in_set and (standing.clean if clean else standing.fits) and not self.fails(names)
        ]
        return tuple(sorted(kept, key=lambda names: (self.refits[names].learned, self.standings[names].behind)))

    def closest(self) -> Names:
        """Return the set that explains most of all trials, also of the held-out ones; none where there is none."""
        return min(self.standings, key=lambda names: self.standings[names].behind, default=())

    def exhausted(self) -> bool:
        """Return whether a set that stays leaves so little that no larger one can earn its members beside it."""
        return any(leaves_little(self.refits[names], self.standings[names]) for names in self.retained(clean=False))

    def one_mechanism(self, sets: Sequence[Names]) -> bool:
        """Return whether all sets are forms of the same mechanisms."""
        return len({self.refits[names].mechanisms for names in sets}) == 1

    def similar(self, names: Names, share: float) -> tuple[Names, ...]:
        """Return a set that leaves a misfit, followed by the rivals that leave at most this share of all.

        The misfit shows that the form of the set is not that of the truth. Rivals are granted the same tolerance.
        """
        refit, excess = self.refits[names], self.standings[names].excess
        most = share * (refit.gain + excess) - excess
        others = (n for n in self.refits if n != names and not self.fails(n))
        near = [n for n in others if refit.adjusted - self.refits[n].adjusted < most]
        return (names, *sorted(near, key=lambda n: -self.refits[n].adjusted))

    def joined(self, others: Comparison | None) -> Comparison:
        """Return this comparison with the standings of others for the sets that are in their confidence set."""
        if others is None:
            return self
        retained = {names: standing for names, standing in others.standings.items() if standing.in_set}
        return Comparison(self.refits, {**self.standings, **retained}, {**self.held_out, **others.held_out})

    def falsified(self) -> bool:
        """Return whether every set in the confidence set fails on the held-out trials."""
        return all(self.fails(n) for n, standing in self.standings.items() if standing.in_set)

    def failed(self) -> tuple[Names, ...]:
        """Return the sets in the confidence set that leave nothing, yet fail on the held-out trials."""
        return tuple(
            n for n, standing in self.standings.items() if standing.in_set and standing.clean and self.fails(n)
        )
