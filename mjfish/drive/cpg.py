"""Hopf-oscillator CPG, [Yu2016] eq. (20), with exact joint rates and accelerations.

    zeta_i' = -w (psi_i - b_i) + zeta_i (A_i - r_i^2) + h1 [zeta_{i-1} cos phi + (psi_{i-1} - b_{i-1}) sin phi]
    psi_i'  =  w zeta_i + (psi_i - b_i) (A_i - r_i^2) + h2 [zeta_{i+1} sin phi + (psi_{i+1} - b_{i+1}) cos phi]

with r_i^2 = zeta_i^2 + (psi_i - b_i)^2 and theta_i = beta unit psi_i. Neighbours outside the chain are zero. Rates and
accelerations come from the right-hand side and its time derivative, never from differences.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mjfish.drive.motion import JointMotion, cached, grid
from mjfish.errors import InputError
from mjfish.fish import Cpg
from mjfish.numerics.arrays import FloatArray
from mjfish.numerics.compiled import compiled, merged

#: Start of every oscillator; psi starts at its bias.
ZETA_START = 0.1


@dataclass(frozen=True)
class DriveSegment:
    """A stretch of constant CPG input: from `start` [s] on, frequency `omega` [rad/s] and one bias a joint [-]."""

    start: float
    omega: float
    bias: tuple[float, ...]


class _Chain(NamedTuple):
    """Constants of the oscillators: amplitudes A_i (joints,), couplings h1 and h2, cosine and sine of the phase."""

    amplitude: FloatArray
    h1: float
    h2: float
    cos: float
    sin: float


@cached(0.1e9)
def joint_motion(cpg: Cpg, segments: tuple[DriveSegment, ...], duration: float, step: float) -> JointMotion:
    """Integrate the CPG and sample the joint motion on the half-step grid.

    Args:
        cpg: constants of the oscillators.
        segments: input over time; frequency and bias change as steps.
        duration: [s]; segments that start later have no effect.
        step: longest integration step [s].

    Returns:
        The joint motion; where the input changes, the rate jumps between two steps.
    """
    joints = len(cpg.amplitude)
    for segment in segments:
        if len(segment.bias) != joints:
            raise InputError(
                f"drive segment at {segment.start:g} s has {len(segment.bias)} biases, the CPG has {joints} joints"
            )
    if not segments or segments[0].start != 0.0:
        raise InputError("the first drive segment must start at 0 s; add one")
    for before, after in itertools.pairwise(segments):
        if not after.start > before.start:
            raise InputError(f"drive segment at {after.start:g} s follows one at {before.start:g} s; sort the segments")
    if not duration > 0.0:
        raise InputError(f"the duration is {duration:g} s, expected a positive one")
    active = [segment for segment in segments if segment.start < duration]
    time = grid(np.array([*(segment.start for segment in active), duration]), step, graded=True)
    index = np.searchsorted([segment.start for segment in active], 0.5 * (time[:-1] + time[1:])) - 1
    omega = np.array([segment.omega for segment in active])[index]
    bias = np.array([segment.bias for segment in active])[index]
    chain = _Chain(np.array(cpg.amplitude), cpg.h1, cpg.h2, np.cos(cpg.phase), np.sin(cpg.phase))
    psi, rate, acceleration = _sample(np.diff(time), omega, bias, chain)
    gain = cpg.beta * cpg.unit
    return JointMotion(time=time, angle=gain * psi, rate=gain * rate, acceleration=gain * acceleration)


@compiled
def _sample(
    steps: FloatArray,
    omega: FloatArray,
    bias: FloatArray,
    chain: _Chain,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate eq. (20) by Runge-Kutta steps of half a step; return psi, psi', psi'' (n, 3, joints)."""
    n, joints = bias.shape
    psi = np.empty((n, 3, joints))
    rate = np.empty((n, 3, joints))
    acceleration = np.empty((n, 3, joints))
    # Rows: 0 the state, 1 the Runge-Kutta trial state, 2 to 5 the rates of the four stages.
    zeta = np.empty((6, joints))
    delta = np.empty((6, joints))  # psi - b, which is what the equations speak of
    zeta[0] = ZETA_START
    delta[0] = 0.0
    for step in range(n):
        changed = step == 0 or omega[step] != omega[step - 1]
        if step > 0:
            for i in range(joints):
                shift = bias[step - 1, i] - bias[step, i]
                delta[0, i] += shift  # psi is continuous, b is not
                changed = changed or shift != 0.0
        for stage in range(3):
            if stage > 0:
                _advance(zeta, delta, 0.5 * steps[step], omega[step], chain)
            if stage > 0 or changed:  # else the rates at the end of the step before still hold
                _rates(zeta, delta, 0, 2, omega[step], chain)
            for i in range(joints):
                psi[step, stage, i] = delta[0, i] + bias[step, i]
                rate[step, stage, i] = delta[2, i]
                growth = chain.amplitude[i] - zeta[0, i] ** 2 - delta[0, i] ** 2
                growth_rate = -2.0 * (zeta[0, i] * zeta[2, i] + delta[0, i] * delta[2, i])
                second = omega[step] * zeta[2, i] + delta[2, i] * growth + delta[0, i] * growth_rate
                if i < joints - 1:
                    second += chain.h2 * (zeta[2, i + 1] * chain.sin + delta[2, i + 1] * chain.cos)
                acceleration[step, stage, i] = second
    return psi, rate, acceleration


@merged
def _advance(
    zeta: FloatArray,
    delta: FloatArray,
    h: float,
    omega: float,
    chain: _Chain,
) -> None:
    """Advance row 0 by `h` with one classical Runge-Kutta step; row 2 holds its rates already."""
    joints = chain.amplitude.shape[0]
    for stage in range(3):
        ahead = h if stage == 2 else 0.5 * h
        for i in range(joints):
            zeta[1, i] = zeta[0, i] + ahead * zeta[2 + stage, i]
            delta[1, i] = delta[0, i] + ahead * delta[2 + stage, i]
        _rates(zeta, delta, 1, 3 + stage, omega, chain)
    for i in range(joints):
        zeta[0, i] += h / 6.0 * (zeta[2, i] + 2.0 * zeta[3, i] + 2.0 * zeta[4, i] + zeta[5, i])
        delta[0, i] += h / 6.0 * (delta[2, i] + 2.0 * delta[3, i] + 2.0 * delta[4, i] + delta[5, i])


@merged
def _rates(
    zeta: FloatArray,
    delta: FloatArray,
    row: int,
    out: int,
    omega: float,
    chain: _Chain,
) -> None:
    """Right-hand side of eq. (20) at row `row`, into row `out`."""
    joints = chain.amplitude.shape[0]
    for i in range(joints):
        z = zeta[row, i]
        d = delta[row, i]
        growth = chain.amplitude[i] - z * z - d * d
        zeta_rate = -omega * d + z * growth
        delta_rate = omega * z + d * growth
        if i > 0:
            zeta_rate += chain.h1 * (zeta[row, i - 1] * chain.cos + delta[row, i - 1] * chain.sin)
        if i < joints - 1:
            delta_rate += chain.h2 * (zeta[row, i + 1] * chain.sin + delta[row, i + 1] * chain.cos)
        zeta[out, i] = zeta_rate
        delta[out, i] = delta_rate
