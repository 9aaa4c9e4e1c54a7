"""Diagnosis: is anything wrong, where, which cause, and what naming it gains."""

from mjfish.diagnose.diagnosis import diagnose
from mjfish.diagnose.result import Candidate, Cause, Diagnosis, Estimate, Overlay

__all__ = ["Candidate", "Cause", "Diagnosis", "Estimate", "Overlay", "diagnose"]
