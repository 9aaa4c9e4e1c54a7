"""What the commands print with: text as it is, whatever brackets are in it, and progress of long commands."""

from __future__ import annotations

import pytest

from mjfish.cli import console


def test_progress_through_a_pipe_is_a_line_at_times(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Catches silence for minutes, and a line for every step. Brackets of a name are no markup."""
    now = 100.0
    monkeypatch.setattr(console.time, "monotonic", lambda: now)
    monkeypatch.setattr(console.err, "get_time", lambda: now)
    with console.progress_bar() as tell:
        for seconds in range(45):
            now = 100.0 + seconds
            tell(f"refitting [{seconds}]", seconds / 45)
    assert capsys.readouterr().err.splitlines() == [
        "starting (0%)",
        "refitting [20] (44%, about 26 s left)",
        "refitting [40] (89%, about 6 s left)",
    ]


def test_units_in_brackets_are_printed_wherever_they_stand(capsys: pytest.CaptureFixture[str]) -> None:
    """Catches markup in a title, a heading, a cell, a caption, a line or a message."""
    table = console.table("title [m/s]", ("heading [ms]", "[%]"), ("[%]",))
    table.caption = "caption [rad/s]"
    table.add_row("cell [N m]", "[bold]")
    console.out.print(table)
    console.say("line [s]", ("styled [Hz]", "bold"))
    console.complain("error [/]", "message [kg] :fish:")
    printed = capsys.readouterr()
    for text in ("title [m/s]", "heading [ms]", "[%]", "caption [rad/s]", "cell [N m]", "[bold]", "line [s]"):
        assert text in printed.out
    assert "styled [Hz]" in printed.out
    assert printed.err == "error [/]: message [kg] :fish:\n"


def test_names_are_broken_before_numbers(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Where there is no room for either, no letter is lost."""
    name, number = "a_name_of_thirty-nine_letters_2026-01-31", "0.3831 (0.3702 to 0.3960)"
    table = console.table("", ("name", "estimate"), ("name",))
    table.add_row(name, number)
    shown = {}
    for width in (42, 24):
        monkeypatch.setattr(console.out, "_width", width)
        console.show(table)
        shown[width] = capsys.readouterr().out
        assert all(len(line) <= width for line in shown[width].splitlines())
        assert sorted(filter(str.isalnum, shown[width])) == sorted(filter(str.isalnum, f"nameestimate{name}{number}"))
    assert number in shown[42]
    assert name not in shown[42]
    assert number not in shown[24]
