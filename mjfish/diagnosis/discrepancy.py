"""What the discrepancy looks like: where it sits, which force is missing, how it scales, which terms describe it.

- `locate`: shares of its energy by channel, trial, part of the run, phase of the beat, speed and rate of turning.
- `missing_force`: the generalised force over time that the nominal model lacks, with its band.
- `fingerprint`: the exponent of frequency of what a named cause leaves, and the symmetry that it breaks.
- `describe`: terms of the link velocities that the missing force follows, where no cause of the catalogue fits.

These are pictures for the reader; no verdict rests on them.

[Rauch1965] H. Rauch, F. Tung, C. Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3.
[Pati1993] Y. Pati, R. Rezaiifar, P. Krishnaprasad, 27th Asilomar Conference.
[Shah2013] R. Shah, R. Samworth, Variable selection with error control: another look at stability selection, J. R.
Statist. Soc. B 75.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy import optimize, stats

from mjfish import frames
from mjfish.arrays import BoolArray, FloatArray, orthonormal, project_out, readonly
from mjfish.compiled import inlined
from mjfish.data import Trial
from mjfish.diagnosis.evidence import Evidence, gather, whitened_omnibus
from mjfish.diagnosis.refit import Refit
from mjfish.effects.effect import Effect, Family, Fingerprint
from mjfish.estimation import Fit, Problem
from mjfish.estimation.noise_of_fit import noise_sample, state_jacobians
from mjfish.estimation.omnibus import beat_phase
from mjfish.fish import Fish
from mjfish.frames import CHANNELS
from mjfish.hydro.load import Load, load
from mjfish.hydro.outline import outlines
from mjfish.noise.autoregressive import grid
from mjfish.noise.by_rate import by_step
from mjfish.noise.process import ProcessNoise, process_noise
from mjfish.parameter import Parameter

#: Beats that count as start-up, and as transition after a change of the drive.
_BEATS = 3.0
PHASES = 8
FIFTHS = ("lowest fifth", "second fifth", "middle fifth", "fourth fifth", "highest fifth")


@dataclass(frozen=True)
class Where:
    """Shares of the systematic misfit's energy, each table adding up to one.

    Attributes:
        channel, trial, part, phase, speed, turn: where most of it is, counting shares against the share of samples.
        channels, trials, parts, phases, speeds, turns: all shares. Parts are ``start-up`` (the first three beats),
            ``transition`` (three beats after a change of the drive), ``steady``; phases are eighths of the last joint's
            beat; speeds and turns are fifths of all samples by surge and by |yaw rate| as the fitted model has them.
    """

    channel: str
    trial: str
    part: str
    phase: str
    speed: str
    turn: str
    channels: dict[str, float]
    trials: dict[str, float]
    parts: dict[str, float]
    phases: dict[str, float]
    speeds: dict[str, float]
    turns: dict[str, float]


def locate(evidence: Evidence, directed: bool) -> Where:
    """Locate the systematic misfit of a fit.

    The systematic part of the residual is its projection on what the tests found: the signatures of all candidates
    where those explain it, else the omnibus basis. The directions of the coefficients are projected out first.

    Args:
        evidence: of the fit.
        directed: whether the candidates explain the misfit; else the omnibus basis pictures it.
    """
    problem = evidence.problem
    free = evidence.fit.jacobian[:, ~evidence.fit.at_bound]
    coefficients = orthonormal(free)
    z = project_out(coefficients, evidence.fit.residual[:, None])
    pattern = evidence.signatures if directed else project_out(coefficients, whitened_omnibus(problem))
    span = orthonormal(pattern)
    energy = ((span @ (span.T @ z))[:, 0] ** 2).reshape(-1, 3)
    labels = [_labels(problem.model.fish.cpg, trial) for trial in problem.trials]
    counted = [problem.mask(i) for i in range(len(problem.trials))]
    names = np.concatenate([np.full(int(k.sum()), t.name) for k, t in zip(counted, problem.trials, strict=True)])
    parts = np.concatenate([part[k] for (part, _), k in zip(labels, counted, strict=True)])
    phases = np.concatenate([phase[k] for (_, phase), k in zip(labels, counted, strict=True)])
    swum = np.concatenate([v[k] for v, k in zip(problem.predictions(evidence.fit.x), counted, strict=True)])
    speeds, turns = fifths(swum[:, 0]), fifths(np.abs(swum[:, 2]))
    per_sample = energy.sum(axis=1)
    total = max(float(per_sample.sum()), 1e-300)
    channels = {name: float(v) / total for name, v in zip(CHANNELS, energy.sum(axis=0), strict=True)}
    return Where(
        channel=max(channels, key=channels.__getitem__),
        trial=_densest(names, per_sample),
        part=_densest(parts, per_sample),
        phase=_densest(phases, per_sample),
        speed=_densest(speeds, per_sample),
        turn=_densest(turns, per_sample),
        channels=channels,
        trials=_shares(names, per_sample),
        parts=_shares(parts, per_sample),
        phases=_shares(phases, per_sample),
        speeds=_shares(speeds, per_sample),
        turns=_shares(turns, per_sample),
    )


def fifths(values: FloatArray) -> np.ndarray[Any, Any]:
    """Return, per sample, in which fifth of all samples its value lies."""
    edges = np.quantile(values, [0.2, 0.4, 0.6, 0.8])
    return np.array(FIFTHS)[np.searchsorted(edges, values, side="right")]


def _shares(labels: np.ndarray[Any, Any], energy: FloatArray) -> dict[str, float]:
    total = max(float(energy.sum()), 1e-300)
    return {str(label): float(energy[labels == label].sum()) / total for label in np.unique(labels)}


def _densest(labels: np.ndarray[Any, Any], energy: FloatArray) -> str:
    """Return the label with the most energy a sample."""
    return str(max(np.unique(labels), key=lambda label: float(energy[labels == label].mean())))


def _labels(cpg: Any, trial: Trial) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return, per sample, the part of the run and the eighth of the beat."""
    phase = beat_phase(cpg, trial)
    beats = abs(phase[-1] - phase[0]) / (2.0 * np.pi)
    lasting = _BEATS * float(trial.time[-1] - trial.time[0]) / max(beats, 1.0)
    part = np.full(len(trial.time), "steady", dtype=object)
    if trial.starts_at_rest:
        part[trial.time < lasting] = "start-up"
    for segment in trial.drive[1:]:
        part[(trial.time >= segment.start) & (trial.time < segment.start + lasting)] = "transition"
    eighth = np.floor(np.mod(phase, 2.0 * np.pi) / (2.0 * np.pi) * PHASES).astype(int) % PHASES
    names = np.array([f"{k}/{PHASES} to {k + 1}/{PHASES}" for k in range(PHASES)], dtype=object)
    return part.astype(str), names[eighth].astype(str)


@dataclass(frozen=True, eq=False)
class MissingForce:
    """What the nominal model lacks in one trial.

    Attributes:
        trial: its name.
        time: (n,) [s].
        force: (n, 3) along, across [N] and moment [N m] at the nose, in the head's forward frame.
        band: (n, 3) its standard deviation.
        driving: (3,) root mean square of what moves the simulated fish and its water, M v', in the same units.
    """

    trial: str
    time: FloatArray
    force: FloatArray
    band: FloatArray
    driving: FloatArray

    @property
    def share(self) -> FloatArray:
        """Root mean square of the missing force over that of the driving one (3,): how much it matters."""
        return np.asarray(np.sqrt(np.mean(self.force**2, axis=0)) / np.maximum(self.driving, 1e-300))

    def summary(self) -> dict[str, Any]:
        """Return root mean squares of the force and of its band, along, across [N] and moment [N m], and its share."""
        force, band = (np.sqrt(np.mean(series**2, axis=0)).tolist() for series in (self.force, self.band))
        share = self.share.tolist()
        return {"trial": self.trial, "rms": force, "band": band, "units": ["N", "N", "N m"], "share": share}


def missing_force(problem: Problem, fit: Fit) -> tuple[MissingForce, ...]:
    """Return the missing generalised force of every trial of a fit.

    Random accelerations (`mjfish.noise.process`) are assumed behind the residual of the nominal model; a
    Kalman smoother [Rauch1965] estimates them from all samples of a run. Times the inertia of the stretched fish they
    are the force and the moment at the nose. The estimate is shrunk towards zero and its samples are correlated: it
    serves for pictures, never as data of a test.
    """
    left, jacobians = noise_sample(problem, problem.raw(fit.x)), state_jacobians(problem, fit.values)
    found: dict[int, MissingForce] = {}
    for index in by_step(problem.trials).values():
        noise = process_noise(left.of_trials(index), jacobians)
        found.update({i: _of_trial(problem, i, fit.values, noise, left.residuals[i]) for i in index})
    return tuple(found[i] for i in range(len(problem.trials)))


def _of_trial(
    problem: Problem, index: int, values: Mapping[str, float], noise: ProcessNoise, residual: FloatArray
) -> MissingForce:
    inertia = stretched(problem.model.fish, values)
    trial, mask = problem.trials[index], problem.mask(index)
    seen = grid(trial.time, mask)
    step = trial.step
    mean, covariance = _smoothed(noise, noise.jacobians[trial.name], step, seen, residual)
    variance = np.einsum("ij,njk,ik->ni", inertia, covariance, inertia)
    band = np.sqrt(np.maximum(variance, 0.0))  # next to nothing is left below 0 by rounding
    rollout = problem.prediction(trial, values).rollout
    swum = rollout.rate_at(trial.time[mask])[:, :3] @ inertia.T
    return MissingForce(
        trial=trial.name,
        time=readonly(trial.time[0] + step * np.arange(len(seen))),
        force=readonly(mean @ inertia.T),
        band=readonly(band),
        driving=readonly(np.sqrt(np.mean(swum**2, axis=0))),
    )


def stretched(fish: Fish, values: Mapping[str, float]) -> FloatArray:
    """Return the inertia (3, 3) of the stretched fish with its added mass about the nose, in the forward frame.

    M = sum_i T_i' (M_i + M_ad,i) T_i, [Yu2016] eqs. (16)-(18) with all joints straight.
    """
    total, x = np.zeros((3, 3)), 0.0
    for link, outline in zip(fish.links, outlines(fish), strict=True):
        a0, a1, a2 = values[f"c_m.{link.group}"] * np.asarray(outline.added)
        across, first = link.mass + a0, link.mass * link.com + a1
        about = link.inertia + link.mass * link.com**2 + a2
        total += np.array(
            [
                [link.mass, 0.0, 0.0],
                [0.0, across, first + x * across],
                [0.0, first + x * across, about + 2.0 * x * first + x * x * across],
            ]
        )
        x += link.length
    signs = frames.flip(np.ones(3))
    return np.asarray(signs[:, None] * total * signs)


def _smoothed(
    noise: ProcessNoise, growing: FloatArray, step: float, seen: BoolArray, residual: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mean (n, 3) and covariance (n, 3, 3) of the accelerations, given all samples."""
    n = len(seen)
    ahead, drive, p = noise.matrices(growing[:n], step)
    spread = np.diag(noise.sigma**2)
    mean, covariance = np.zeros((n, 6)), np.zeros((n, 6, 6))
    m = np.zeros(6)
    rows = np.cumsum(seen) - 1
    for t in range(n):
        if t > 0:
            m, p = ahead[t - 1] @ m, ahead[t - 1] @ p @ ahead[t - 1].T + drive
        if seen[t]:
            gain = np.linalg.solve(p[:3, :3] + spread, p[:3]).T
            m, p = m + gain @ (residual[rows[t]] - m[:3]), p - gain @ p[:3]
        mean[t], covariance[t] = m, p
    for t in range(n - 2, -1, -1):
        predicted = ahead[t] @ covariance[t] @ ahead[t].T + drive
        back = np.linalg.lstsq(predicted, ahead[t] @ covariance[t])[0].T
        mean[t] += back @ (mean[t + 1] - ahead[t] @ mean[t])
        covariance[t] += back @ (covariance[t + 1] - predicted) @ back.T
    return mean[:, 3:], covariance[:, 3:, 3:]


HARMONICS = 3
#: Beats that a stretch must last, and beats after a start or step that are not steady yet.
_LASTING, _SETTLING = 2.0, 3.0
#: Frequencies closer than this share are one.
_APART = 0.05


@dataclass(frozen=True)
class Measured:
    """The fingerprint of a discrepancy.

    Attributes:
        exponent: q with its 95 % interval `low`, `high`; None where the steady straight stretches have one frequency.
        low, high: of the interval.
        odd: share of the steady discrepancy's energy that breaks the glide reflection, None without such a stretch.
        odd_p: p value of that part, were the world left-right symmetric.
        predicted: of the causes, where it is one cause.
    """

    exponent: float | None
    low: float | None
    high: float | None
    odd: float | None
    odd_p: float | None
    predicted: Fingerprint


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Harmonics of one steady stretch: frequency [Hz], coefficients in units of their standard errors and raw."""

    frequency: float
    kept: FloatArray
    broken: FloatArray
    size: float
    error: float


def fingerprint(refit: Refit) -> Measured:
    """Return the fingerprint of what the causes of a refit add.

    It is taken from y - eta(theta, 0), the measurement less the prediction of the extended model with its causes
    switched off: refitted coefficients alone would have hidden most of it. Harmonics of the beat are regressed on each
    channel c of every steady, straight stretch:

        r_c(t) = sum_h a_ch cos h phi + b_ch sin h phi,   h = 0..3

    The nominal model keeps the glide reflection (surge, sway, yaw rate)(t + T/2) = (surge, -sway, -yaw rate)(t): its
    surge has even harmonics, its sway and yaw rate odd ones; all others are odd under it. By its time scaling,
    velocities over f L are the same at all frequencies f. A discrepancy ~ f^q shows as the slope q of
    log |r| / f over log f.
    """
    problem = refit.problem
    off = {p.name: p.default for effect in refit.effects for p in effect.parameters if not p.shape}
    x = problem.start({**refit.fit.values, **off})
    stretches = [s for i, raw in enumerate(problem.raw(x)) for s in _stretches(problem, i, raw)]
    exponent, low, high = _exponent(stretches)
    odd, odd_p = _parity(stretches)
    predicted = refit.effects[0].fingerprint if len(refit.effects) == 1 else Fingerprint()
    return Measured(exponent, low, high, odd, odd_p, predicted)


def _stretches(problem: Problem, index: int, raw: FloatArray) -> list[_Stretch]:
    trial = problem.trials[index]
    if trial.joint_angle is not None:
        return []
    mask, phase = problem.mask(index), beat_phase(problem.model.fish.cpg, trial)
    edges = [*(segment.start for segment in trial.drive), float(trial.time[-1])]
    found = []
    for segment, end in zip(trial.drive, edges[1:], strict=True):
        beat = 2.0 * np.pi / segment.omega if segment.omega > 0.0 else np.inf
        here = (trial.time >= segment.start + _SETTLING * beat) & (trial.time <= end)
        if any(segment.bias) or np.count_nonzero(here) * trial.step < _LASTING * beat:
            continue
        rows = here[mask]
        turned = phase[mask][rows]
        frequency = float(np.polyfit(trial.time[mask][rows], turned, 1)[0]) / (2.0 * np.pi)
        found.append(_harmonics(abs(frequency), turned, raw[rows], problem.noise.sigma))
    return found


def _harmonics(frequency: float, phase: FloatArray, raw: FloatArray, sigma: FloatArray) -> _Stretch:
    """Regress harmonics on a stretch; errors from what they leave, in units of sigma of each channel."""
    waves = [np.ones_like(phase)]
    for h in range(1, HARMONICS + 1):
        waves += [np.cos(h * phase), np.sin(h * phase)]
    design = np.stack(waves, axis=1)
    order = np.array([0, *(h for h in range(1, HARMONICS + 1) for _ in range(2))])
    coefficients, *_ = np.linalg.lstsq(design, raw, rcond=None)
    left = raw - design @ coefficients
    spread = np.linalg.inv(design.T @ design)
    memory = 1.0 + 2.0 * np.maximum(np.sum(left[1:] * left[:-1], axis=0) / np.sum(left**2, axis=0), 0.0)
    variance = np.sum(left**2, axis=0) / max(len(phase) - len(order), 1) * memory
    errors = np.sqrt(np.diag(spread)[:, None] * variance)
    scaled = coefficients / errors
    even = order % 2 == 0
    kept = np.concatenate([scaled[even, 0], scaled[~even, 1], scaled[~even, 2]])
    broken = np.concatenate([scaled[~even, 0], scaled[even, 1], scaled[even, 2]])
    unit = coefficients / sigma
    noise = float(np.sum((errors / sigma) ** 2))
    power = float(np.sum(unit**2)) - noise
    error = float(np.sqrt(np.sum(4.0 * unit**2 * (errors / sigma) ** 2))) / 2.0 / np.sqrt(max(power, noise))
    return _Stretch(frequency, kept, broken, float(np.sqrt(max(power, 0.0))), error)


def _exponent(stretches: Sequence[_Stretch]) -> tuple[float | None, float | None, float | None]:
    seen = [s for s in stretches if s.size > 3.0 * s.error]
    frequencies = np.array([s.frequency for s in seen])
    if len(seen) < 2 or np.ptp(frequencies) < _APART * frequencies.mean():
        return None, None, None
    x, y = np.log(frequencies), np.log([s.size / s.frequency for s in seen])
    errors = np.array([s.error / s.size for s in seen])
    line, covariance = optimize.curve_fit(lambda f, a, q: a + q * f, x, y, sigma=errors, absolute_sigma=True)
    left = (y - line[0] - line[1] * x) / errors
    inflate = max(1.0, float(left @ left) / max(len(seen) - 2, 1))
    half = stats.norm.ppf(0.975) * float(np.sqrt(covariance[1, 1] * inflate))
    return float(line[1]), float(line[1]) - half, float(line[1]) + half


def _parity(stretches: Sequence[_Stretch]) -> tuple[float | None, float | None]:
    if not stretches:
        return None, None
    kept, broken = (np.concatenate([getattr(s, side) for s in stretches]) for side in ("kept", "broken"))
    even, odd = (max(float(part @ part) - len(part), 0.0) for part in (kept, broken))
    share = odd / (odd + even) if odd + even > 0.0 else 0.0
    return share, float(stats.chi2.sf(float(broken @ broken), len(broken)))


#: Functions of a link's velocity, along u, across v, turning w, and of its length; named as a reader would write them.
_FUNCTIONS = ("1", "u", "|u| u", "v", "|v| v", "w", "u v")
_MOST = 3
_PAIRS, _OFTEN = 25, 0.7


@inlined
def _total(link: Any, p: Any) -> Any:
    """Return the sum of all functions of a link's velocity."""
    u, v, w = link.u, link.v, link.w
    return p[0] + p[1] * u + p[2] * abs(u) * u + p[3] * v + p[4] * abs(v) * v + p[5] * w + p[6] * u * v


@load
def _along(link: Any, p: Any) -> tuple[float, float, float]:
    total = _total(link, p)
    return total * link.length, 0.0, 0.0


@load
def _across(link: Any, p: Any) -> tuple[float, float, float]:
    total = _total(link, p)
    return 0.0, total * link.length, 0.5 * total * link.length**2


@load
def _turning(link: Any, p: Any) -> tuple[float, float, float]:
    total = _total(link, p)
    return 0.0, 0.0, total * link.length


class _Term(Effect):
    """Forces on every link per length; not in the catalogue, for it names no cause."""

    family: ClassVar[Family] = "water"
    source: ClassVar[str] = "a description, not a physics"
    signature: ClassVar[str] = "that of its terms"
    confirm: ClassVar[str] = "find the cause"


def _terms(name: str, unit: str) -> tuple[Parameter, ...]:
    return tuple(
        Parameter(f"{name}.term_{k}", unit, 0.0, -1e6, 1e6, 0.0, 0.1, about=function)
        for k, function in enumerate(_FUNCTIONS)
    )


class _Along(_Term):
    name: ClassVar[str] = "force_along"
    summary: ClassVar[str] = "a force along every link"
    parameters: ClassVar[tuple[Parameter, ...]] = _terms("force_along", "SI")
    load: ClassVar[Load | None] = _along


class _Across(_Term):
    name: ClassVar[str] = "force_across"
    summary: ClassVar[str] = "a force across every link"
    parameters: ClassVar[tuple[Parameter, ...]] = _terms("force_across", "SI")
    load: ClassVar[Load | None] = _across


class _Turning(_Term):
    name: ClassVar[str] = "moment"
    summary: ClassVar[str] = "a moment on every link"
    parameters: ClassVar[tuple[Parameter, ...]] = _terms("moment", "SI")
    load: ClassVar[Load | None] = _turning


@dataclass(frozen=True)
class Term:
    """One term of a description.

    Attributes:
        what: in words, e.g. ``a force along every link ~ |u| u``.
        size: amplitude, SI units per metre of link.
        stable: share of the halves of the runs that choose it too.
    """

    what: str
    size: float
    stable: float


@dataclass(frozen=True)
class Description:
    """Terms that describe the missing force, and the share of all there is to explain that they explain."""

    terms: tuple[Term, ...]
    explained: float


def describe(problem: Problem, fit: Fit, rng: np.random.Generator) -> Description:
    """Describe what a fit leaves by forces on every link, such as "a moment on every link ~ |u| u".

    The signature of such a term is a sensitivity like that of a cause: no noisy signal is differentiated, and the
    coefficients are projected out. Terms are chosen by orthogonal matching pursuit [Pati1993] and kept where most
    random halves of the runs choose them too (stability selection by complementary pairs, [Shah2013]). The result says
    how the missing force looks, not why.
    """
    evidence = gather(problem, fit, (_Along(), _Across(), _Turning()))
    labels = [f"{effect.summary} ~ {p.about}" for effect in evidence.candidates for p in effect.parameters]
    scales = np.array([p.scale for effect in evidence.candidates for p in effect.parameters])
    chosen = _pursuit(evidence.score, evidence.information)
    halves = _halves(evidence, rng)
    often = [np.mean([index in half for half in halves]) for index in chosen]
    kept = [index for index, share in zip(chosen, often, strict=True) if share >= _OFTEN]
    if not kept:
        return Description((), 0.0)
    size = np.linalg.solve(evidence.information[np.ix_(kept, kept)], evidence.score[kept])
    explained = float(size @ evidence.score[kept]) - len(kept)
    total = explained + max(_left(evidence, kept), 0.0)
    terms = [
        Term(labels[i], float(s * scales[i]), float(often[chosen.index(i)])) for i, s in zip(kept, size, strict=True)
    ]
    return Description(tuple(terms), max(explained, 0.0) / max(total, 1e-9))


def _left(evidence: Evidence, kept: Sequence[int]) -> float:
    """Return what the omnibus basis explains beyond chance of what the terms leave."""
    statistic = evidence.omnibus_excess()
    size = np.linalg.solve(evidence.information[np.ix_(kept, kept)], evidence.score[list(kept)])
    return statistic - float(size @ evidence.score[list(kept)])


def _pursuit(score: FloatArray, information: FloatArray) -> list[int]:
    """Choose columns one by one, each the one that explains most of what those before it leave."""
    lengths = np.sqrt(np.maximum(np.diag(information), 1e-300))
    solid = lengths > 1e-9 * lengths.max()
    chosen: list[int] = []
    for _ in range(_MOST):
        inner = information[np.ix_(chosen, chosen)]
        weights = np.linalg.lstsq(inner, score[chosen])[0] if chosen else np.zeros(0)
        left = score - information[:, chosen] @ weights
        across = np.linalg.lstsq(inner, information[chosen])[0] if chosen else np.zeros((0, len(score)))
        own = np.diag(information) - np.einsum("ij,ij->j", information[chosen], across)
        gain = np.where(solid & (own > 1e-6 * lengths**2), left**2 / np.maximum(own, 1e-300), 0.0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain))
        if gain[best] < 2.0 * np.log(len(score)) + 4.0:
            break
        chosen.append(best)
    return chosen


def _halves(evidence: Evidence, rng: np.random.Generator) -> list[list[int]]:
    """Choose terms again on random complementary halves of the runs."""
    rows = evidence.rows_by_trial()
    if len(rows) < 2:
        return [_pursuit(evidence.score, evidence.information)]
    z = evidence.cleared
    scores = [evidence.signatures[r].T @ z[r] for r in rows]
    informations = [evidence.signatures[r].T @ evidence.signatures[r] for r in rows]
    chosen = []
    for _ in range(_PAIRS):
        order = rng.permutation(len(rows))
        for half in (order[: len(rows) // 2], order[len(rows) // 2 :]):
            chosen.append(_pursuit(sum(scores[i] for i in half), sum(informations[i] for i in half)))
    return chosen
