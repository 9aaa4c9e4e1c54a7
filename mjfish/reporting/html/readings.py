"""How to read each figure of a page: what is shown, what looks good, what looks bad, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reading:
    """How to read a figure, a sentence each."""

    shown: str
    good: str
    bad: str
    do: str


STRETCH = Reading(
    "A few beats of the trial and the channel in which the nominal model errs most for its range: as measured, and as "
    "the models predict them. No held-out trial took part in the fits.",
    "The simulated curve lies on the measured one: with the cause where one is shown, and not without it.",
    "With the cause it is as far off as without it, or further.",
    "Look at the same trial below, in all channels, and at the residual over beat and speed.",
)
PATH = Reading(
    "The places that the camera saw in the run whose path the nominal model misses most, and those that the models "
    "predict. No held-out trial took part in the fits.",
    "The simulated path lies on the measured one: with the cause where one is shown, and not without it.",
    "With the cause it ends as far off as without it, or further.",
    "Look at the same trial below: places and heading over time, and what is left of them.",
)
CURVE = Reading(
    "A quantity of the model as the data have it (solid), its 95 % band, and the nominal model (dashed). Dotted and "
    "grey: no run has been there.",
    "A narrow band that leaves the nominal line where the curve is solid.",
    "A band as wide as the panel, or a short solid piece: the runs say little of the form.",
    "Use the curve where it is solid only. Record runs that reach the dotted range before you simulate there.",
)
TRIAL = Reading(
    "Left: velocities as measured and as simulated. Right: what is left, measured less simulated. Dotted lines: the "
    "drive changes. A gap in a simulated curve: no score is taken there, or the simulation diverged.",
    "What is left looks like noise about zero, in held-out trials as in fitted ones.",
    "It swings with the beat, drifts, or jumps where the drive changes.",
    "A swing or a jump is physics that the model lacks; one trial alone that is off may be a fault of its recording.",
)
BEAT = Reading(
    "The mean of measured less simulated by the phase of the last joint's beat, with two standard errors of "
    "independent samples, over the held-out trials, or over all where none is held out.",
    "A flat curve whose band holds zero.",
    "A wave: what is missing repeats with every beat, which noise does not.",
    "One wave a beat in surge or two in sway and yaw rate break the left-right symmetry: look for an offset of a "
    "joint, a marker or the camera. Others point to drive, body or water.",
)
SPEED = Reading(
    "The mean of measured less simulated by the surge that the nominal model has, in bins of equally many samples, "
    "with two standard errors of independent samples; of the same trials as over the beat.",
    "A flat curve whose band holds zero.",
    "A slope or a bend: the error depends on the speed. Slow noise makes the bands too narrow, not the curve bend.",
    "Suspect the forces of the water first; where only the lowest bins are off, the start of the runs.",
)
FORCE = Reading(
    "The force and the moment at the nose that would have moved the fitted nominal model as the fish moved, smoothed, "
    "with two standard deviations.",
    "A band that holds zero: nothing is missing that these data show.",
    "A force that repeats with the beat, or that lasts.",
    "Compare its size with the share in the table, and its times with what happened then in the trial.",
)
AUTOCORRELATION = Reading(
    "The autocorrelation of the residual over all trials (thick) and of each (thin). The band holds 99 % of the values "
    "over all trials where the residual is white.",
    "Thick curves inside the band at all lags above zero.",
    "Curves outside the band: intervals that take the residual for white are too narrow. The model may still be right.",
    "Take the intervals for correlated residuals, and diagnose the dataset to learn whether the model is at fault.",
)
CROSS_CORRELATION = Reading(
    "The cross-correlation of the residual with the command of the last joint, and with its square. The band holds "
    "99 % of the values where they are independent.",
    "Curves inside the band.",
    "Curves outside it: the model misses something that the drive does.",
    "Diagnose the dataset: mjfish diagnose names what is missing.",
)
PROFILE = Reading(
    "How much worse the best fit gets as one parameter is held elsewhere; the 95 % threshold, and the parabola that "
    "estimate and standard error stand for.",
    "A curve that follows the parabola and crosses the threshold on both sides.",
    "A curve that stays below the threshold: these data do not bound the parameter on that side.",
    "Take the interval of the profile where the two part; fix the parameter, or record runs that show it.",
)
