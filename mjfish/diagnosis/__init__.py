"""Diagnosis: is anything wrong, where, which cause, and what naming it gains."""

from mjfish.diagnosis.diagnosis import diagnose
from mjfish.diagnosis.result import Candidate, Cause, Diagnosis, DiagnosisData, FittedModel, Overlay, SensorOverlay
from mjfish.diagnosis.saved import SavedDiagnosis, load_diagnosis
from mjfish.diagnosis.splits import Share, Split, SplitMechanism, Splits, diagnose_splits
from mjfish.diagnosis.table import Estimate, Row, Table

__all__ = [
    "Candidate",
    "Cause",
    "Diagnosis",
    "DiagnosisData",
    "Estimate",
    "FittedModel",
    "Overlay",
    "Row",
    "SavedDiagnosis",
    "SensorOverlay",
    "Share",
    "Split",
    "SplitMechanism",
    "Splits",
    "Table",
    "diagnose",
    "diagnose_splits",
    "load_diagnosis",
]
