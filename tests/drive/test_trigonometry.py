"""Cosines and sines of many angles at once."""

from __future__ import annotations

import numpy as np

from mjfish.drive.trigonometry import cos_sin


def test_all_quarters_of_the_circle_and_many_turns() -> None:
    """A quarter turned the wrong way; too few terms of the series; digits lost with the turns taken off."""
    angle = np.concatenate(
        [
            np.linspace(-7.0, 7.0, 10001),
            np.arange(-32, 33) * np.pi / 4.0,
            np.random.default_rng(0).uniform(-6e6, 6e6, 1000),
        ]
    )
    cos, sin = cos_sin(angle)
    np.testing.assert_allclose(cos, np.cos(angle), rtol=0.0, atol=2e-16)
    np.testing.assert_allclose(sin, np.sin(angle), rtol=0.0, atol=2e-16)
    np.testing.assert_allclose(sin[:10001], np.sin(angle[:10001]), rtol=1e-14)


def test_no_angle_has_no_cosine() -> None:
    assert np.isnan(cos_sin(np.array([[np.nan], [np.inf]]))).all()
