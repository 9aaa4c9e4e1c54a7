"""Diagnosis: is anything wrong, where, which cause, and what naming it gains."""

from mjfish.diagnosis.diagnosis import diagnose
from mjfish.diagnosis.result import Candidate, Cause, Diagnosis, FittedModel, Overlay, SensorOverlay
from mjfish.diagnosis.splits import Share, Split, SplitMechanism, Splits, diagnose_splits
from mjfish.diagnosis.table import Estimate, Row, Table

__all__ = [
    "Candidate",
    "Cause",
    "Diagnosis",
    "Estimate",
    "FittedModel",
    "Overlay",
    "Row",
    "SensorOverlay",
    "Share",
    "Split",
    "SplitMechanism",
    "Splits",
    "Table",
    "diagnose",
    "diagnose_splits",
]
