"""Progress of long commands where nobody looks at a terminal."""

from __future__ import annotations

import pytest

from mjfish.cli import console


def test_progress_through_a_pipe_is_a_line_at_times(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Catches silence for minutes, and a line for every step. Brackets of a name are no markup."""
    now = 100.0
    monkeypatch.setattr(console.time, "monotonic", lambda: now)
    with console.progress_bar() as tell:
        for seconds in range(45):
            now = 100.0 + seconds
            tell(f"refitting [{seconds}]", seconds / 45)
    assert capsys.readouterr().err.splitlines() == [
        "refitting [0] (0%; a first run compiles for a minute or two)",
        "refitting [20] (44%)",
        "refitting [40] (89%)",
    ]
