"""Methods as text: every number is that of the diagnosis, every key that is cited has its work."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from diagnosed import SIGMA, diagnosis, learned_diagnosis

from mjfish import noise
from mjfish.diagnosis import Diagnosis
from mjfish.files.plain_data import plain
from mjfish.noise import Autoregressive, GaussMarkov
from mjfish.reporting.html.methods import NOISE_WORDS, REFERENCES, methods, noise_words


def _text(found: Diagnosis) -> str:
    return " ".join(methods(found)[0]).replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize("verdict", ["named", "nothing_wrong", "cannot_tell", "unexplained"])
def test_what_is_cited_is_listed_and_nothing_else(verdict: str) -> None:
    paragraphs, references = methods(diagnosis(verdict))  # type: ignore[arg-type]
    keys = {key for text in paragraphs for key in re.findall(r"\[(\w+\d{4})\]", text)}
    assert keys & set(REFERENCES) == set(references)
    assert "Yu2016" in references
    assert ("Rauch1965" in references) == (verdict != "nothing_wrong")


def test_the_numbers_are_those_of_the_diagnosis() -> None:
    text = _text(diagnosis())
    assert (
        "The dataset pool week 12 has 2 trials of the fish pike with 202 samples; 1 was fitted, and held out: fast."
        in text
    )
    assert (
        "integrated at a step of 0.0050 s. Its 9 parameters were fitted by maximum likelihood under white noise."
        in text
    )
    assert "scores of 3 candidate causes" in text
    assert "3 candidates were refitted" in text
    assert "Estimates with 95 % intervals: time_constant = 0.02010 s (0.01950 to 0.02070)." in text
    assert "nRMSE 3.14 % before, 1.20 % after: 61.8 % less (57.0 % to 66.0 %)" in text
    assert text.endswith("Software: mjfish 0.1.0; seed 7.")


def test_what_was_not_done_is_not_said() -> None:
    nothing = _text(diagnosis("nothing_wrong"))
    assert "refitted together" not in nothing
    assert "Error on held-out trials" not in nothing
    assert "all were fitted" in _text(diagnosis(held_out=False))
    learned = _text(learned_diagnosis())
    assert "Its form was learned" in learned
    assert "Estimates with" not in learned


def test_the_noise_is_that_of_the_fit() -> None:
    assert noise_words(plain(Autoregressive(SIGMA, np.zeros((3, 2))))) == "autoregressive noise of order 2"
    found = diagnosis()
    slow = replace(found, setup=replace(found.setup, noise=plain(GaussMarkov(SIGMA, drift=SIGMA))))
    assert "by maximum likelihood under Gauss-Markov noise on top of white noise." in _text(slow)


def test_every_noise_model_has_words() -> None:
    for name in noise.__all__:
        kind = getattr(noise, name)
        if isinstance(kind, type) and issubclass(kind, noise.Noise) and kind not in (noise.Noise, Autoregressive):
            assert name in NOISE_WORDS, name
