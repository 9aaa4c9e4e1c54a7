"""The model that is fitted: a fish and the effects that extend it; a trial in, predicted measurements out."""

from mjfish.model.model import (
    LEAD,
    MARGIN,
    Model,
    Prediction,
    Prepared,
    asked_motion,
    headed,
    joint_motion,
    numbered,
    pose_of,
)
from mjfish.model.sensitivity import sensitivities, with_sensors

__all__ = [
    "LEAD",
    "MARGIN",
    "Model",
    "Prediction",
    "Prepared",
    "asked_motion",
    "headed",
    "joint_motion",
    "numbered",
    "pose_of",
    "sensitivities",
    "with_sensors",
]
