"""The parts of the report: numbers in words, thinned curves and the residual over the beat."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosed import diagnosis

from mjfish.diagnosis import Estimate
from mjfish.reporting.html.beat import BINS, beat_figure, binned
from mjfish.reporting.html.candidates import candidate_views
from mjfish.reporting.html.coefficients import coefficient_views
from mjfish.reporting.html.figure import POINTS, compact, thinned
from mjfish.reporting.html.force import force_figure, force_shares
from mjfish.reporting.html.where import where_view
from mjfish.reporting.html.words import chance, estimate, interval, number, percent


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14159, "3.14"),
        (-0.0195, "−0.0195"),
        (123456.0, "123456"),
        (5.84e-5, "5.84 × 10⁻⁵"),
        (-2.5e9, "−2.50 × 10⁹"),
        (np.nan, "–"),
    ],
)
def test_numbers_have_three_digits_and_no_letter_e(value: float, text: str) -> None:
    assert number(value) == text


def test_an_estimate_has_as_many_places_as_its_interval_deserves() -> None:
    one = Estimate(0.123456, 0.0834, 0.1634, "s")
    assert (estimate(one), interval(one)) == ("0.123", "0.083 to 0.163")
    assert estimate(replace(one, low=0.12345, high=0.12346)) == "0.1234560"
    assert estimate(replace(one, low=0.123456, high=0.123456)) == "0.123"  # on a bound: no interval


def test_an_estimate_on_its_bound_is_the_bound_and_an_interval_without_width_is_left_out() -> None:
    one = Estimate(0.0005, 0.0005, 0.04, "-", at_bound=True)
    assert (estimate(one), interval(one)) == ("0.0005", "0.001 to 0.040")
    assert interval(replace(one, high=0.0005)) == ""


def test_chances_below_one_in_ten_thousand_are_not_told_apart() -> None:
    assert [chance(p) for p in (0.0, 9e-5, 0.0123, 1.0)] == ["< 0.0001", "< 0.0001", "0.012", "1.0"]
    assert percent(0.1234) == "12.3\N{NO-BREAK SPACE}%"


def test_a_long_curve_keeps_its_extremes() -> None:
    time = np.linspace(0.0, 100.0, 50_000)
    wave = np.sin(60.0 * time)
    wave[12_345] = 7.0
    wave[40_001] = -9.0
    x, y = thinned(time, wave)
    assert len(x) <= POINTS
    assert np.all(np.diff(x) > 0.0)
    assert (y.max(), y.min()) == (7.0, -9.0)
    assert x[np.argmax(y)] == time[12_345]


def test_a_short_curve_is_shown_as_it_is() -> None:
    time = np.linspace(0.0, 1.0, POINTS)
    assert thinned(time, time)[0] is time
    assert compact(np.array([1.0 / 3.0, np.nan, -2e-9])) == [0.33333, None, -2e-9]


def test_what_repeats_with_the_beat_is_seen_and_what_does_not_averages_out() -> None:
    rng = np.random.default_rng(0)
    phase = rng.uniform(0.0, 40.0, 20_000)
    residual = np.stack([0.1 * np.cos(2.0 * np.pi * phase), np.zeros_like(phase), np.zeros_like(phase)], axis=1)
    residual += rng.normal(size=residual.shape)
    mean, error = binned(phase, residual)
    centre = (np.arange(BINS) + 0.5) / BINS
    assert np.max(np.abs(mean[:, 0] - 0.1 * np.cos(2.0 * np.pi * centre)) / error[:, 0]) < 4.0
    assert np.max(np.abs(mean[:, 1]) / error[:, 1]) < 4.0
    np.testing.assert_allclose(error, 1.0 / np.sqrt(len(phase) / BINS), rtol=0.1)


def test_empty_bins_of_the_beat_and_diverged_samples_are_left_out() -> None:
    phase = np.full(10, 0.5 / BINS)
    residual = np.zeros((10, 3))
    residual[3] = np.nan
    mean, _ = binned(phase, residual)
    assert np.all(mean[0] == 0.0)
    assert np.all(np.isnan(mean[1:]))


def test_the_beat_is_shown_of_held_out_trials_alone_where_there_are_any() -> None:
    one = diagnosis()
    without = replace(one, overlays=one.overlays[1:])
    assert beat_figure(one)["data"] == beat_figure(without)["data"]
    assert beat_figure(diagnosis(held_out=False))["data"] != beat_figure(one)["data"]


def test_what_remains_is_shown_only_of_candidates_in_the_race() -> None:
    views = {view.name: view for view in candidate_views(diagnosis("cannot_tell"))}
    assert (views["servo_lag"].fit_p, views["time_offset"].fit_p, views["tail_compliance"].fit_p) == (
        "0.31",
        "0.31",
        "–",
    )
    assert {view.rival_p for view in candidate_views(diagnosis("nothing_wrong"))} == {"–"}


def test_a_cause_from_a_users_own_file_needs_no_entry_in_the_catalogue() -> None:
    one = diagnosis()
    own = replace(one.candidates[1], name="my_own", smallest_visible={"my_own.size": 0.25})
    view = candidate_views(replace(one, candidates=(one.candidates[0], own)))[1]
    assert (view.name, view.summary, view.smallest_visible) == ("my_own", "", ("size 0.25",))


def test_shares_are_bars_in_a_fixed_order_with_the_chief_one_marked() -> None:
    channels, trials, parts, phases, *_ = where_view(diagnosis())
    assert [(bar.name, bar.share, bar.chief) for bar in channels.bars] == [
        ("surge", "20\N{NO-BREAK SPACE}%", False),
        ("sway", "30\N{NO-BREAK SPACE}%", False),
        ("yaw rate", "50\N{NO-BREAK SPACE}%", True),
    ]
    assert [round(bar.length) for bar in channels.bars] == [40, 60, 100]
    assert [bar.name for bar in parts.bars] == ["start-up", "steady"]
    assert len(trials.bars) == 1
    assert phases.bars[0].chief
    assert where_view(diagnosis("nothing_wrong")) == ()


def test_whiskers_keep_their_place_between_the_ends_of_both_intervals() -> None:
    one = diagnosis()
    shifted = {**one.extended, "c_d.tail": Estimate(3.0, 2.8, 3.2, "-")}
    view = next(v for v in coefficient_views(replace(one, extended=shifted)) if v.name == "c_d.tail")
    assert view.nominal is not None
    assert view.extended is not None
    low, high = one.nominal["c_d.tail"].low, 3.2
    assert view.extended.whisker.at == pytest.approx(6.0 + 88.0 * (3.0 - low) / (high - low), abs=0.01)
    assert (view.nominal.whisker.low, view.extended.whisker.high) == (6.0, 94.0)


def test_the_missing_force_is_that_of_the_densest_trial_with_two_sigma_on_each_side() -> None:
    shown = diagnosis()
    spec = force_figure(shown)
    assert spec is not None
    band, line = spec["data"][0], spec["data"][1]
    assert line["y"] == pytest.approx(shown.force[0].force[:, 0], rel=1e-4)
    count = len(line["y"])
    wide = np.subtract(band["y"][count:][::-1], band["y"][:count])
    assert wide == pytest.approx(4.0 * shown.force[0].band[:, 0], rel=1e-3)
    assert force_figure(diagnosis("nothing_wrong")) is None


def test_how_much_is_missing_is_told_as_a_share_of_what_moves_the_fish() -> None:
    """A sine of 0.1 N has 0.071 N root mean square; 1 N moves the fish."""
    name, (along, across, _) = force_shares(diagnosis())[0]
    assert name == "slow"
    assert float(along.rstrip("%")) == pytest.approx(7.1, abs=0.2)
    assert float(across.rstrip("%")) == pytest.approx(14.2, abs=0.4)
