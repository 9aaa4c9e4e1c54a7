"""What a verdict goes by: eight numbers, each with its meaning; docs/battery.md has the error rates that they give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Most causes that are claimed together, and most mechanisms that something unexplained may be like.
LARGEST = 3


@dataclass(frozen=True)
class Thresholds:
    """What a verdict goes by.

    Attributes:
        alarm: something is wrong where the nominal model's p value is below this: 1.2 false alarms in a hundred.
        keep: a set of causes stays beside the best where its p value against it is not below this. A set is named only
            if chance explains as much with a p value below it.
        close: or where its sum of squares, adjusted for parameters, is less than this above the best: 2 ln 10.
        goodness: a set that fits worse than this in any of five tests leaves something. A true one does by chance in 25
            of a thousand cases at most; more often because its form differs a little from the catalogue's. Of 29 true
            sets one has a least p value below 0.02, 0.003; of 16 sets that were named where the true mechanism was not
            in the catalogue four have one between 0.001 and 0.005 (docs/notes/045). A set fails, too, that loses on the
            held-out trials what a true one would lose with a probability below this.
        remaining: share of all there was to explain that a set may leave: a cause's form is a model, too. Several
            causes may leave no more even where no test sees it. A set fails whose error on the held-out trials is
            larger by this share than without it.
        exact: the same where all mechanisms are numbers without a form, or a form is learned: there is no other one
            that could leave it.
        resembles: up to this share, a set is like the truth if nothing else is. A pair that leaves more gets no third
            cause.
        tenfold: rivals of a set that leaves something may leave so many times its share: two lags of a servo left
            7e-6, and a clock 0.5 %. A set fails whose mean speed on the held-out trials is so many times further off
            than without it: 0.0143 in place of 0.0008 m/s, of a measured fish (docs/notes/046).
    """

    alarm: float = 0.012
    keep: float = 0.05
    close: float = 2.0 * float(np.log(10.0))
    goodness: float = 5e-3
    remaining: float = 0.1
    exact: float = 0.03
    resembles: float = 1.0 / 3.0
    tenfold: float = 10.0


THRESHOLDS = Thresholds()
