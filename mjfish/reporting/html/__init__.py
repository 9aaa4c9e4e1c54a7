"""Figures by plotly, and pages of them: one HTML file each, readable offline, on paper and in the dark."""
