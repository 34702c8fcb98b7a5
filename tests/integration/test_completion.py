"""Completion by the shell: the words that it offers, asked for as bash asks."""

import pytest
from command_line import run

from ortilo_drake.scenario import scenario_names


def offered(line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return what is offered for the last word of a command line."""
    monkeypatch.setattr("sys.argv", ["ortilo"])
    monkeypatch.setattr("__main__.__package__", "")  # click names the program by both
    monkeypatch.setenv("_ORTILO_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
    assert run() == 0
    return capsys.readouterr().out.split()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ortilo fly realistic_", ["realistic_altimeter", "realistic_flow", "realistic_tight"]),
        ("ortilo scenario show out", ["outage"]),
        ("ortilo hil check bur", ["bursty_link"]),
        ("ortilo tables --beside alt", ["altimeter"]),
        ("ortilo fly ./own", []),  # the shell looks for files then
        ("ortilo tab", ["tables"]),
        ("ortilo fly --se", ["--seed", "--set", "--seconds"]),
    ],
)
def test_words_are_completed(
    line: str, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert offered(line, monkeypatch, capsys) == words


def test_every_scenario_is_offered(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert offered("ortilo fly ", monkeypatch, capsys) == scenario_names()
