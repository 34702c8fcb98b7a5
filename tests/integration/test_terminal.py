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


@pytest.mark.parametrize("words", [["faults"], ["room", "new"], ["hil", "check"]])
def test_help_keeps_the_units_that_options_have_in_square_brackets(words: list[str]) -> None:
    printed = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"}).output
    assert re.search(r"\[(s|m)\]", printed)
