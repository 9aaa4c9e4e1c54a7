"""Roll learned from the data: what drives it, what it takes of the drag, and what the camera reads of it."""

from __future__ import annotations

from mjfish.data import Trial
from mjfish.effects.effect import Values
from mjfish.effects.roll import Roll
from mjfish.effects.roll_loss import RollLoss
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter
from mjfish.parameters.prior import Prior, about


class RollLaw(RollLoss):
    """The body rolls, its drag across falls to cos^2 phi, and a marker at the height z goes with it.

    The lean phi = lambda psi is that of `RollLoss`, driven by the side force and by the acceleration of the nose,

        psi'' + 2 zeta omega psi' + omega^2 psi = omega^2 (F / (m g) + mu (sway' + yaw_rate surge) / g),

    with shares kappa of the added momentum in F and mu of the acceleration. What the camera reads is that of `Roll`.
    """

    name = "roll_law"
    learned = True
    summary = "the fish rolls; what drives it and what it does are learned"
    parameters = (
        Parameter("roll_law.square", "-", 0.0, 0.0, 400.0, 0.0, 0.3, about="lambda^2, of the lean by the side force"),
        Parameter(
            "roll_law.frequency", "rad/s", 8.0, 1.0, 60.0, 8.0, 1.0, about="natural frequency of the roll", shape=True
        ),
        Parameter("roll_law.damping", "-", 0.3, 0.02, 3.0, 0.3, 0.05, about="damping ratio of the roll", shape=True),
        Parameter("roll_law.inertial", "-", 0.5, 0.0, 1.0, 0.5, 0.2, about="kappa, of the added momentum", shape=True),
        Parameter("roll_law.nose", "-", 0.0, -20.0, 20.0, 0.0, 0.2, about="mu, of the nose's acceleration", shape=True),
        Parameter("roll_law.height", "m", 0.0, -0.2, 0.2, 0.0, 0.003, about="of the marker above the roll axis"),
    )
    signature = "sway and yaw rate too small where the beat is strong, or sway off near one frequency"

    def constants(self, trial: Trial) -> tuple[float, ...]:
        """Return the weight, behind its own mu and height."""
        del trial
        return (self.weight,)

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Take the speed of the marker about the roll axis off the sway."""
        return Roll().reading(state, values, trial) if values["height"] != 0.0 else state

    def like(self, formula: str, values: Values) -> dict[str, float]:
        """Return this roll at the numbers of a formula."""
        if formula == "roll_loss":
            return {**values, "nose": 0.0, "height": 0.0}
        return {**values, "square": 0.0, "nose": 0.0} if formula == "roll" else {}

    def priors(self) -> tuple[Prior, ...]:
        """Say of which order the numbers of the roll are."""
        ranges = {"frequency": (10.0, 10.0), "damping": (0.4, 0.5), "inertial": (0.5, 0.5), "nose": (0.0, 5.0)}
        return tuple(about(f"roll_law.{k}", [f"roll_law.{k}"], *of) for k, of in ranges.items())
