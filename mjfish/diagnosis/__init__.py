"""Diagnosis: is anything wrong, where, which cause, and what naming it gains."""

from mjfish.diagnosis.diagnosis import diagnose
from mjfish.diagnosis.result import Candidate, Cause, Diagnosis, Estimate, FittedModel, Overlay, SensorOverlay
from mjfish.diagnosis.splits import Share, Split, SplitMechanism, Splits, diagnose_splits

__all__ = [
    "Candidate",
    "Cause",
    "Diagnosis",
    "Estimate",
    "FittedModel",
    "Overlay",
    "SensorOverlay",
    "Share",
    "Split",
    "SplitMechanism",
    "Splits",
    "diagnose",
    "diagnose_splits",
]
