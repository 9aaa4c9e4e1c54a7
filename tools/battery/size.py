"""How large an effect must be to be seen this well: lambda = |M (eta(psi) - eta(0))|^2, whitened by the true noise.

M projects out the sensitivities of the nine coefficients: what is left is what a refit cannot swallow. All by the
generator's own runs, with a coarser step and fewer strips.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from battery.classes import LISTED, Cause
from battery.draft import Draft
from battery.noise import whiten
from mjfish.arrays import FloatArray

#: Step of the central differences by the coefficients, relative.
_DIFFERENCE = 0.03
_ROUNDS = 6
#: A strength counts as met within this share.
MET = 0.05


@dataclass(frozen=True, eq=False)
class Ruler:
    """Measures signatures of one draft over some of its runs.

    Attributes:
        draft: measured.
        numbers: of the runs.
        span: (n, 9) orthonormal, of the coefficients' whitened sensitivities.
        plain: (n,) whitened runs without any effect.
    """

    draft: Draft
    numbers: tuple[int, ...]
    span: FloatArray
    plain: FloatArray

    def signature(self, psi: Mapping[str, float], without: FloatArray | None = None) -> FloatArray:
        """Return the whitened difference (n,) that `psi` makes to the plain runs, or to those `without` it."""
        return stacked(self.draft, self.numbers, psi) - (self.plain if without is None else without)

    def beyond(self, signature: FloatArray, others: Sequence[FloatArray] = ()) -> FloatArray:
        """Return what is left of a signature after refit, and after `others` (n,) are taken out too."""
        left = _out(self.span, signature)
        if others:
            basis, _ = np.linalg.qr(np.column_stack([_out(self.span, other) for other in others]))
            left = _out(basis, left)
        return left


def _out(basis: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray(vector - basis @ (basis.T @ vector))


def stacked(
    draft: Draft, numbers: Sequence[int], psi: Mapping[str, float], theta: Mapping[str, float] | None = None
) -> FloatArray:
    """Return the whitened noise-free runs, one after another (n,)."""
    return np.concatenate([whiten(draft.noise, draft.clean(i, psi, theta=theta)).ravel() for i in numbers])


def ruler(draft: Draft, numbers: Sequence[int]) -> Ruler:
    """Compute the sensitivities of the coefficients over some runs."""
    plain = stacked(draft, numbers, {})
    columns = []
    for name, value in draft.theta.items():
        up, down = ({**draft.theta, name: value * (1.0 + sign * _DIFFERENCE)} for sign in (1.0, -1.0))
        columns.append(stacked(draft, numbers, {}, up) - stacked(draft, numbers, {}, down))
    jacobian = np.column_stack(columns)
    span, _ = np.linalg.qr(jacobian / np.linalg.norm(jacobian, axis=0))
    return Ruler(draft, tuple(numbers), span, plain)


@dataclass(frozen=True)
class Sized:
    """Effects at their sizes.

    Attributes:
        psi: all parameters.
        strength, absorbed, reached: by cause; see `battery.sealed.Truth`.
    """

    psi: dict[str, float]
    strength: dict[str, float]
    absorbed: dict[str, float]
    reached: dict[str, bool]


def sized(
    measure: Ruler,
    causes: Sequence[Cause],
    directions: Sequence[Mapping[str, float]],
    strengths: Sequence[float],
) -> Sized:
    """Find the sizes at which each cause has its strength given the others.

    Effects are not linear: secant steps on the root of the strength against the size, at most _ROUNDS.
    """
    size = np.array([max(min(1.0, 0.3 * cause.high), cause.low) for cause in causes])
    history: list[tuple[FloatArray, FloatArray]] = []
    for _ in range(_ROUNDS):
        whole, own = _signatures(measure, causes, directions, size)
        found = np.array([float(np.linalg.norm(v)) for v in own])
        history.append((size, found))
        if np.all(np.abs((found / np.sqrt(strengths)) ** 2 - 1.0) < 0.02):
            break
        if np.all((size <= [c.low for c in causes]) & (found**2 > strengths)):
            break  # however small, it is seen: a servo that starts from rest kicks
        size = _next(history, np.sqrt(np.array(strengths)), causes)
    best = min(range(len(history)), key=lambda i: float(np.max(np.abs(np.log(history[i][1] ** 2 / strengths)))))
    size, found = history[best]
    whole, own = _signatures(measure, causes, directions, size)
    psi: dict[str, float] = {}
    for cause, direction, s in zip(causes, directions, size, strict=True):
        psi |= cause.sized(direction, float(s))
    names = [cause.name for cause in causes]
    left = [float(np.sum(measure.beyond(v) ** 2) / max(np.sum(v**2), 1e-300)) for v in whole]
    met = [bool(abs(f**2 / s - 1.0) < MET) for f, s in zip(found, strengths, strict=True)]
    return Sized(
        psi,
        dict(zip(names, (float(f) ** 2 for f in found), strict=True)),
        dict(zip(names, (1.0 - share for share in left), strict=True)),
        dict(zip(names, met, strict=True)),
    )


def _signatures(
    measure: Ruler, causes: Sequence[Cause], directions: Sequence[Mapping[str, float]], size: FloatArray
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return each cause's signature with the others on, whole and beyond refit and others."""
    parts = [cause.sized(d, float(s)) for cause, d, s in zip(causes, directions, size, strict=True)]
    everything = {key: value for part in parts for key, value in part.items()}
    if len(parts) == 1:
        whole = [measure.signature(everything)]
    else:
        full = stacked(measure.draft, measure.numbers, everything)
        whole = []
        for i in range(len(parts)):
            rest = {key: value for j, part in enumerate(parts) if j != i for key, value in part.items()}
            whole.append(full - stacked(measure.draft, measure.numbers, rest))
    own = [measure.beyond(v, [w for j, w in enumerate(whole) if j != i]) for i, v in enumerate(whole)]
    return whole, own


def _next(history: list[tuple[FloatArray, FloatArray]], target: FloatArray, causes: Sequence[Cause]) -> FloatArray:
    """Return the next sizes: proportional first, then by the secant, kept within a factor of 20 and the bounds."""
    size, found = history[-1]
    step = size * target / np.maximum(found, 1e-12)
    if len(history) > 1:
        before, was = history[-2]
        slope = (found - was) / np.where(size == before, np.inf, size - before)
        secant = size + (target - found) / np.where(slope > 0.0, slope, np.inf)
        step = np.where((slope > 0.0) & (secant > 0.05 * step) & (secant < 20.0 * step), secant, step)
    step = np.clip(step, size / 20.0, 20.0 * size)
    return np.clip(step, [max(cause.low, 1e-4 * cause.high) for cause in causes], [cause.high for cause in causes])


def rivals(measure: Ruler, cause: Cause, psi: Mapping[str, float], seed: int) -> dict[str, float]:
    """Return the correlation, after refit, of the signature of `psi` with each other cause of the list.

    A cause of several parameters counts with all of them: the cosine of the smallest angle to their span.
    """
    own = measure.beyond(measure.signature(psi))
    length = float(np.linalg.norm(own))
    found = {}
    for other in LISTED:
        if other.name == cause.name or (other.needs_pose and not measure.draft.plan.pose):
            continue
        drawn = other.draw(np.random.default_rng(seed))
        axes = [key for key in drawn if key not in other.shapes]
        columns = []
        for axis in axes:
            one = {key: drawn[key] for key in other.shapes}
            typical = max(abs(drawn[key]) for key in axes if key.partition(".")[0] == axis.partition(".")[0])
            one |= {key: (typical if key == axis else 0.0) for key in axes}
            columns.append(measure.beyond(measure.signature(one)))
        basis, _ = np.linalg.qr(np.column_stack(columns))
        found[other.name] = float(np.linalg.norm(basis.T @ own) / max(length, 1e-300))
    return found
