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
    with console.progress_bar() as tell:
        for seconds in range(45):
            now = 100.0 + seconds
            tell(f"refitting [{seconds}]", seconds / 45)
    assert capsys.readouterr().err.splitlines() == [
        "starting (0%)",
        "refitting [20] (44%, about 25 s left)",
        "refitting [40] (89%, about 5 s left)",
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
    name, number = "a_name_of_thirty-nine_letters_2026-01-31", "8.641 × 10⁻⁵"
    table = console.table("", ("name", "low", "high"), ("name",))
    table.add_row(name, number, number)
    monkeypatch.setattr(console.out, "_width", 50)
    console.show(table)
    printed = capsys.readouterr().out
    assert printed.count(number) == 2
    assert name not in printed
    monkeypatch.setattr(console.out, "_width", 24)
    console.show(table)
    narrow = capsys.readouterr().out
    for shown in (printed, narrow):
        assert sorted(filter(str.isalnum, shown)) == sorted(filter(str.isalnum, f"namelowhigh{name}{number}{number}"))
