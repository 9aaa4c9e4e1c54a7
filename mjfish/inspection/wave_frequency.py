"""A wave whose stated frequency is not that of the beat."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mjfish.data import Trial
from mjfish.estimation.clocks import beat
from mjfish.inspection.finding import Finding


def wave_frequencies(trials: Sequence[Trial]) -> Iterator[Finding]:
    """Yield a finding for every wave of its own clock that the fish beats faster or slower than."""
    for trial in trials:
        found = beat(trial)
        if trial.wave is None or found is None:
            continue
        yield Finding(
            code="wave-frequency",
            severity="suspect",
            place=f"trial {trial.name}",
            found=f"the frequency of the drive is {trial.wave.frequency:.3g} Hz, the fish beats at {found:.3g} Hz",
            expected="the same frequency",
            remedy="correct the frequency of the drive; meanwhile it is taken to be that of the beat",
            trials=(trial.name,),
        )
