"""Small matrices and wrenches of the linearised equation of motion, as plain numbers that stay in registers."""

from __future__ import annotations

from mjfish.arrays import FloatArray
from mjfish.compiled import merged

Three = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]
#: Columns by a joint: its angle, rate, acceleration, and the length of the link in front of it.
ANGLE, RATE, ACCELERATION, LENGTH = range(4)
#: Numbers of a solver: the inverse of the inertia (6), and of a flexible tail k (3) and j.
SOLVER = 10


@merged
def forward(c: float, s: float, length: float, x: float, y: float, z: float) -> Three:
    """Return X^T (x, y, z): a wrench at a joint, at the front joint of the link in front; c, s of the joint's angle."""
    across = s * x + c * y
    return c * x - s * y, across, z + length * across


@merged
def congruent(m: Nine, c: float, s: float, length: float) -> Nine:
    """Return X^T m X of a matrix given row by row."""
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = m
    m00, m01 = c * m00 - s * m01, s * m00 + c * m01
    m10, m11 = c * m10 - s * m11, s * m10 + c * m11
    m20, m21 = c * m20 - s * m21, s * m20 + c * m21
    m02 += length * m01
    m12 += length * m11
    m22 += length * m21
    m00, m10, m20 = forward(c, s, length, m00, m10, m20)
    m01, m11, m21 = forward(c, s, length, m01, m11, m21)
    m02, m12, m22 = forward(c, s, length, m02, m12, m22)
    return m00, m01, m02, m10, m11, m12, m20, m21, m22


@merged
def turned(d: Nine, m: Nine, turn: float) -> Nine:
    """Return D - M N with N V = turn (v, -u, 0), by which V enters V'."""
    return (
        d[0] + turn * m[1], d[1] - turn * m[0], d[2],
        d[3] + turn * m[4], d[4] - turn * m[3], d[5],
        d[6] + turn * m[7], d[7] - turn * m[6], d[8],
    )  # fmt: skip


@merged
def summed(a: Nine, b: Nine) -> Nine:
    """Return a + b."""
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5], a[6] + b[6], a[7] + b[7],
        a[8] + b[8],
    )  # fmt: skip


@merged
def bent(d: Nine, m: Nine, u: float, v: float, w: float, au: float, av: float, aw: float) -> Three:
    """Return D dV - M dV'."""
    return (
        d[0] * u + d[1] * v + d[2] * w - m[0] * au - m[1] * av - m[2] * aw,
        d[3] * u + d[4] * v + d[5] * w - m[3] * au - m[4] * av - m[5] * aw,
        d[6] * u + d[7] * v + d[8] * w - m[6] * au - m[7] * av - m[8] * aw,
    )


@merged
def solver_of(m: Nine, columns: FloatArray, flexible: bool, out: FloatArray) -> None:
    """Write the numbers of `solve`; the acceleration of the deflection acts like that of the last joint."""
    k0, k1, k2, j = 0.0, 0.0, 0.0, 1.0
    if flexible:
        last = columns.shape[0] - 1
        k0 = -columns[last, ACCELERATION, 0]
        k1 = -columns[last, ACCELERATION, 1]
        k2 = -columns[last, ACCELERATION, 2]
        j = -columns[last, ACCELERATION, 3]
    m00 = m[0] - k0 * k0 / j
    m01 = m[1] - k0 * k1 / j
    m02 = m[2] - k0 * k2 / j
    m11 = m[4] - k1 * k1 / j
    m12 = m[5] - k1 * k2 / j
    m22 = m[8] - k2 * k2 / j
    c00 = m11 * m22 - m12 * m12
    c01 = m02 * m12 - m01 * m22
    c02 = m01 * m12 - m02 * m11
    scale = 1.0 / (m00 * c00 + m01 * c01 + m02 * c02)
    out[0], out[1], out[2] = scale * c00, scale * c01, scale * c02
    out[3] = scale * (m00 * m22 - m02 * m02)
    out[4] = scale * (m01 * m02 - m00 * m12)
    out[5] = scale * (m00 * m11 - m01 * m01)
    out[6], out[7], out[8], out[9] = k0, k1, k2, j


@merged
def solve(
    solver: FloatArray, flexible: bool, g0: float, g1: float, g2: float, torque: float
) -> tuple[float, float, float, float]:
    """Return the change of u', v', w' and of the deflection's acceleration that balances a change of the wrench."""
    if flexible:
        share = torque / solver[9]
        g0 -= solver[6] * share
        g1 -= solver[7] * share
        g2 -= solver[8] * share
    a0 = solver[0] * g0 + solver[1] * g1 + solver[2] * g2
    a1 = solver[1] * g0 + solver[3] * g1 + solver[4] * g2
    a2 = solver[2] * g0 + solver[4] * g1 + solver[5] * g2
    bend = 0.0
    if flexible:
        bend = (torque - solver[6] * a0 - solver[7] * a1 - solver[8] * a2) / solver[9]
    return a0, a1, a2, bend


@merged
def answer(
    solver: FloatArray, flexible: bool, g0: float, g1: float, g2: float, torque: float, out: FloatArray, row: int
) -> None:
    """Write `solve` into a row."""
    a0, a1, a2, bend = solve(solver, flexible, g0, g1, g2, torque)
    out[row, 0], out[row, 1], out[row, 2], out[row, 3] = a0, a1, a2, bend
