"""Films and stills: three fish in their colours, that swim; what of a run is shown, and what is said of it."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest
from diagnosed import diagnosis
from gl import skip_without_gl
from imageio_ffmpeg import get_ffmpeg_exe

from mjfish.drive.wave import travelling
from mjfish.errors import InputError
from mjfish.reporting import film
from mjfish.reporting.film import caption_of, captioned
from mjfish.reporting.log import write_log
from mjfish.reporting.log.drawing import Drawing
from mjfish.reporting.log.reading import read_log
from mjfish.simulation import simulate


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Drawing]:
    """The runs of a diagnosis, read back from its log."""
    path = tmp_path_factory.mktemp("log") / "fish.rrd"
    write_log(diagnosis(), path)
    return {drawing.name: drawing for drawing in read_log(path)}


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw few and small pictures."""
    skip_without_gl()
    for suffix in (".mp4", ".gif"):
        monkeypatch.setitem(film._SIZES, suffix, (480, 270))
        monkeypatch.setitem(film._RATES, suffix, 5.0)


def _decoded(path: Path) -> np.ndarray:
    """Return the pictures of a film (n, 270, 480, 3)."""
    command = [get_ffmpeg_exe(), "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(raw, dtype=np.uint8).reshape(-1, 270, 480, 3)


def _share(picture: np.ndarray, who: str) -> float:
    """Return the share of pixels, captions left out, that have about the hue of a swimmer."""
    red, green, blue = picture[80:-60].astype(float).reshape(-1, 3).T
    seen = {
        "measured": (np.ptp([red, green, blue], axis=0) < 45) & (red > 110),
        "nominal": (red > 1.25 * green) & (green > 1.15 * blue) & (red > 110),
        "extended": (green > 1.5 * red) & (blue > 1.5 * red) & (green > 95),
    }
    return float(np.mean(seen[who]))


def test_a_log_reads_back_as_it_was_drawn(runs: dict[str, Drawing]) -> None:
    fast, slow = runs["fast"], runs["slow"]
    assert (fast.held_out, slow.held_out) == (True, False)
    assert fast.source == "pool week 12"
    assert [figure.swimmer for figure in fast.figures] == ["measured", "nominal", "extended"]
    assert [figure.ghost for figure in fast.figures] == [True, False, False]
    assert fast.figures[2].words == "with servo_lag"
    assert [set(figure.arrows) for figure in fast.figures] == [set(), set(), {"drag", "added_mass"}]
    overlay = diagnosis().overlays[1]
    residual = overlay.trial.velocity - overlay.nominal
    expected = np.mean(np.sqrt(np.mean(residual**2, axis=0)) / np.ptp(overlay.trial.velocity, axis=0))
    assert fast.figures[1].error == pytest.approx(expected)
    assert fast.figures[0].error is None
    np.testing.assert_allclose(fast.figures[1].time, overlay.trial.time, atol=1e-9)


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_a_film_shows_three_fish_that_swim(runs: dict[str, Drawing], tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"swim{suffix}"
    stretch = film.worst(runs["fast"])
    film.write(path, stretch)
    shown = _decoded(path)
    assert len(shown) == pytest.approx(5.0 * stretch.slowdown * (stretch.end - stretch.start), abs=2)
    inner = shown[:, 80:-60].astype(float)
    assert np.all(np.std(inner, axis=(1, 2, 3)) > 10.0)  # none is blank
    moved = np.abs(np.diff(inner, axis=0)).max(axis=3) > 25
    assert np.all(moved.mean(axis=(1, 2)) > 0.005)  # each differs from the one before
    for who in ("measured", "nominal", "extended"):
        assert _share(shown[-2], who) > 0.002, who
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.usefixtures("small")
def test_a_still_shows_the_three_fish_at_several_instants(runs: dict[str, Drawing], tmp_path: Path) -> None:
    path = tmp_path / "swim.png"
    film.write(path, film.worst(runs["fast"], film.BEATS_OF_STILL))
    picture = imageio.imread(path)
    for who in ("measured", "nominal", "extended"):
        assert _share(picture, who) > 0.001, who
    orange = (picture[..., 0] > 1.25 * picture[..., 1]) & (picture[..., 1] > 1.15 * picture[..., 2])
    columns = np.nonzero(orange[80:-60].sum(axis=0) > 3)[0]
    assert np.ptp(columns) > 0.5 * picture.shape[1]
    assert np.count_nonzero(np.diff(columns) > 5) >= 1  # water between one instant and the next


def test_shown_beats_begin_together_and_the_nominal_fish_swims_off(runs: dict[str, Drawing]) -> None:
    for stretch in (film.steady(runs["fast"], 3), film.worst(runs["fast"])):
        assert stretch.anchored
        ends = {f.swimmer: f.at(np.array([stretch.start, stretch.end])) for f in stretch.drawing.figures}
        measured = ends["measured"]
        for figure in ends.values():
            np.testing.assert_allclose(figure.path[0], measured.path[0], atol=1e-9)
            assert figure.heading()[0] == pytest.approx(measured.heading()[0], abs=1e-9)
        off = {who: float(np.linalg.norm(figure.path[1] - measured.path[1])) for who, figure in ends.items()}
        assert off["nominal"] > 2.0 * off["extended"]
    late = film.steady(runs["fast"], 3)
    assert late.start > 0.5
    before = {f.swimmer: f.at(np.array([late.start])).path[0] for f in runs["fast"].figures}
    assert np.linalg.norm(before["nominal"] - before["measured"]) > 0.01  # they were apart


def test_a_moved_fish_keeps_its_shape_and_its_arrows(runs: dict[str, Drawing]) -> None:
    figure = runs["fast"].figures[2]
    turned = figure.moved(0.7, figure.path[0], np.array([1.0, 2.0, 0.5]))
    apart, before = (np.linalg.norm(f.place[:, 1:] - f.place[:, :-1], axis=2) for f in (turned, figure))
    np.testing.assert_allclose(apart, before, atol=1e-6)
    np.testing.assert_allclose(turned.heading() - figure.heading(), 0.7, atol=1e-6)
    for kind, (_, vectors) in figure.arrows.items():
        angle = [np.arctan2(v[50, -1, 1], v[50, -1, 0]) for v in (turned.arrows[kind][1], vectors)]
        assert np.mod(angle[0] - angle[1], 2.0 * np.pi) == pytest.approx(0.7, abs=1e-5)


def test_beats_are_those_of_the_drive(runs: dict[str, Drawing]) -> None:
    """A wave of 1 Hz beats once a second; a run that is slow enough is not slowed."""
    from mjfish.fish import load_fish
    from mjfish.reporting.log.results import drawn_simulation

    fish = load_fish("pike")
    run = drawn_simulation(simulate(fish, drive=travelling([link.length for link in fish.links]), duration=6.0))
    assert film.beats(run) == pytest.approx(1.0, abs=0.03)
    assert film.steady(run, 3).slowdown == 1
    assert film.steady(run, 3).end - film.steady(run, 3).start == pytest.approx(3.0, abs=0.1)
    assert film.beats(runs["fast"]) == pytest.approx(2.0 * np.pi / 20.0, rel=0.1)
    assert film.worst(runs["fast"]).slowdown == 2


def test_captions_tell_whose_run_it_is_the_colours_and_the_seconds(runs: dict[str, Drawing]) -> None:
    caption = caption_of(film.worst(runs["fast"]))
    assert caption.title == "pool week 12, held-out run fast"
    words = [entry for _, entry in caption.legend]
    assert words[0] == "measured (joints as commanded)"
    assert words[1].startswith("nominal, error ")
    assert words[2].startswith("with servo_lag, error 0.3")
    assert words[3:] == ["force: drag", "force: added mass"]
    assert caption.legend[1][0] == (229, 138, 60)
    assert "2 times slower than swum" in caption.notes[0]
    assert caption.notes[1] == "all begin at one place at 0.0 s"
    plain = caption_of(film.Stretch(replace(runs["slow"], figures=runs["slow"].figures[:1]), 0.0, 1.0))
    assert plain.title == "pool week 12, fitted run slow"
    assert plain.notes == ("0.0 to 1.0 s, as fast as swum",)


@pytest.mark.parametrize("width", [320, 1280])
def test_captions_fit_the_picture(runs: dict[str, Drawing], width: int) -> None:
    """Letters on the right edge would be cut: its column is as plain as that of a picture without words."""
    blank = np.full((width * 9 // 16, width, 3), 90, dtype=np.uint8)
    image = np.asarray(captioned(blank, caption_of(film.worst(runs["fast"])), 1.0))
    assert np.all(np.ptp(image[:, -3:].astype(int), axis=1).max(axis=1) <= 2)
    assert np.ptp(image[:60]) > 150  # there are words


def test_what_is_no_film_is_refused(runs: dict[str, Drawing], tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"ends in '\.avi', expected \.mp4 or \.gif or \.png"):
        film.write(tmp_path / "swim.avi", film.whole(runs["fast"]))
    with pytest.raises(InputError, match=r"absent/swim\.png: cannot be written"):
        film.write(tmp_path / "absent" / "swim.png", film.whole(runs["fast"]))
    (tmp_path / "no.rrd").write_text("<html>")
    with pytest.raises(InputError, match=r"no\.rrd: cannot be read as a log"):
        read_log(tmp_path / "no.rrd")
