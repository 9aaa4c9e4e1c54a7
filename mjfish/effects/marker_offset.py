"""A tracked point that is not the nose."""

from __future__ import annotations

import numpy as np

from mjfish.data import Dataset, Trial
from mjfish.effects.effect import Effect, Fingerprint, Values
from mjfish.fish import frames
from mjfish.fish.parameter_priors import ParameterPrior
from mjfish.numerics.arrays import FloatArray
from mjfish.parameters import Parameter

#: How well the place of a tracked point is known that nobody measured: share of the length of the head, sideways [m].
_SOMEWHERE, _ASIDE = 0.5, 0.01


class MarkerOffset(Effect):
    """The tracked point of the head lies at r_m = (along, across) from the nose: V_recorded = V + omega x r_m.

    In the forward frame, so `along` is positive AHEAD of the nose (a marker on the head has a negative one) and
    `across` is positive to port: surge_recorded = surge - omega across, sway_recorded = sway + omega along. The head
    is rigid, so the yaw rate is that of the nose. A recorded place is off by r_m from where its sensor is said to sit.

    In straight swimming `along` keeps the glide reflection and `across` breaks it; the fingerprint leaves it open.
    """

    name, domain, mechanism = "marker_offset", "data", "tracked_point"
    summary = "the tracked point is not the nose"
    parameters = (
        Parameter(
            "marker_offset.along", "m", 0.0, -0.5, 0.2, 0.0, 0.005, about="of the tracked point, ahead of the nose"
        ),
        Parameter("marker_offset.across", "m", 0.0, -0.1, 0.1, 0.0, 0.005, about="of the tracked point, to port"),
    )
    source = "Velocity of a point of a rigid body: Goldstein et al., Classical Mechanics (2002), sec. 4.9"
    signature = "surge or sway is off by a length times the yaw rate; nothing where the fish does not turn"
    confirm = "measure where the marker sits, or turn the fish by hand about its nose in the camera's view"
    fingerprint = Fingerprint(exponent=0.0, part="everywhere")

    def parameter_priors(self, dataset: Dataset) -> dict[str, ParameterPrior]:
        """Say that a point is somewhere on the head, where nobody said where it is."""
        if all(sensor.placed for trial in dataset.trials for sensor in trial.sensors):
            return {}
        along = _SOMEWHERE * dataset.fish.links[0].length
        return {
            "marker_offset.along": ParameterPrior(mean=0.0, sd=along),
            "marker_offset.across": ParameterPrior(mean=0.0, sd=_ASIDE),
        }

    def reading(self, state: FloatArray, values: Values, trial: Trial) -> FloatArray:
        """Add omega x r_m."""
        del trial
        read = state.copy()
        read[:, 0] -= values["across"] * state[:, 2]
        read[:, 1] += values["along"] * state[:, 2]
        return read

    def camera(
        self, time: FloatArray, place: FloatArray, heading: FloatArray, values: Values, trial: Trial
    ) -> tuple[FloatArray, FloatArray]:
        """Move the places by r_m, turned into the world."""
        del time, trial
        offset = np.broadcast_to([values["along"], values["across"]], place.shape)
        return place + frames.to_body(offset, -heading), heading
