"""The walk of the drive's clock as a row of the table: a random cause, whose size is a part of the noise.

All candidates are compared beside it. Its evidence is twice the marginal log-likelihood that it gains. It predicts no
run better, for nobody knows the walk of the next one: so it has no held-out figures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mjfish.diagnosis.estimate import Estimate
from mjfish.diagnosis.evidence import Evidence
from mjfish.diagnosis.table import Row
from mjfish.effects.clock_wander import ClockWander
from mjfish.estimation.clock_wander import log_likelihood_gained, walk_size
from mjfish.estimation.fit import Z95


def random_causes(evidence: Evidence, p_wrong: float) -> tuple[Row, ...]:
    """Return the row of the walk that is a part of the nominal fit; none where there is none.

    Args:
        evidence: at the fit of the nominal model.
        p_wrong: p value of the nominal model beside the walk.
    """
    problem, found = evidence.problem, evidence.fit
    if not problem.walk:
        return ()
    size, determined = walk_size(problem, found)
    left, rank = evidence.omnibus
    gain = 2.0 * log_likelihood_gained(problem, found)
    half = Z95 / np.sqrt(2.0 * determined)  # of the logarithm of an sd
    low, high = size * float(np.exp(-half)), size * float(np.exp(half))
    row = replace(
        Row.apart(ClockWander.name, ClockWander.summary, ClockWander.mechanism, gain, found.status),
        tests={"candidates and waves": p_wrong},
        excess=max(left - rank, 0.0),
        rank=rank,
        sizes={ClockWander.parameters[0].name: Estimate(size, low, high, ClockWander.parameters[0].unit)},
    )
    return (row,)
