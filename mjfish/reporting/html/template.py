"""Templates of pages: one file each, without a reference to anything outside."""

from __future__ import annotations

import functools
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.offline import get_plotlyjs


def render(template: str, **view: Any) -> str:
    """Return a page as HTML: plotly is in it, and everything that came from a user is escaped.

    Args:
        template: name of the file in ``templates``.
        view: what the template may use, all of what it does use.
    """
    return _environment().get_template(template).render(view, plotly_js=Markup(get_plotlyjs()))  # noqa: S704


@functools.cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("mjfish.reporting.html"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
