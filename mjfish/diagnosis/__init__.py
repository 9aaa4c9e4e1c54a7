"""Diagnosis: is anything wrong, where, which cause, and what naming it gains."""

from mjfish.diagnosis.diagnosis import diagnose
from mjfish.diagnosis.result import Candidate, Cause, Diagnosis, Estimate, FittedModel, Overlay

__all__ = ["Candidate", "Cause", "Diagnosis", "Estimate", "FittedModel", "Overlay", "diagnose"]
