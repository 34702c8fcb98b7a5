"""Every option of every command, given a value that it cannot take: exit code 2, one line, nothing written."""

import enum
import inspect
import platform
import subprocess
import types
import typing
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import run

from ortilo_drake.commands.app import app, commit

WORD, PLACE = "frobs", "no/such/place"


def commands(group: typer.Typer, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Callable[..., Any]]]:
    """Yield each command's words and function."""
    for command in group.registered_commands:
        assert command.callback is not None
        yield (*words, command.name or command.callback.__name__.replace("_", "-")), command.callback
    for below in group.registered_groups:
        assert below.typer_instance is not None
        yield from commands(below.typer_instance, (*words, str(below.name)))


def values_refused(kind: Any, option: Any) -> list[str]:
    """Return words that an option of a type and range cannot be."""
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return [WORD]
    if kind not in (int, float):
        return []
    wrong = ["1.5"] if kind is int else ["nan", "inf"]
    wrong += [] if option.min is None else [str(option.min - 1)]
    return wrong + ([] if option.max is None else [str(option.max + 1)])


def wrong_calls(words: tuple[str, ...], function: Callable[..., Any]) -> Iterator[tuple[str, ...]]:
    """Yield command lines of one command, each with one word that is wrong."""
    given: list[str] = []  # what the command cannot do without
    places, options = [], []
    hints = typing.get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        of_type, *about = typing.get_args(hints[name])
        kinds = [k for k in typing.get_args(of_type) if k is not types.NoneType]
        kind = kinds[0] if isinstance(of_type, types.UnionType) else of_type
        if isinstance(about[0], typer.models.OptionInfo):
            names = [word for word in (about[0].default, *(about[0].param_decls or ())) if str(word).startswith("--")]
            options.append((names[0] if names else "--" + name.replace("_", "-"), kind, about[0]))
        elif parameter.default is inspect.Parameter.empty:
            places.append((len(given), kind, about[0]))
            given.append("1" if kind is float else PLACE)
    yield *words, *given, "--" + WORD
    yield *words, *given, *["extra"] * 3
    for at, kind, info in places:
        for value in values_refused(kind, info):
            yield *words, *given[:at], "--", value, *given[at + 1 :]
    for option, kind, info in options:
        for value in values_refused(kind, info):
            yield *words, *given, f"{option}={value}"
        if kind is not bool:
            yield *words, *given, option  # and no value
        if option == "--set":
            yield *words, *given, option, WORD


COMMANDS = dict(commands(app))


def test_there_are_options_of_every_type_to_spoil() -> None:
    calls = [call for command in COMMANDS.items() for call in wrong_calls(*command)]
    assert len(calls) > 200
    assert {("fly", "--seed=1.5"), ("hil", "goal", "--", "nan", "1"), ("tables", "--flights=0")} <= set(calls)


@pytest.mark.family("hil key")
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_wrong_word_ends_with_code_two_and_one_line(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for call in wrong_calls(words, COMMANDS[words]):
        assert run(*call) == 2, call
        printed = capsys.readouterr()
        assert printed.out == "", call
        assert len(printed.err.splitlines()) == 1, (call, printed.err)
        assert printed.err.startswith("ortilo: "), call
    assert list(tmp_path.iterdir()) == []


def test_the_versions_are_those_installed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--version") == 0
    said = capsys.readouterr().out
    assert said.startswith("ortilo-drake ")
    assert f"Drake {version('drake')}," in said
    assert f"Python {platform.python_version()}" in said


def test_a_checkout_s_version_names_its_commit(tmp_path: Path) -> None:
    """As git itself names it; outside a checkout there is none."""
    assert commit(tmp_path) == ""
    git = ("git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@example.com")
    for words in (("init", "-q"), ("commit", "-q", "--allow-empty", "-m", "first")):
        subprocess.run([*git, *words], check=True)
    said = subprocess.run([*git, "rev-parse", "--short", "HEAD"], check=True, capture_output=True, text=True).stdout
    assert commit(tmp_path) == said.strip()
    (tmp_path / "file").write_text("new\n")
    subprocess.run([*git, "add", "file"], check=True)
    assert commit(tmp_path) == said.strip() + "-dirty"
