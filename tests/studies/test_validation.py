"""The study beside published numbers: its formulas, its regression, its falling plates; and docs/validation.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from studies.validation import __main__ as command
from studies.validation import falling_plate, oscillation, spheroid

_PAGE = Path(__file__).parents[2] / "docs" / "validation.md"


@pytest.fixture(scope="module")
def page() -> str:
    return _PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(("ratio", "lateral"), [(1.0, 0.50), (2.0, 0.70), (4.0, 0.86), (6.0, 0.92), (10.0, 0.96)])
def test_lateral_added_mass_of_spheroids_is_the_published_one(ratio: float, lateral: float) -> None:
    assert spheroid.lamb(ratio).lateral == pytest.approx(lateral, abs=0.01)


@pytest.mark.parametrize(("ratio", "axial", "lateral", "rotation"), spheroid.PUBLISHED)
def test_formulas_give_lambs_table(ratio: float, axial: float, lateral: float, rotation: float) -> None:
    """To 0.003: his ratios are rounded to 0.01, which at 1.5 is worth 0.002."""
    found = spheroid.lamb(ratio)
    assert (found.axial, found.lateral, found.rotation) == pytest.approx((axial, lateral, rotation), abs=0.003)


@pytest.mark.parametrize("ratio", [1.3, 3.0, 20.0])
def test_formulas_are_the_integrals_of_the_potential_round_an_ellipsoid(ratio: float) -> None:
    """[Lamb1932, art. 114]: alpha = a b c INT dl / ((a^2 + l) Delta), beta with b^2, l from 0 to infinity."""

    def integral(own: float) -> float:
        return quad(lambda s: ratio / ((own + s) * np.sqrt(ratio**2 + s) * (1.0 + s)), 0.0, np.inf, epsabs=1e-11)[0]

    alpha, beta = integral(ratio**2), integral(1.0)
    gap = beta - alpha
    less, more = ratio**2 - 1.0, ratio**2 + 1.0
    rotation = less**2 * gap / (2.0 * less - more * gap) / more
    found = spheroid.lamb(ratio)
    expected = (alpha / (2.0 - alpha), beta / (2.0 - beta), rotation)
    assert (found.axial, found.lateral, found.rotation) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("ratio", [1.0, 4.0, 9.97])
def test_strips_of_a_spheroid_move_its_own_volume_of_water(ratio: float) -> None:
    """Closed form of INT rho pi h^2 / 4 r^k dr of an ellipse, k = 0 and 2, over the displaced mass and its inertia."""
    found = spheroid.strips(ratio)
    expected = (0.0, 1.0, ratio**2 / (ratio**2 + 1.0))
    assert (found.axial, found.lateral, found.rotation) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("kc", "c_d", "c_m"), [(0.5, 1.9, 0.7), (30.0, 0.4, 1.3)])
def test_morison_regression_recovers_the_coefficients(kc: float, c_d: float, c_m: float) -> None:
    assert oscillation.swing(kc, {"c_d": c_d, "c_m": c_m}) == pytest.approx((c_d, c_m), rel=1e-6)


@pytest.mark.parametrize("kc", [1.7, 13.6])
def test_morison_regression_recovers_grahams_law(kc: float) -> None:
    keys = {"c_d": oscillation.graham(3.0), "kc": kc, "kc_power": 1.0 / 3.0}
    assert oscillation.swing(kc, keys)[0] == pytest.approx(oscillation.graham(kc), rel=1e-6)


@pytest.mark.parametrize("kc", [1.7, 8.8, 118.2])
def test_a_cause_that_estimates_the_amplitude_finds_the_law_of_the_plates(kc: float) -> None:
    """To 6 %: at 1 s its filter passes 0.953 of the amplitude (2 %), and the mean square ripples over a period."""
    c_d, power = oscillation.drag_law()
    found, _ = oscillation.swing(kc, {"c_d": c_d}, "keulegan_carpenter_drag", (power,))
    assert found == pytest.approx(c_d * (kc / 3.0) ** -power, rel=0.06)


def test_the_power_law_meets_the_measured_plates_better_than_grahams() -> None:
    assert oscillation.misfit(*oscillation.drag_law()) < 0.1 < oscillation.misfit(oscillation.graham(3.0), 1.0 / 3.0)


@pytest.mark.parametrize(
    ("inertia", "motion"), [(1.1, "flutters"), (1.4, "tumbles"), (1.219, "flutters"), (1.2192, "tumbles")]
)
def test_published_equations_flutter_and_tumble_where_they_are_said_to(inertia: float, motion: str) -> None:
    """1.2190 and 1.2192 lie on either side of a heteroclinic bifurcation: any wrong term moves it."""
    assert falling_plate.published(inertia).motion == motion


@pytest.mark.parametrize("inertia", command.FALLING)
def test_strips_without_munk_moment_slide_down_at_the_angle_of_release(inertia: float) -> None:
    """The steady slide in closed form: weight balances both drags of the strip, at an angle that never changes."""
    angle = falling_plate.START[1]
    normal, along = (
        np.cos(angle) / (falling_plate.A + falling_plate.B),
        np.sin(angle) / (falling_plate.A - falling_plate.B),
    )
    speed = np.sqrt(np.pi * np.hypot(normal, along))
    v, u = np.pi * normal / speed, np.pi * along / speed
    found = falling_plate.strips(inertia, 0.0)
    assert found.swing == 0.0
    assert found.descent == pytest.approx(v * np.cos(angle) + u * np.sin(angle), rel=1e-4)
    assert found.drift == pytest.approx(abs(u * np.cos(angle) - v * np.sin(angle)), rel=1e-4)


@pytest.mark.parametrize("inertia", command.FALLING)
def test_strips_lack_the_lift_of_rotation_and_fall_like_the_equations_without_it(inertia: float) -> None:
    """Descent to 2 %: the plate is a sixth as thick as wide, the published one is thin."""
    whole = falling_plate.published(inertia)
    reduced = falling_plate.published(inertia, falling_plate.AS_STRIPS)
    found = falling_plate.strips(inertia, 1.0)
    assert found.descent == pytest.approx(reduced.descent, rel=0.02)
    assert found.swing == pytest.approx(reduced.swing, rel=0.2)
    assert found.descent > 2.0 * whole.descent
    assert found.swing < 0.3 * whole.swing


def test_tables_are_in_the_page_as_they_come_out_today(page: str) -> None:
    """Catches a page that was not written anew after the force or a cause changed."""
    assert command.spheroids() in page
    assert command.drag() in page
    assert command.inertia() in page


@pytest.mark.slow
def test_the_whole_page_is_what_the_command_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, page: str) -> None:
    target = tmp_path / "validation.md"
    monkeypatch.setattr("sys.argv", ["validation", "--page", str(target)])
    assert command.main() == 0
    assert target.read_text(encoding="utf-8") == page


def test_a_page_that_cannot_be_written_is_refused_before_anything_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "page", lambda: pytest.fail("computed"))
    monkeypatch.setattr("sys.argv", ["validation", "--page", str(tmp_path / "no" / "page.md")])
    assert command.main() == 2
    assert "there is no folder" in capsys.readouterr().err
