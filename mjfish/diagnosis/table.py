"""The table of evidence: a row for every set of causes that was fitted.

A verdict (`mjfish.diagnosis.verdict.decide`) is read from these numbers alone.

It has the estimates of fitted models with their intervals, and what was known of them beforehand.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mjfish.diagnosis.evidence import p_value_of
from mjfish.diagnosis.held_out import Confirmation
from mjfish.diagnosis.refit_result import Refit
from mjfish.diagnosis.thresholds import LARGEST, THRESHOLDS, Thresholds
from mjfish.effects.mechanism import without_form
from mjfish.estimation import Fit
from mjfish.estimation.fit import Z95
from mjfish.files.plain_data import fields_of, plain, restored
from mjfish.model import Model
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.formats import fixed, number, unit
from mjfish.parameters import Parameter


@dataclass(frozen=True)
class Estimate:
    """An estimate with its 95 % interval.

    Attributes:
        estimate, low, high: it, and the ends of the interval.
        unit: of all.
        at_bound: whether it rests on a bound.
        known: what was known of it beforehand; None: its bounds alone.
        settled: whether the data say anything of it: its interval does not reach from bound to bound.
    """

    estimate: float
    low: float
    high: float
    unit: str
    at_bound: bool = False
    known: PriorDeviation | None = None
    settled: bool = True

    @property
    def rounded(self) -> str:
        """The estimate to the places its interval deserves (two digits of its half width); a bound as it is."""
        return f"{self.estimate:g}" if self.at_bound else self._rounded(self.estimate)

    @property
    def interval(self) -> str:
        """The interval to the same places; that there is none where the data say nothing; empty without a width."""
        if not self.settled:
            return "these runs do not settle it"
        return f"{self._rounded(self.low)} to {self._rounded(self.high)}" if self.high > self.low else ""

    def _rounded(self, value: float) -> str:
        half = 0.5 * (self.high - self.low)
        if not (math.isfinite(half) and half > 0.0) or not 1e-4 <= max(abs(self.low), abs(self.high)) < 1e6:
            return number(value)
        return fixed(value, min(1 - math.floor(math.log10(half)), 9))

    @property
    def told(self) -> str:
        """The estimate with its unit and its interval, or that it rests on a bound without one."""
        return f"{self.rounded} {unit(self.unit)}".rstrip() + f" ({self.interval or 'on its bound'})"


@dataclass(frozen=True)
class PriorDeviation:
    """What was known of a number: its mean and sd, and how many sds the estimate is away (`Parameter.deviation`)."""

    mean: float
    sd: float
    deviation: float


def linearised(
    found: Fit, parameters: Iterable[Parameter], at: Callable[[Mapping[str, float]], FloatArray]
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """Return a function y (n,) of fitted numbers, half the width of its 95 % band (n,), and its derivatives by name.

    The band is that of the linearised fit, 1.96 sqrt(g' C g) with the derivatives g of y by the parameters.

    Args:
        found: the fit.
        parameters: on which y depends; those that were not fitted have no error.
        at: returns y at values by name.
    """
    index, values = {p.name: i for i, p in enumerate(found.parameters)}, found.values
    y, slopes = at(values), {}
    for p in (p for p in parameters if p.name in index):
        h = 1e-3 * p.scale
        ahead, behind = (at({**values, p.name: values[p.name] + step}) for step in (h, -h))
        slopes[p.name] = (ahead - behind) / (2.0 * h)
    rows, along = [index[name] for name in slopes], np.array([*slopes.values()]).reshape(len(slopes), len(y))
    variance = np.einsum("ji,jk,ki->i", along, found.covariance[np.ix_(rows, rows)], along)
    return y, Z95 * np.sqrt(np.maximum(variance, 0.0)), slopes


def estimates(found: Fit, model: Model) -> dict[str, Estimate]:
    """Return the model's estimates by name, without parameters of single trials.

    A refit keeps an amplitude that cannot be negative slightly above zero; an interval that reaches this bound reaches
    zero. A shape parameter to which these data are insensitive has its default.
    """
    result = {}
    declared = {p.name: p for p in model.parameters}
    for p, at_bound, length in zip(found.parameters, found.at_bound, found.lengths, strict=True):
        if ":" not in p.name:
            low, high = found.interval(p.name, Z95)
            settled = low > p.low or high < p.high
            low = declared.get(p.name, p).low if low <= p.low else low
            value = p.default if p.shape and length == 0.0 else found.values[p.name]
            known = None if p.sd is None else PriorDeviation(p.expected, p.sd, float(p.deviation(value)))
            result[p.name] = Estimate(value, low, high, p.unit, bool(at_bound), known, settled)
    return result


Names = tuple[str, ...]


#: A set must explain this share more than every smaller one; the second where one of both has a learned form: its basis
#: has its limits, and it may mend much.
_SHARE, _LEARNED_SHARE = 0.01, 0.03


def share_of(one: Refit | Row) -> float:
    """Return the share of its gain by which a set and one of another size must differ."""
    return _LEARNED_SHARE if one.learned else _SHARE


@dataclass(frozen=True)
class Row:
    """What speaks for one set of causes, fitted together with the coefficients.

    Attributes:
        names: of the causes, sorted.
        causes: what they are, by name, in the order in which they were added.
        mechanisms: of the causes, sorted.
        learned: whether the form of one is learned.
        gain: evidence: the fall of the sum of squares against the nominal model.
        degrees_of_freedom: parameters that the causes add.
        adjusted: the gain, adjusted for them (`Refit.adjusted`).
        behind: how far the sum of squares of all trials, so adjusted, is above that of the best set of its size.
        rival_p: p value of that margin, were this set the truth.
        tests: p values of what it leaves, by test: of all other candidates, of waves, of waves that all runs share, of
            sizes by run, of causes that no score sees. Empty where it was not asked: only of sets that the data cannot
            tell from the best.
        excess: remainder: what is left beyond chance, of the sum of squares of all trials, held-out ones too.
        rank: degrees of freedom of the test that sees so much.
        beyond: by how much the gain is larger once held-out trials count.
        held_out: what it does on the held-out trials, against the best set with one member less, a single cause against
            the nominal model; None where it was not asked, or nothing is held out.
        status: how its fit ended.
        promise: what a step more may gain where the fit was stopped; the set stays as if it had gained that.
        error, held_out_error: nRMSE over all channels of the fitted and of the held-out trials with these causes in the
            model; None where nothing is held out.
        sizes: estimates of the causes' parameters by full name.
        delays: of the joints behind their command by beat frequency, where servo dynamics are among the causes.
        chosen: selection frequency. Each fitted run is left out in turn, and nothing is refitted: the share of these
            cases in which the set is the best of its size. None where one run alone was fitted.
    """

    names: Names
    causes: Mapping[str, str]
    mechanisms: Names
    learned: bool
    gain: float
    degrees_of_freedom: float
    adjusted: float
    behind: float
    rival_p: float
    tests: Mapping[str, float] = field(default_factory=dict)
    excess: float = np.inf
    rank: int = 0
    beyond: float = 0.0
    held_out: Confirmation | None = None
    status: str = "converged"
    promise: float = 0.0
    chosen: float | None = None
    error: float | None = None
    held_out_error: float | None = None
    sizes: Mapping[str, Estimate] = field(default_factory=dict)
    delays: Mapping[str, Estimate] = field(default_factory=dict)

    @classmethod
    def of(
        cls, names: Names, refit: Refit, behind: float = 0.0, rival_p: float = 1.0, chosen: float | None = None
    ) -> Row:
        """Return the row of a refit that was compared with others, but not tested."""
        return cls(
            names=names,
            causes={effect.name: effect.summary for effect in refit.effects},
            mechanisms=refit.mechanisms,
            learned=refit.learned,
            gain=refit.gain,
            degrees_of_freedom=refit.degrees_of_freedom,
            adjusted=refit.adjusted,
            behind=behind,
            rival_p=rival_p,
            chosen=chosen,
            status=refit.fit.status,
            promise=refit.promise,
        )

    @classmethod
    def apart(cls, name: str, what: str, mechanism: str, gain: float, status: str) -> Row:
        """Return the row of a hypothesis of one parameter that is compared with no set of causes, nothing tested."""
        return cls((name,), {name: what}, (mechanism,), False, gain, 1, gain, np.nan, np.nan, status=status)

    @property
    def p_value(self) -> float:
        """The p value of the gain, were the nominal model true."""
        return p_value_of(self.gain, self.degrees_of_freedom)

    @property
    def remaining(self) -> float:
        """What is left beyond chance, as a share of all there was to explain; 1 where it was not asked."""
        return self._share(self.excess)

    @property
    def remaining_interval(self) -> tuple[float, float]:
        """Its 95 % interval: a statistic of r degrees of freedom, e beyond chance, has the variance 2 r + 4 e.

        0 to 1 where it was not asked.
        """
        if np.isinf(self.excess):
            return 0.0, 1.0
        half = Z95 * float(np.sqrt(2.0 * self.rank + 4.0 * self.excess))
        return self._share(max(self.excess - half, 0.0)), self._share(self.excess + half)

    def _share(self, excess: float) -> float:
        return 1.0 if np.isinf(excess) else excess / max(self.gain + self.beyond + excess, 1e-9)

    @property
    def fit_p(self) -> float:
        """The least p value of the tests of what it leaves; 0 where it was not asked."""
        return min(self.tests.values(), default=0.0)

    def fails(self, limits: Thresholds = THRESHOLDS) -> bool:
        """Return whether it is known to fail on the held-out trials."""
        return self.held_out is not None and self.held_out.failed(limits)

    def tolerated(self, limits: Thresholds = THRESHOLDS) -> float:
        """Return the share that a single cause may leave, systematic as it is."""
        return limits.exact if self.learned or all(without_form(name) for name in self.mechanisms) else limits.remaining

    def stays(self, limits: Thresholds = THRESHOLDS) -> bool:
        """Return whether the data cannot tell it from the best."""
        return self.rival_p >= limits.keep or self.behind - self.promise < limits.close

    def clean(self, limits: Thresholds = THRESHOLDS) -> bool:
        """Return whether nothing systematic is left once it is in the model."""
        return self.fit_p >= limits.goodness

    def fits(self, limits: Thresholds = THRESHOLDS) -> bool:
        """Return whether nothing systematic is left that matters.

        Two causes can imitate a third one that is not in the catalogue. So several causes must leave less than a tenth,
        even where no test sees it; two may leave something that a test sees if no larger set could earn its members by
        it; three, which are rarer than a cause that nobody listed, nothing.
        """
        count = len(self.names)
        clean = self.clean(limits) and (count == 1 or self.remaining < limits.remaining)
        little = self.remaining < self.tolerated(limits) if count == 1 else self.leaves_little() and count < LARGEST
        return clean or little

    def leaves_little(self) -> bool:
        """Return whether it leaves less than what a larger set would have to explain beyond it."""
        return self.excess < share_of(self) * self.gain

    def distances(self, limits: Thresholds = THRESHOLDS) -> dict[str, float]:
        """Return every figure over its threshold, by threshold: at 1 the set passes from one side to the other."""
        most = self.tolerated(limits) if len(self.names) == 1 else self._share(share_of(self) * self.gain)
        asked = {
            "goodness": self.fit_p / limits.goodness,
            "left": self.remaining / most,
            "resembles": self.remaining / limits.resembles,
        }
        return {
            "keep": self.rival_p / limits.keep,
            "close": self.behind / limits.close,
            **(asked if self.tests else {}),
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the row as ``diagnosis.json`` has it."""
        left, interval = (self.remaining, [*self.remaining_interval]) if self.tests else (None, None)
        return {**fields_of(self), "left": left, "left_interval": interval, "distances": self.distances()}


@dataclass(frozen=True)
class Comparison:
    """Sets of causes of one size, compared with each other.

    Attributes:
        rows: of the sets, by their names.
    """

    rows: Mapping[Names, Row] = field(default_factory=dict)

    def staying(self, limits: Thresholds = THRESHOLDS) -> list[Row]:
        """Return the sets in the confidence set: the data cannot tell them from the best."""
        return [row for row in self.rows.values() if row.stays(limits)]

    def retained(self, *, clean: bool, limits: Thresholds = THRESHOLDS) -> list[Row]:
        """Return the sets in the confidence set that fit and do not fail on held-out trials, best first."""
        fitting = (row for row in self.staying(limits) if (row.clean(limits) if clean else row.fits(limits)))
        return sorted((row for row in fitting if not row.fails(limits)), key=lambda row: (row.learned, row.behind))

    def closest(self, limits: Thresholds = THRESHOLDS) -> Row | None:
        """Return the set that explains most of all trials, also of the held-out ones; None where there is none.

        Of sets that are as close, one of formulas comes before one with a learned form.
        """
        return min(
            self.rows.values(),
            key=lambda row: (row.behind >= limits.close, row.learned, row.behind),
            default=None,
        )

    def settled(self) -> list[Row]:
        """Return the retained sets that leave nothing systematic, or less than a larger set would have to explain."""
        return [row for row in self.retained(clean=False) if row.clean() or row.leaves_little()]

    def exhausted(self) -> bool:
        """Return whether a set that stays leaves so little that no larger one can earn its members beside it."""
        return any(row.leaves_little() for row in self.retained(clean=False))

    def similar(self, first: Row, share: float, limits: Thresholds = THRESHOLDS) -> list[Row]:
        """Return a set that leaves a misfit, followed by the rivals that leave at most this share of all.

        The misfit shows that the form of the set is not that of the truth. Rivals are granted the same tolerance.
        """
        most = share * (first.gain + first.beyond + first.excess) - first.excess
        others = (row for row in self.rows.values() if row is not first and not row.fails(limits))
        near = [row for row in others if row.behind - first.behind < most]
        return [first, *sorted(near, key=lambda row: row.behind)]

    def joined(self, others: Comparison | None) -> Comparison:
        """Return this comparison with the rows of others for the sets that are in their confidence set."""
        return self if others is None else Comparison({**self.rows, **{row.names: row for row in others.staying()}})

    def failed(self, limits: Thresholds = THRESHOLDS) -> list[Row]:
        """Return the sets in the confidence set that leave nothing, yet fail on the held-out trials."""
        return [row for row in self.staying(limits) if row.clean(limits) and row.fails(limits)]

    def with_held_out(self, found: Mapping[Names, Confirmation | None]) -> Comparison:
        """Return the comparison with what some sets do on the held-out trials."""
        return Comparison({n: replace(row, held_out=found[n]) if n in found else row for n, row in self.rows.items()})


def one_mechanism(rows: Sequence[Row]) -> bool:
    """Return whether all sets are forms of the same mechanisms."""
    return len({row.mechanisms for row in rows}) == 1


@dataclass(frozen=True)
class Table:
    """All that a verdict is read from.

    Attributes:
        p_wrong: p value of the nominal model, beside random causes.
        single: every candidate that was refitted, alone.
        several: sets of two or three; None where none was to be seen.
        others: single causes compared without those that failed on held-out trials; None where none did.
        blocks: findings about the data with which no verdict is worth its words.
        corrections: of the data, that findings propose; each is compared with the data as they stand.
        random: causes that are drawn anew for every run. Their sizes are a part of the noise, beside which all sets are
            compared.
    """

    p_wrong: float = np.nan
    single: Comparison = field(default_factory=Comparison)
    several: Comparison | None = None
    others: Comparison | None = None
    blocks: tuple[str, ...] = ()
    corrections: tuple[Row, ...] = ()
    random: tuple[Row, ...] = ()

    @property
    def rows(self) -> tuple[Row, ...]:
        """Corrections of the data, random causes, then every set, the smaller first, those of one size by margin."""
        every = [*self.single.joined(self.others).rows.values(), *(self.several or Comparison()).rows.values()]
        return (*self.corrections, *self.random, *sorted(every, key=lambda row: (len(row.names), row.behind)))

    def described(self, describe: Callable[[Row], Row]) -> Table:
        """Return the table with every row as a function has it."""

        def of(these: Comparison) -> Comparison:
            return Comparison({names: describe(row) for names, row in these.rows.items()})

        several, others = self.several and of(self.several), self.others and of(self.others)
        return replace(self, single=of(self.single), several=several, others=others)

    def to_dict(self) -> dict[str, Any]:
        """Return the table as ``diagnosis.json`` has it."""
        names = {kind: [row.names for row in getattr(self, kind)] for kind in ("corrections", "random")}
        told = {"p_wrong": self.p_wrong, "thresholds": plain(THRESHOLDS), **names}
        return {**told, "rows": [row.to_dict() for row in self.rows]}

    @classmethod
    def restored(cls, saved: Mapping[str, Any]) -> Table:
        """Return a table with the same rows; which of the sets were compared without others is not known any more."""
        rows = restored(tuple[Row, ...], saved["rows"])
        first, last = len(saved["corrections"]), len(saved["corrections"]) + len(saved["random"])
        sets = Comparison({row.names: row for row in rows[last:]})
        return cls(restored(float, saved["p_wrong"]), sets, corrections=rows[:first], random=rows[first:last])
