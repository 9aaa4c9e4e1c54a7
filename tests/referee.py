"""A slow second referee of the swimming model: total momentum in the world frame, plain NumPy, nothing of `mjfish.ode`.

It knows no acceleration and no recursion of forces. The state is the linear and angular momentum of body and water
about the world's origin; at each instant the velocities are those that give this momentum:

    P = sum of m v over centres of mass + INT m_a q n dr                 H = the same with arms + sum I_i alpha_i'
    P' = drag forces       H' = moments of the drag + (1 - kappa) sum_i u_i INT m_a q dr

with q the velocity of a strip along its normal n and u_i that of its link along its axis. The last term is what a
Morison slice (kappa = 0) does not give back to the body: the rate of INT r x (m_a q n) contains
r' x (m_a q n) = u m_a q, and the moment of the slice's force about a fixed point lacks it. Momentum is continuous where
joint rates jump, so a jump needs no equation at all: the run is cut there and goes on.

With a flexible tail the angular momentum L of the last link about its joint joins the state,
L' = moment of the drag - u (m c alpha' + kappa INT m_a q dr) - k delta - c delta'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mjfish.drive.cpg import DriveSegment
from mjfish.fish import Fish

Array = NDArray[np.float64]
#: Gauss points on each smooth piece of each link.
POINTS = 128


@dataclass(frozen=True)
class Strips:
    """Strips of the whole fish: `link` they belong to, `r` behind its joint, and coefficients per strip."""

    link: NDArray[np.int64]
    r: Array
    added: Array  # m_a dr [kg]
    across: Array  # rho c_d h dr / 2 [kg/m]
    along: Array  # rho c_f p dr / 2 [kg/m]


def cut(fish: Fish) -> Strips:
    """Cut the fish into strips, from the sections and coefficients of its TOML."""
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    rows = []
    start = 0.0
    for index, link in enumerate(fish.links):
        end = start + link.length
        for section in fish.sections:
            a, b = max(start, section.start), min(end, section.end)
            if b - a < 1e-9:
                continue
            station = 0.5 * (a + b) + 0.5 * (b - a) * points
            s = (station - section.start) / (section.end - section.start)
            s = np.sqrt(s * (2.0 - s)) if section.profile == "elliptic" else s
            h = (1.0 - s) * section.height[0] + s * section.height[1]
            w = (1.0 - s) * section.width[0] + s * section.width[1]
            ring = np.pi / 2.0 * (3.0 * (h + w) - np.sqrt((3.0 * h + w) * (h + 3.0 * w)))
            dr = 0.5 * (b - a) * weights
            c_m, c_d, c_f = (fish.values[f"{kind}.{link.group}"] for kind in ("c_m", "c_d", "c_f"))
            half = 0.5 * fish.density
            columns = (station - start, 0.25 * np.pi * fish.density * c_m * h * h * dr, half * c_d * h * dr)
            rows.append(np.stack([np.full(POINTS, index), *columns, half * c_f * ring * dr]))
        start = end
    table = np.concatenate(rows, axis=1)
    return Strips(table[0].astype(np.int64), *table[1:])


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


class Referee:
    """One fish and its momentum; states are [zeta, psi, x, y, yaw, P_x, P_y, H (, delta, L)] in the model's frame."""

    def __init__(self, fish: Fish) -> None:
        self.fish = fish
        self.strips = cut(fish)
        self.flexible = fish.tail_compliance > 0.0
        self.joints = fish.joints
        self.mass, self.com, self.inertia, self.length = (
            np.array([getattr(link, name) for link in fish.links]) for name in ("mass", "com", "inertia", "length")
        )

    def oscillators(self, state: Array, segment: DriveSegment) -> tuple[Array, Array]:
        """Return the rates of zeta and psi, [Yu2016] eq. (20)."""
        cpg = self.fish.cpg
        assert cpg is not None
        n = self.joints
        zeta, d = state[:n], state[n : 2 * n] - np.array(segment.bias)
        growth = np.array(cpg.amplitude) - zeta**2 - d**2
        cos, sin = np.cos(cpg.phase), np.sin(cpg.phase)
        front = np.concatenate([[0.0], zeta[:-1] * cos + d[:-1] * sin])
        behind = np.concatenate([zeta[1:] * sin + d[1:] * cos, [0.0]])
        return -segment.omega * d + zeta * growth + cpg.h1 * front, segment.omega * zeta + d * growth + cpg.h2 * behind

    def shape(self, pose: Array, angle: Array) -> tuple[Array, Array, Array]:
        """Return axes, normals and joints of all links (n, 2) in the world."""
        alpha = pose[2] + np.concatenate([[0.0], np.cumsum(angle)])
        axis = np.stack([np.cos(alpha), np.sin(alpha)], axis=1)
        normal = np.stack([-np.sin(alpha), np.cos(alpha)], axis=1)
        joint = pose[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(self.length[:-1, None] * axis[:-1], axis=0)])
        return axis, normal, joint

    def origins(self, normal: Array, nose: Array, turn: Array) -> Array:
        """Return velocities (k, n, 2) of the joints from that of the nose (k, 2) and the turn rates of links (k, n)."""
        step = (turn * self.length)[:, :-1, None] * normal[:-1]
        return np.concatenate([nose[:, None], nose[:, None] + np.cumsum(step, axis=1)], axis=1)

    def momentum(self, shape: tuple[Array, Array, Array], nose: Array, turn: Array) -> Array:
        """Return P_x, P_y, H and L of the last link (k, 4), summed over centres of mass and strips."""
        axis, normal, joint = shape
        origin = self.origins(normal, nose, turn)
        body = self.mass[:, None] * (origin + (turn * self.com)[..., None] * normal)  # (k, n, 2)
        centre = joint + self.com[:, None] * axis
        s = self.strips
        across = np.sum(origin * normal, axis=2)[:, s.link] + turn[:, s.link] * s.r
        water = (s.added * across)[..., None] * normal[s.link]  # (k, strips, 2)
        place = joint[s.link] + s.r[:, None] * axis[s.link]
        total = body.sum(axis=1) + water.sum(axis=1)
        spin = _cross(centre, body).sum(axis=1) + turn @ self.inertia + _cross(place, water).sum(axis=1)
        own = s.link == self.joints
        last = (
            self.com[-1] * np.sum(body[:, -1] * normal[-1], axis=1)
            + turn[:, -1] * self.inertia[-1]
            + np.sum((s.added * across * s.r)[:, own], axis=1)
        )
        return np.stack([total[:, 0], total[:, 1], spin, last], axis=1)

    def velocities(self, shape: tuple[Array, Array, Array], rate: Array, held: Array) -> Array:
        """Return x', y', yaw' (, delta') that give the momentum `held` (3 or 4,)."""
        size = len(held)
        unknown = np.concatenate([np.zeros((1, size)), np.eye(size)])
        turn = np.repeat(unknown[:, 2:3], self.joints + 1, axis=1)
        turn[0] += np.concatenate([[0.0], np.cumsum(rate)])
        if self.flexible:
            turn[:, -1] += unknown[:, 3]
        found = self.momentum(shape, unknown[:, :2], turn)[:, :size]
        return np.asarray(np.linalg.solve(found[1:].T, held - found[0]))

    def forces(self, shape: tuple[Array, Array, Array], nose: Array, turn: Array) -> Array:
        """Return the rates of P_x, P_y, H and L (4,) by drag and by what the Morison slice keeps back."""
        axis, normal, joint = shape
        origin = self.origins(normal, nose[None], turn[None])[0]
        s = self.strips
        u = np.sum(origin * axis, axis=1)
        q = np.sum(origin * normal, axis=1)[s.link] + turn[s.link] * s.r
        along, across = -s.along * (np.abs(u) * u)[s.link], -s.across * np.abs(q) * q
        force = along[:, None] * axis[s.link] + across[:, None] * normal[s.link]
        place = joint[s.link] + s.r[:, None] * axis[s.link]
        kept = u[s.link] * s.added * q
        kappa = self.fish.munk_moment
        own = s.link == self.joints
        last = np.sum((across * s.r)[own]) - u[-1] * self.mass[-1] * self.com[-1] * turn[-1] - kappa * np.sum(kept[own])
        return np.array([*force.sum(axis=0), np.sum(_cross(place, force)) + (1.0 - kappa) * np.sum(kept), last])

    def motion(self, state: Array, segment: DriveSegment) -> tuple[tuple[Array, Array, Array], Array, Array]:
        """Return shape, joint rates and x', y', yaw' (, delta') at a state."""
        cpg = self.fish.cpg
        assert cpg is not None
        n = self.joints
        gain = cpg.beta * cpg.unit
        angle, rate = gain * state[n : 2 * n], gain * self.oscillators(state, segment)[1]
        held = state[2 * n + 3 : 2 * n + 6]
        if self.flexible:
            angle = angle + np.concatenate([np.zeros(n - 1), [state[2 * n + 6]]])
            held = np.append(held, state[2 * n + 7])
        shape = self.shape(state[2 * n : 2 * n + 3], angle)
        return shape, rate, self.velocities(shape, rate, held)

    def derivative(self, state: Array, segment: DriveSegment) -> Array:
        """Return the rate of the state."""
        shape, rate, moving = self.motion(state, segment)
        turn = moving[2] + np.concatenate([[0.0], np.cumsum(rate)])
        zeta, psi = self.oscillators(state, segment)
        if not self.flexible:
            return np.concatenate([zeta, psi, moving, self.forces(shape, moving[:2], turn)[:3]])
        turn[-1] += moving[3]
        gained = self.forces(shape, moving[:2], turn)
        spring = state[-2] / self.fish.tail_compliance + self.fish.tail_damping * moving[3]
        return np.concatenate([zeta, psi, moving[:3], gained[:3], [moving[3], gained[3] - spring]])

    def start(self, segment: DriveSegment) -> Array:
        """Return the state at rest in the water while the joints begin to move."""
        n = self.joints
        state = np.concatenate([np.full(n, 0.1), segment.bias, np.zeros(8 if self.flexible else 6)])
        shape, rate, _ = self.motion(state, segment)
        turn = np.concatenate([[0.0], np.cumsum(rate)])
        held = self.momentum(shape, np.zeros((1, 2)), turn[None])[0]
        state[2 * n + 3 : 2 * n + 6] = held[:3]
        if self.flexible:
            state[-1] = held[3]
        return state


def swim(fish: Fish, segments: tuple[DriveSegment, ...], time: Array, rtol: float = 1e-8) -> Array:
    """Return surge, sway, yaw rate, x, y, yaw (, delta) (m, 6 or 7) at `time` (m,); after a jump where one is hit."""
    referee = Referee(fish)
    state = referee.start(segments[0])
    ends = [*(segment.start for segment in segments[1:]), np.inf]
    rows = []
    for segment, end in zip(segments, ends, strict=True):
        at = time[(time >= segment.start - 1e-12) & (time < end - 1e-12)]
        stop = min(end, time[-1])
        outcome = solve_ivp(
            lambda _t, y, now=segment: referee.derivative(y, now),
            (segment.start, stop),
            state,
            method="DOP853",
            t_eval=np.unique(np.append(np.clip(at, segment.start, stop), stop)),
            rtol=rtol,
            atol=1e-3 * rtol,
        )
        assert outcome.success, outcome.message
        state = outcome.y[:, -1]
        rows += [_seen(referee, column, segment) for column in outcome.y.T[: len(at)]]
        if stop == time[-1]:
            break
    return np.array(rows)


def _seen(referee: Referee, state: Array, segment: DriveSegment) -> Array:
    """Return the velocity of the nose and its pose in the forward frame: half a turn from the model's."""
    moving = referee.motion(state, segment)[2]
    n = referee.joints
    x, y, yaw = state[2 * n : 2 * n + 3]
    u = np.cos(yaw) * moving[0] + np.sin(yaw) * moving[1]
    v = np.cos(yaw) * moving[1] - np.sin(yaw) * moving[0]
    extra = [state[2 * n + 6]] if referee.flexible else []
    return np.array([-u, -v, moving[2], -x, -y, yaw, *extra])
