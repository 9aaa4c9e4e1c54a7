"""The pages of the gallery: one a mechanism, and the table of them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path

import jinja2

from gallery import figures
from gallery.swims import curves, swim
from mjfish.effects import Effect, catalogue
from mjfish.effects.mechanism import MECHANISMS, Mechanism
from mjfish.files.writing import make_folder, write_text

_DOMAINS = {
    "data": "The data",
    "drive": "The drive",
    "body": "The body",
    "water": "The water",
    "out_of_plane": "Out of the plane",
}


def write(folder: Path) -> list[Path]:
    """Write the pages and their pictures to a folder; return the pages."""
    make_folder(folder)
    index, page = (_template(name) for name in ("index", "mechanism"))
    found = [folder / "index.md"]
    by_domain = {title: [m for m in MECHANISMS.values() if m.domain == name] for name, title in _DOMAINS.items()}
    write_text(found[0], index.render(domains=by_domain))
    for mechanism in MECHANISMS.values():
        forms = [effect for effect in catalogue().values() if effect.mechanism == mechanism.name]
        found.append(folder / f"{mechanism.name}.md")
        text = page.render(
            mechanism=mechanism, formulas=[f for f in forms if not f.learned], learned=[f for f in forms if f.learned],
            about=about, shown=_pictures(mechanism, forms, folder),
        )  # fmt: skip
        write_text(found[-1], text)
    return found


def _template(name: str) -> jinja2.Template:
    text = (Path(__file__).parent / f"{name}.md.j2").read_text(encoding="utf-8")
    return jinja2.Template(text, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def about(effect: Effect) -> str:
    """Return what the docstring of a cause says: its equation, and how it is meant."""
    return inspect.cleandoc(type(effect).__doc__ or "")


def _pictures(mechanism: Mechanism, forms: list[Effect], folder: Path) -> dict[str, list[str]]:
    """Write the pictures of the formulas of a mechanism; return the names of their files by that of the formula."""
    return {form.name: list(_drawn(form, folder)) for form in forms if not form.learned}


def _drawn(form: Effect, folder: Path) -> Iterator[str]:
    name = f"{form.name}.svg"
    write_text(folder / name, figures.signature(swim(form)))
    yield name
    if found := curves(form):
        name = f"{form.name}-curve.svg"
        write_text(folder / name, figures.forms(found))
        yield name
