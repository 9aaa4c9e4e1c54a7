"""The picture of the first screen shows the beats on which the nominal model is worst."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.diagnosis import Diagnosis
from mjfish.reporting.html.misfit import stretch_figure, worst_stretch


def _off(found: Diagnosis, trial: int, channel: int, at: slice) -> Diagnosis:
    """Return the diagnosis with predictions of the nominal model that are right but for one place."""
    overlays = []
    for k, overlay in enumerate(found.overlays):
        nominal = overlay.trial.velocity.copy()
        if k == trial:
            nominal[at, channel] += 3.0
        overlays.append(replace(overlay, nominal=nominal))
    return replace(found, overlays=tuple(overlays))


@pytest.mark.parametrize("channel", [0, 2])
def test_the_place_that_is_off_is_found_by_channel_and_time(channel: int) -> None:
    found = _off(diagnosis(), 1, channel, slice(80, 90))
    stretch = worst_stretch(found)
    assert stretch.overlay is found.overlays[1]
    assert stretch.channel == ("surge", "sway", "yaw_rate")[channel]
    assert stretch.first <= 80
    assert stretch.last >= 90
    assert "held-out trial fast" in stretch.title


def test_only_held_out_trials_are_looked_at_where_there_are_any() -> None:
    assert worst_stretch(_off(diagnosis(), 0, 1, slice(10, 20))).overlay.trial.name == "fast"
    everything = _off(diagnosis(held_out=False), 0, 1, slice(10, 20))
    assert worst_stretch(everything).overlay.trial.name == "slow"
    assert worst_stretch(everything).title.startswith("Sway in trial slow, 0.0 to ")


def test_some_beats_are_shown_and_all_of_a_short_trial() -> None:
    """The slow trial beats at 14 rad/s, 4.5 times in its 2 s; six beats of the fast one, at 20 rad/s, take 1.9 s."""
    slow, fast = (worst_stretch(_off(diagnosis(held_out=False), k, 0, slice(5, 15))) for k in (0, 1))
    assert slow.last - slow.first == len(slow.overlay.trial.time)
    assert (fast.last - fast.first) * 0.02 == pytest.approx(6.0 * 2.0 * np.pi / 20.0, abs=0.15)


def test_the_figure_has_the_stretch_as_measured_and_as_predicted() -> None:
    found = _off(diagnosis(), 1, 2, slice(30, 40))
    stretch = worst_stretch(found)
    measured, nominal, extended = stretch_figure(found, stretch).data
    window = slice(stretch.first, stretch.last)
    assert [trace.name for trace in (measured, nominal, extended)] == ["measured", "nominal", "extended"]
    np.testing.assert_allclose(measured.x, stretch.overlay.trial.time[window], rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(measured.y, stretch.overlay.trial.velocity[window, 2], rtol=1e-4, atol=1e-9)
    drawn = np.array(extended.y, dtype=float)
    seen = np.isfinite(drawn)
    np.testing.assert_allclose(drawn[seen], stretch.overlay.extended[window, 2][seen], rtol=1e-4, atol=1e-9)


def test_channels_that_were_not_measured_and_rollouts_that_diverged_are_no_worst() -> None:
    found = _off(diagnosis(), 1, 2, slice(30, 40))
    overlay = found.overlays[1]
    velocity = overlay.trial.velocity.copy()
    velocity[:, 0] = np.nan
    lost = overlay.nominal.copy()
    lost[60:] = np.nan
    blind = replace(overlay, trial=replace(overlay.trial, velocity=velocity), nominal=lost)
    stretch = worst_stretch(replace(found, overlays=(found.overlays[0], blind)))
    assert stretch.channel == "yaw_rate"
    assert stretch.first <= 30
