"""Joint angles by inverse kinematics of the tail, all frames of a stretch together.

Markers of the tail, k = link of marker m, e(psi) the direction of a link towards the tail:

    p_m = h + o + sum_{j<k} l_j e(psi_j) + r_m e(psi_k) [+ a e(psi_5) + d, for the marker of the fin]

h is the first hinge as the head has it. The tail does not hang together with it in the image: it appears shifted by
up to 50 mm, constant in the world and not in the body, which is what parallax, refraction and a tilted camera do. So
the shift o is free in each frame, near a straight line in time. The marker of the fin sits 50 mm higher than those of
the plates and is shifted once more, by d; its place on the fin, a, changes from run to run. With the lengths known, a
direction that swings through 60 degrees tells d from a turn of the fin: the tip draws a circle about d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mjfish.arrays import FloatArray
from mjfish.fish import Fish
from mjfish.importers.fishsim.markers import STATIONS, TAIL, TAIL_LINK

#: Spread of the shift of the tail about its line, frame by frame [m].
_SHIFT_SPREAD = 0.008
#: Spread of joint angles about zero, and of their differences from joint to joint [rad]. Wide; they only keep a zigzag
#: of neighbours, to which the markers are almost blind, from growing with the noise.
_ANGLE_SPREAD, _ZIGZAG_SPREAD = 0.7, 0.25
#: Beliefs about shift of the tail and its drift, shift of the fin's marker and its drift, place on the fin [m].
_BELIEF = np.array([0.05] * 4 + [0.03] * 4 + [0.01])
#: The errors of neighbouring frames are alike: a stretch counts as this many independent looks at what is constant.
_LOOKS = 20.0
#: Of the markers, to begin with; then it is estimated [m].
_SIGMA, _LEAST_SIGMA = 1e-3, 1e-4
_PASSES, _STEPS, _LARGEST_TURN = 4, 8, 0.4


@dataclass(frozen=True, eq=False)
class TailTrack:
    """The tail, frame by frame.

    Attributes:
        joint_angle: (n, 5) [rad].
        sigma: (5,) of the joint angles, by the spread of the markers about the chain [rad].
        misfit: rms of the markers about the chain [m].
        shift: (2,) mean shift of the tail against the head, world [m].
        fin_shift: (2,) mean shift of the fin's marker against the tail, world [m].
    """

    joint_angle: FloatArray
    sigma: FloatArray
    misfit: float
    shift: FloatArray
    fin_shift: FloatArray


@dataclass(frozen=True, eq=False)
class _Chain:
    """Levers (markers, links) [m] of the directions in each marker; the links that carry them."""

    lever: FloatArray
    carrier: tuple[int, ...]

    @classmethod
    def of(cls, fish: Fish, markers: tuple[int, ...]) -> _Chain:
        hinge = np.cumsum([link.length for link in fish.links])[:-1]
        lever = np.zeros((len(markers), fish.joints))
        carrier = tuple(TAIL_LINK[TAIL.index(marker)] - 1 for marker in markers)
        for row, (marker, link) in enumerate(zip(markers, carrier, strict=True)):
            lever[row, :link] = np.diff(hinge)[:link]
            lever[row, link] = STATIONS[marker] - hinge[link]
        return cls(lever, carrier)


def track(fish: Fish, position: FloatArray, pose: FloatArray, left_out: int | None) -> TailTrack:
    """Find the joint angles of one stretch.

    Args:
        fish: `eth_tendon`; its link lengths are used.
        position: (n, 9, 2) of all markers [m].
        pose: (n, 3) of the nose, smoothed [m, m, rad].
        left_out: a marker that is not used.
    """
    markers = tuple(marker for marker in TAIL if marker != left_out)
    chain = _Chain.of(fish, markers)
    behind = pose[:, 2] + np.pi
    hinge = pose[:, :2] + fish.links[0].length * _direction(behind)
    seen = position[:, list(markers)] - hinge[:, None]
    state = _State.start(seen, behind, chain)
    sigma = _SIGMA
    for _ in range(_PASSES):
        for _ in range(_STEPS):
            blocks = _Blocks.of(state, chain, seen, behind, sigma)
            state = state.moved(*blocks.step(state.common))
        left = sigma * _Blocks.of(state, chain, seen, behind, sigma).residual[:, : 2 * len(markers)]
        free = 2 * len(markers) - state.psi.shape[1] - 2
        sigma = max(float(np.sqrt(np.square(left).sum() / (free * len(left)))), _LEAST_SIGMA)
    covariance = _Blocks.of(state, chain, seen, behind, sigma).covariance()
    relative = _relative(chain.lever.shape[1])
    return TailTrack(
        joint_angle=np.diff(state.psi, axis=1, prepend=behind[:, None]),
        sigma=np.sqrt(np.einsum("ij,njk,ik->ni", relative, covariance, relative).mean(axis=0)),
        misfit=float(np.sqrt(np.square(left).mean())),
        shift=state.common[:2].copy(),
        fin_shift=state.common[4:6].copy(),
    )


def _direction(angle: FloatArray) -> FloatArray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _relative(joints: int) -> FloatArray:
    """Return the matrix that turns directions of links into joint angles (the head's direction apart)."""
    return np.asarray(np.eye(joints) - np.eye(joints, k=-1))


@dataclass(frozen=True, eq=False)
class _State:
    """Directions psi (n, 5), shifts o (n, 2), and what all frames share: shift, drift, fin's shift, drift, place."""

    psi: FloatArray
    shift: FloatArray
    common: FloatArray

    @classmethod
    def start(cls, seen: FloatArray, behind: FloatArray, chain: _Chain) -> _State:
        """Start from a straight tail along the plates."""
        along = seen[:, -2] - seen[:, 0]
        turn = np.angle(np.exp(1j * (np.arctan2(along[:, 1], along[:, 0]) - behind)))
        psi = np.repeat((behind + turn)[:, None], chain.lever.shape[1], axis=1)
        return cls(psi, np.zeros((len(seen), 2)), np.zeros(len(_BELIEF)))

    def moved(self, frame: FloatArray, common: FloatArray) -> _State:
        links = self.psi.shape[1]
        turn = np.clip(frame[:, :links], -_LARGEST_TURN, _LARGEST_TURN)
        return _State(self.psi + turn, self.shift + frame[:, links:], self.common + common)


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Residuals (n, rows) and their derivatives by a frame's own unknowns (n, rows, 7) and the common ones."""

    residual: FloatArray
    own: FloatArray
    shared: FloatArray

    @classmethod
    def of(cls, state: _State, chain: _Chain, seen: FloatArray, behind: FloatArray, sigma: float) -> _Blocks:
        parts = [_markers(state, chain, seen, sigma), _shifts(state), _angles(state, behind)]
        return cls(*(np.concatenate(part, axis=1) for part in zip(*parts, strict=True)))

    def step(self, common: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the Gauss-Newton step of all frames' unknowns (n, 7) and the common ones, by Schur's complement."""
        normal = np.einsum("nij,nik->njk", self.own, self.own)
        mixed = np.einsum("nij,nik->njk", self.own, self.shared)
        right = np.einsum("nij,ni->nj", self.own, self.residual)
        belief = len(self.residual) / _LOOKS / np.square(_BELIEF)
        inner = np.einsum("nij,nik->jk", self.shared, self.shared) + np.diag(belief)
        right_common = np.einsum("nij,ni->j", self.shared, self.residual) + belief * common
        solved = np.linalg.solve(normal, np.concatenate([mixed, right[..., None]], axis=2))
        inner -= np.einsum("nij,nik->jk", mixed, solved[..., :-1])
        right_common -= np.einsum("nij,ni->j", mixed, solved[..., -1])
        shared = -np.linalg.solve(inner, right_common)
        return -solved[..., -1] - solved[..., :-1] @ shared, shared

    def covariance(self) -> FloatArray:
        """Return the covariance of the directions in each frame (n, 5, 5) [rad2]."""
        links = self.own.shape[2] - 2
        return np.asarray(np.linalg.inv(np.einsum("nij,nik->njk", self.own, self.own))[:, :links, :links])


def _share(frames: int) -> FloatArray:
    return np.linspace(-1.0, 1.0, frames)


def _markers(state: _State, chain: _Chain, seen: FloatArray, sigma: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Markers where the chain has them, minus where they are seen, in units of sigma."""
    frames, markers, _ = seen.shape
    links = chain.lever.shape[1]
    towards = _direction(state.psi)
    across = _direction(state.psi + 0.5 * np.pi)
    place = float(state.common[8])
    lever = chain.lever + place * np.outer(np.arange(markers) == markers - 1, np.arange(links) == links - 1)
    own = np.zeros((frames, markers, 2, links + 2))
    own[..., :links] = np.einsum("mk,nki->nmik", lever, across)
    own[..., 0, links] = own[..., 1, links + 1] = 1.0
    shared = np.zeros((frames, markers, 2, len(state.common)))
    for axis in range(2):
        shared[:, -1, axis, 4 + axis] = 1.0
        shared[:, -1, axis, 6 + axis] = _share(frames)
    shared[:, -1, :, 8] = towards[:, -1]
    placed = np.einsum("mk,nki->nmi", chain.lever, towards) + state.shift[:, None] + shared @ state.common
    return (
        (placed - seen).reshape(frames, -1) / sigma,
        own.reshape(frames, 2 * markers, -1) / sigma,
        shared.reshape(frames, 2 * markers, -1) / sigma,
    )


def _shifts(state: _State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shifts of the tail minus their line, in units of their spread."""
    frames, links = state.psi.shape
    own, shared = np.zeros((frames, 2, links + 2)), np.zeros((frames, 2, len(state.common)))
    for axis in range(2):
        own[:, axis, links + axis] = 1.0
        shared[:, axis, axis] = -1.0
        shared[:, axis, 2 + axis] = -_share(frames)
    residual = state.shift + shared @ state.common
    return residual / _SHIFT_SPREAD, own / _SHIFT_SPREAD, shared / _SHIFT_SPREAD


def _angles(state: _State, behind: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint angles and their differences, in units of their spreads."""
    frames, links = state.psi.shape
    relative = _relative(links)
    rows = np.concatenate([relative / _ANGLE_SPREAD, np.diff(relative, axis=0) / _ZIGZAG_SPREAD])
    residual = (state.psi - behind[:, None]) @ rows.T
    own = np.zeros((frames, len(rows), links + 2))
    own[..., :links] = rows
    return residual, own, np.zeros((frames, len(rows), len(state.common)))
