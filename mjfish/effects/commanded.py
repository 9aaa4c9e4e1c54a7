"""What the causes of family ``drive`` have in common: they stand between the command and the joints."""

from __future__ import annotations

from mjfish.trial import Dataset


def nothing_between(dataset: Dataset) -> str:
    """Say that measured joint angles leave nothing between command and joint, where every trial has them."""
    if all(trial.joint_angle is not None for trial in dataset.trials):
        return "the joint angles were measured, so no servo stands between them and the model"
    return ""
