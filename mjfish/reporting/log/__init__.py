"""Logs for the rerun viewer: the swimming fish in 3-D, the forces on its links, velocities and residuals over time.

The only package that imports rerun.
"""

from mjfish.reporting.log.of_diagnosis import write_diagnosis_log
from mjfish.reporting.log.of_rollout import write_rollout_log
from mjfish.reporting.log.recording import write_log
from mjfish.reporting.log.scene import Run, Swim
from mjfish.reporting.log.viewer import view

__all__ = ["Run", "Swim", "view", "write_diagnosis_log", "write_log", "write_rollout_log"]
