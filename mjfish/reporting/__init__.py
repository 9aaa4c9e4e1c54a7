"""How results are shown: HTML pages, rerun logs, text."""
