"""The nominal model once more, as one would write it in plain NumPy for scipy: the yardstick of `bench.py`.

State: V_0 (u, v, w) in the model's frame, x, y, yaw, then zeta and psi of the CPG. The equations are those of
`mjfish.ode.equation`, `mjfish.hydro.force` and `mjfish.drive.cpg`, link by link and matrix by matrix as [Yu2016] has
them, with the same exact integral of the drag.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mjfish.drive.cpg import ZETA_START
from mjfish.fish import Fish, frames
from mjfish.fish.outline import section_at
from mjfish.hydro.link import link_records

FloatArray = NDArray[np.float64]
#: Nodes a link of the table of cumulative moments of the height.
_NODES = 4001


class PlainLink:
    """One link: inertia of body and water, and the force of eq. (18) that velocities cause."""

    def __init__(self, fish: Fish, index: int) -> None:
        record = link_records(fish)[index]
        for name in ("mass", "com", "length", "density", "c_d", "c_f", "wetted"):
            setattr(self, name, float(record[name]))
        self.a0, self.a1, a2 = record["c_m"] * record["added"]
        mc, polar = self.mass * self.com, record["inertia"] + self.mass * self.com**2
        rigid = np.array([[self.mass, 0, 0], [0, self.mass, mc], [0, mc, polar]])
        water = np.array([[0, 0, 0], [0, self.a0, self.a1], [0, self.a1, a2]])
        self.inertia = rigid + water
        start = sum(link.length for link in fish.links[:index])
        self.station = self.length * np.linspace(0.0, 1.0, _NODES) ** 2  # dense where the nose is blunt
        middle = 0.5 * (self.station[:-1] + self.station[1:])
        strips = section_at(fish.sections, start + middle)[0] * np.diff(self.station)
        self.moments = np.zeros((4, _NODES))
        self.moments[:, 1:] = np.cumsum(strips * middle ** np.arange(4)[:, None], axis=1)

    def force(self, V: FloatArray) -> FloatArray:
        """Return drag minus gamma and gamma_ad, eqs. (9), (10), (13) and (15)."""
        u, v, w = V
        momentum = self.a0 * v + self.a1 * w
        gyroscopic = np.array(
            [w * (self.mass * (v + self.com * w) + momentum), -self.mass * w * u, -self.mass * self.com * w * u]
        )
        return gyroscopic + self.drag(u, v, w)

    def drag(self, u: float, v: float, w: float) -> FloatArray:
        """Return friction along and drag across."""
        weights = np.array([v * v, 2.0 * v * w, w * w])
        moments = self.moments[:, -1]
        sign = np.sign(v + 0.5 * w * self.length)
        if v * (v + w * self.length) < 0.0:
            moments = moments - 2.0 * np.array([np.interp(-v / w, self.station, row) for row in self.moments])
            sign = np.sign(w)
        half = 0.5 * self.density
        return np.array(
            [
                -half * self.c_f * self.wetted * np.abs(u) * u,
                -half * self.c_d * sign * (weights @ moments[:3]),
                -half * self.c_d * sign * (weights @ moments[1:]),
            ]
        )


class PlainModel:
    """The fish at a constant CPG frequency `omega` [rad/s], without bias."""

    def __init__(self, fish: Fish, omega: float) -> None:
        assert fish.cpg is not None  # noqa: S101 - the bench takes the pike
        self.cpg, self.omega = fish.cpg, omega
        self.amplitude = np.array(fish.cpg.amplitude)
        self.joints = fish.joints
        self.links = [PlainLink(fish, index) for index in range(len(fish.links))]

    def __call__(self, _time: float, state: FloatArray) -> FloatArray:
        """Return the time derivative of the state."""
        zeta, psi = state[6 : 6 + self.joints], state[6 + self.joints :]
        zeta_rate, psi_rate, psi_second = self._oscillators(zeta, psi)
        gain = self.cpg.beta * self.cpg.unit
        acceleration = self._head(state[:3], gain * psi, gain * psi_rate, gain * psi_second)
        cos, sin = np.cos(state[5]), np.sin(state[5])
        travel = [cos * state[0] - sin * state[1], sin * state[0] + cos * state[1], state[2]]
        return np.concatenate([acceleration, travel, zeta_rate, psi_rate])

    def _oscillators(self, zeta: FloatArray, psi: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rates of eq. (20) and the second rate of psi."""
        cos, sin = np.cos(self.cpg.phase), np.sin(self.cpg.phase)
        growth = self.amplitude - zeta**2 - psi**2
        zeta_rate = -self.omega * psi + zeta * growth
        psi_rate = self.omega * zeta + psi * growth
        zeta_rate[1:] += self.cpg.h1 * (zeta[:-1] * cos + psi[:-1] * sin)
        psi_rate[:-1] += self.cpg.h2 * (zeta[1:] * sin + psi[1:] * cos)
        second = self.omega * zeta_rate + psi_rate * growth - 2.0 * psi * (zeta * zeta_rate + psi * psi_rate)
        second[:-1] += self.cpg.h2 * (zeta_rate[1:] * sin + psi_rate[1:] * cos)
        return zeta_rate, psi_rate, second

    def _head(self, V: FloatArray, angle: FloatArray, rate: FloatArray, second: FloatArray) -> FloatArray:
        """Acceleration of the head, eq. (18)."""
        T, b = np.eye(3), np.zeros(3)
        M, Gamma = np.zeros((3, 3)), np.zeros(3)
        for i, link in enumerate(self.links):
            if i > 0:
                cos, sin, length = np.cos(angle[i - 1]), np.sin(angle[i - 1]), self.links[i - 1].length
                step = np.array([[cos, sin, sin * length], [-sin, cos, cos * length], [0.0, 0.0, 1.0]])
                T, V = step @ T, step @ V
                b = step @ b + np.array([rate[i - 1] * V[1], -rate[i - 1] * V[0], second[i - 1]])
                V = V + np.array([0.0, 0.0, rate[i - 1]])
            M += T.T @ link.inertia @ T
            Gamma += T.T @ (link.inertia @ b - link.force(V))
        return np.linalg.solve(M, -Gamma)

    def velocity(self, time: FloatArray, rtol: float = 1e-6) -> FloatArray:
        """Return surge, sway, yaw rate (n, 3) at `time`, from rest, by `solve_ivp` (RK45)."""
        start = np.concatenate([np.zeros(6), np.full(self.joints, ZETA_START), np.zeros(self.joints)])
        solution = solve_ivp(self, (0.0, float(time[-1])), start, method="RK45", rtol=rtol, t_eval=time)
        return frames.flip(solution.y[:3].T)
