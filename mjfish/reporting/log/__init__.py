"""Logs for the rerun viewer: the swimming fish in 3-D, the forces on its links, velocities and residuals over time.

The only package that imports rerun.
"""

from mjfish.reporting.log.reading import view
from mjfish.reporting.log.recording import write_runs
from mjfish.reporting.log.results import write_log
from mjfish.reporting.log.scene import Run, Swim

__all__ = ["Run", "Swim", "view", "write_log", "write_runs"]
