"""The model that is fitted: a fish and the effects that extend it; a trial in, predicted measurements out."""

from mjfish.model.model import (
    LEAD,
    MARGIN,
    Model,
    Prediction,
    Prepared,
    headed,
    joint_motion,
    numbered,
    pose_of,
    requested_motion,
)
from mjfish.model.sensitivity import sensitivities, with_sensors

__all__ = [
    "LEAD",
    "MARGIN",
    "Model",
    "Prediction",
    "Prepared",
    "headed",
    "joint_motion",
    "numbered",
    "pose_of",
    "requested_motion",
    "sensitivities",
    "with_sensors",
]
