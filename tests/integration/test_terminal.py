"""What commands print: tables in a terminal, plain lines when piped."""

import io
import re

import pytest
from rich.console import Console
from typer.testing import CliRunner

from ortilo_drake.commands import terminal
from ortilo_drake.commands.app import app

ROWS = {"estimation MSE": "x 0.1 m²", "touched": "[wall] 3"}
TABLE = "# Found\n\n| axis | error |\n|---|---|\n| x | 0.1 |\n"


def printed(monkeypatch: pytest.MonkeyPatch, is_terminal: bool) -> io.StringIO:
    file = io.StringIO()
    monkeypatch.setattr(terminal, "out", Console(file=file, force_terminal=is_terminal, width=60, highlight=False))
    return file


def test_piped_rows_are_lines_and_piped_markdown_is_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    file = printed(monkeypatch, False)
    terminal.show_rows(ROWS)
    terminal.show_markdown(TABLE)
    assert file.getvalue() == "  estimation MSE      x 0.1 m²\n  touched             [wall] 3\n" + TABLE + "\n"


def test_in_a_terminal_both_are_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    file = printed(monkeypatch, True)
    terminal.show_rows(ROWS)
    terminal.show_markdown(TABLE)
    text = file.getvalue()
    assert "[wall] 3" in text  # not taken for a style
    assert "|---|" not in text
    assert "axis" in text


def test_in_a_terminal_a_reports_heading_is_its_first_line(monkeypatch: pytest.MonkeyPatch) -> None:
    file = printed(monkeypatch, True)
    heading = "found: " + "a long verdict, " * 10
    terminal.show_markdown(f"# {heading}\n\nmore\n")
    first = re.sub(r"\x1b\[[0-9;]*m", "", file.getvalue()).splitlines()[0]
    assert first == heading


def test_without_a_bar_long_work_says_the_time_to_go(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """100 of them lie there from before; 50 more in 10 s, of 250 in all: the last 100 take 20 s."""
    now = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(terminal, "say_error", print)
    with terminal.flights_to_go("likelihoods") as advance:
        advance(100, 250)
        now[0] = 1.0
        advance(110, 250)
        now[0] = 10.0
        advance(150, 250)
    assert capsys.readouterr().out == "150 of at most 250 likelihoods, at most 0:00:20 left\n"


def test_while_it_is_unknown_how_much_there_is_no_time_is_told_and_the_pace_is_from_then_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """100 in 10 s while it was unknown, then 100 in 5 s: the last 200 take 10 s."""
    now = [0.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(terminal, "say_error", print)
    with terminal.flights_to_go() as advance:
        advance(0, None)
        now[0] = 10.0
        advance(100, None)
        advance(100, 400)
        now[0] = 15.0
        advance(200, 400)
    unknown, known = capsys.readouterr().out.splitlines()
    assert unknown == "100 flights, their total number is not known yet"
    assert known == "200 of at most 400 flights, at most 0:00:10 left"


@pytest.mark.parametrize("words", [["faults"], ["room", "new"], ["hil", "check"]])
def test_help_keeps_the_units_that_options_have_in_square_brackets(words: list[str]) -> None:
    printed = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"}).output
    assert re.search(r"\[(s|m)\]", printed)


@pytest.mark.parametrize("name", ["[/x].mcap", "[bold]", "[link=x]y[/link]", "a\\[red]", "[/]"])
def test_a_name_is_no_markup(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    written = io.StringIO()
    monkeypatch.setattr(terminal, "out", Console(file=written, width=30))
    terminal.say_heading(name, ", seed 1")
    assert written.getvalue() == f"{name}, seed 1\n"
    monkeypatch.setattr(terminal, "err", Console(file=written, force_terminal=True, width=80))
    with terminal.progress_bar() as progress:
        progress.add_task(name, total=1)
        progress.refresh()
    assert name in written.getvalue().partition("\n")[2]
