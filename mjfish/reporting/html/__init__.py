"""The HTML report of a diagnosis: one file, readable offline, on paper, in the dark and in the light."""

from mjfish.reporting.html.page import render, write_report

__all__ = ["render", "write_report"]
