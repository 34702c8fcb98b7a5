"""Code that the pages show: Python runs, commands exist with all their options.

A block of Python that cannot run by itself has `<!-- not run: why -->` in the line before it.
"""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from markdown_it import MarkdownIt
from markdown_it.token import Token

from ortilo_drake.commands.app import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
PAGES += sorted((ROOT / "docs/how_to").glob("*.md"))
WRONG = (KeyError, typer.BadParameter.__base__ or ValueError)  # of a command that is none; click's UsageError
NOT_RUN = re.compile(r"<!-- not run: \w.+ -->")


def tokens(text: str) -> Iterator[Token]:
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        yield token
        yield from token.children or ()


def python_blocks(page: Path) -> Iterator[tuple[int, str, bool]]:
    """Yield the line, the code, and whether it is to run, of each block of Python."""
    text = page.read_text(encoding="utf-8")
    lines = text.splitlines()
    for token in tokens(text):
        if token.type == "fence" and token.info.strip() == "python":
            assert token.map is not None
            first = token.map[0]
            yield first + 1, token.content, not NOT_RUN.fullmatch(lines[first - 1].strip())


def commands(text: str) -> Iterator[list[str]]:
    """Yield the words of each command `ortilo` in a page's blocks of code and in its lines."""
    for token in tokens(text):
        if token.type not in ("code_block", "fence", "code_inline"):
            continue
        for line in token.content.splitlines():
            if token.type == "code_inline" and not line.startswith("ortilo "):
                continue
            lexer = shlex.shlex(line.removeprefix("$ "), posix=True, punctuation_chars="&|><;")
            lexer.whitespace_split = True
            try:
                words = list(lexer)
            except ValueError:  # a line of output, with half a quotation
                continue
            command: list[str] = []
            for word in [*words, ";"]:
                if word and set(word) <= set("&|><;"):
                    if command and Path(command[0]).name == "ortilo" and len(command) > 1:
                        yield command[1:]
                    command = []
                else:
                    command.append(word)


def after_options(words: list[str]) -> list[str]:
    """Return a command's words after the options that stand before it, each with a value."""
    options = ("--plugin", "--scheduler", "--theme", "--title", "--figures")
    return after_options(words[2:]) if words[:1] and words[0] in options else words


def parse(words: list[str]) -> Any:
    """Parse a command's words as Typer would, without running it; return the command."""
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands"):
        words = after_options(words)
        if not words:
            return command  # a group, named as such
        command, words = command.commands[words[0]], words[1:]
    required = [p for p in command.params if p.required]
    if words or not required:
        command.make_context(command.name, list(words)).close()
    return command


RUN = [
    pytest.param(code, id=f"{page.stem}-{line}") for page in PAGES for line, code, runs in python_blocks(page) if runs
]


def test_there_is_python_to_run_and_what_is_not_run_says_why() -> None:
    blocks = [block for page in PAGES for block in python_blocks(page)]
    assert len(RUN) >= 4
    assert len(blocks) - len(RUN) <= 2


@pytest.mark.long
@pytest.mark.parametrize("code", RUN)
def test_python_of_the_pages_runs(code: str, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "block.py").write_text(code, encoding="utf-8")
    paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    env = os.environ | {"MPLBACKEND": "agg", "PYTHONPATH": paths}
    done = subprocess.run([sys.executable, "block.py"], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_of_the_pages_exist_with_their_options(page: Path) -> None:
    for words in commands(page.read_text(encoding="utf-8")):
        try:
            parse(words)
        except WRONG as error:
            pytest.fail(f"{page.name}: ortilo {shlex.join(words)}: {error!r}")


def test_a_command_or_an_option_that_is_none_is_found() -> None:
    text = "    ortilo fly --seeds 3   # wrong\n\n`ortilo flee`\n\n"
    text += "```\n$ ortilo tables --flights many && ortilo fly --seed 3\n```\n"
    found = list(commands(text))
    assert found == [["fly", "--seeds", "3"], ["flee"], ["tables", "--flights", "many"], ["fly", "--seed", "3"]]
    for words in found[:3]:
        with pytest.raises(WRONG):
            parse(words)
    assert parse(found[3]).name == "fly"


def test_the_pages_show_most_commands() -> None:
    shown = {
        word
        for page in PAGES
        for words in commands(page.read_text(encoding="utf-8"))
        for word in after_options(words)[:1]
    }
    assert shown == set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
