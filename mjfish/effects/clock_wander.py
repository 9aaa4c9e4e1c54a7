"""A drive whose clock gains and loses time at random."""

from __future__ import annotations

import numpy as np

from mjfish.data import Dataset
from mjfish.drive.motion import JointMotion
from mjfish.drive.walk import count, walked
from mjfish.effects.effect import Effect, Values
from mjfish.parameters import Parameter


class ClockWander(Effect):
    """The clock of the drive wanders: what is due at t + w(t) is done at t, w a random walk, <w^2> = size^2 t.

    The phase of a beat of frequency f wanders by 2 pi f w. A controller under load does that, or a servo without a
    crystal. The walk of the next run is not known, only its size. So a diagnosis does not refit this cause as it does
    others: it estimates the size as a part of the noise (`mjfish.estimation.marginal_likelihood`). In a simulation
    `draw` is the seed of the walk; `generate` draws one for every run.
    """

    name = "clock_wander"
    domain = "drive"
    random = True
    summary = "the clock of the drive wanders at random"
    parameters = (
        Parameter("clock_wander.size", "s^0.5", 0.0, 0.0, 0.3, 0.0, 0.005, about="rms of w after a second"),
        Parameter("clock_wander.draw", "-", 0.0, 0.0, 2.0**31, 0.0, 1.0, about="which walk", shape=True),
    )
    source = "Demir, Mehrotra and Roychowdhury, IEEE Trans. Circuits Syst. I 47 (2000): phase noise"
    signature = "the phase of the beat moves to and fro within a run, otherwise in every run"
    confirm = "log the command with the time stamps of the camera, or blink a light with every beat"
    resembles = ("clock-drift", "clock-jump", "repeats-differ")

    def not_applicable(self, dataset: Dataset) -> str:
        """Velocities show it."""
        blind = "" if any(t.measured.any() for t in dataset.trials) else "no velocity was measured, in which it shows"
        return super().not_applicable(dataset) or blind

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """Return the draw of a run."""
        return {"draw": float(rng.integers(2**31))}

    def drive(self, motion: JointMotion, values: Values) -> JointMotion:
        """Ask for the motion of t + w(t) at t."""
        many = count(float(motion.time[-1] - motion.time[0]))
        draw = np.random.default_rng(int(values["draw"])).standard_normal(many)
        return walked(motion, tuple(map(float, values["size"] * draw)))
