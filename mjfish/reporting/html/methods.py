"""The methods of a diagnosis as text for a paper, with its citations: made from what was done, number by number."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from mjfish.diagnosis import DiagnosisData
from mjfish.diagnosis.thresholds import THRESHOLDS
from mjfish.numerics.formats import number, p_value

#: Works that the text may cite, by key.
REFERENCES = {
    "Yu2016": "J. Yu, J. Yuan, Z. Wu, M. Tan, Data-Driven Dynamic Modeling for a Swimming Robotic Fish (2016).",
    "Cox1961": "D. R. Cox, Tests of separate families of hypotheses, Proc. 4th Berkeley Symposium (1961).",
    "Hemerik2020": "J. Hemerik, J. Goeman, L. Finos, Robust testing in generalized linear models by sign flipping "
    "score contributions, J. R. Statist. Soc. B 82 (2020).",
    "Eriksson2013": "D. Eriksson, E. Frisk, M. Krysander, A method for quantitative fault diagnosability analysis of "
    "stochastic linear descriptor models, Automatica 49 (2013).",
    "Rauch1965": "H. Rauch, F. Tung, C. Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA "
    "Journal 3 (1965).",
    "Wood2017": "S. Wood, Generalized Additive Models, 2nd ed. (2017), ch. 6.",
}
#: How the kinds of noise read; autoregressive noise by its order.
NOISE_WORDS = {
    "DifferentiationNoise": "noise of differentiated positions",
    "ErrorsInVariables": "noise with errors of the measured joint angles",
    "GaussMarkov": "Gauss-Markov noise on top of white noise",
    "NoiseByRate": "noise with a model of its own for every sampling rate",
    "ProcessNoise": "random forces on the fish on top of white noise",
}


def methods(diagnosis: DiagnosisData) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the methods of a diagnosis, by paragraph, and the works that they cite, by key.

    Numbers are those of this diagnosis; what was not done is not said.
    """
    parts = (_data(diagnosis), _tests(diagnosis), _causes(diagnosis), _held_out(diagnosis), _rest(diagnosis))
    paragraphs = tuple(filter(None, map(" ".join, parts)))
    return paragraphs, {key: work for key, work in REFERENCES.items() if f"[{key}]" in " ".join(paragraphs)}


def noise_words(noise: Mapping[str, Any]) -> str:
    """Return the kind of a noise model, as plain data, in words."""
    if noise["kind"] == "Autoregressive":
        order = len(noise["phi"][0])
        return f"autoregressive noise of order {order}" if order else "white noise"
    return NOISE_WORDS[noise["kind"]]


def _data(diagnosis: DiagnosisData) -> Iterable[str]:
    setup = diagnosis.setup
    samples = sum(len(overlay.trial.time) for overlay in diagnosis.overlays)
    held = [overlay.trial.name for overlay in diagnosis.overlays if overlay.held_out]
    fitted = len(diagnosis.overlays) - len(held)
    fits = f"{fitted} {'was' if fitted == 1 else 'were'} fitted, and held out: {', '.join(held)}"
    kept = fits if held else "all were fitted"
    yield (
        f"The dataset {setup.dataset} has {len(diagnosis.overlays)} trials of the fish {setup.fish} with "
        f"{samples} samples; {kept}."
    )
    yield (
        f"The nominal model is the planar chain of {setup.links} links of [Yu2016], with Morison forces "
        f"on strips, integrated at a step of {number(diagnosis.fits[0].step, 2)} s."
    )
    yield (
        f"Its {len(diagnosis.nominal)} parameters were fitted by maximum likelihood under {noise_words(setup.noise)}."
    )


def _tests(diagnosis: DiagnosisData) -> Iterable[str]:
    tried = [candidate for candidate in diagnosis.candidates if candidate.applicable]
    refitted = sum(candidate.row is not None for candidate in tried)
    p = p_value(diagnosis.p_wrong)
    yield (
        f"Whether anything systematic is left was tested by scores of {len(tried)} candidate causes against simulated "
        f"null distributions, by a basis that knows no cause, and by refits, at a joint level of {THRESHOLDS.alarm:g}: "
        f"p {'' if p.startswith('<') else '= '}{p}."
    )
    if refitted:
        yield (
            f"{refitted} candidates were refitted together with the coefficients. One stays in the confidence set "
            f"where, were it true, the best would lead by as much with a probability of {THRESHOLDS.keep:g} or more "
            f"[Cox1961]; it suffices where what it leaves has p above {THRESHOLDS.goodness:g}, misfits that outliers "
            "leave by chance excepted [Hemerik2020]."
        )


def _causes(diagnosis: DiagnosisData) -> Iterable[str]:
    for cause in diagnosis.causes:
        effect = diagnosis.setup.causes.get(cause.name)
        if effect is not None:
            yield f"{cause.name}: {cause.summary} ({effect.source})."
        if effect is not None and effect.learned:
            yield "Its form was learned: values of curves, kept smooth by a prior [Wood2017]."
            continue
        sizes = "; ".join(f"{name} = {value.told}" for name, value in cause.parameters.items())
        yield f"Estimates with 95 % intervals: {sizes}."


def _held_out(diagnosis: DiagnosisData) -> Iterable[str]:
    if diagnosis.gain is not None and diagnosis.best:
        yield (
            "Error on held-out trials (root mean square over the range of each channel, 95 % interval by block "
            f"bootstrap): {diagnosis.held_out}."
        )


def _rest(diagnosis: DiagnosisData) -> Iterable[str]:
    yield "From which size on mechanisms are told from one another follows from their signatures [Eriksson2013]."
    if diagnosis.force:
        yield "The missing force was estimated by a Kalman smoother [Rauch1965]."
    software = ", ".join(f"{name} {version}" for name, version in diagnosis.provenance.get("versions", {}).items())
    if software:
        yield f"Software: {software}; seed {diagnosis.provenance.get('seed', 0)}."
