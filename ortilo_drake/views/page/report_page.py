"""The page of what `ortilo tables`, `analyze`, `sensitivity`, `faults` and `hil check` wrote."""

import base64
import json
import re
import shlex
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import MIB, read_bytes, read_text
from ortilo_drake.views.page.plain_data import data_html
from ortilo_drake.views.page.plain_markdown import markdown_html
from ortilo_drake.views.page.shell import facts, versions, whole_page

LARGEST_JSON = 64 * MIB
LARGEST_FIGURE = 16 * MIB
DEEPEST = 32
_PNG = b"\x89PNG\r\n\x1a\n"
ALLOWED = (
    "must be a flight's .nc, or the --out folder or --json file of tables, analyze, sensitivity, faults, hil check"
)


class Kind(NamedTuple):
    """What a command writes.

    Attributes:
        command: the command, up to its scenario or preset.
        keys: of its JSON file, by which it is known.
        heading: of its .md file, a pattern whose group is the scenario or preset.
        names: the key of that in its JSON file.
        figures: which files in its folder are its figures, {} standing for the scenario or preset.
    """

    command: str
    keys: frozenset[str]
    heading: str | None
    names: str | None
    figures: str


KINDS = (
    Kind(
        "ortilo tables --preset",
        frozenset({"preset", "flights", "estimation", "path", "paper"}),
        r"# The paper's tables, preset '(\w+)'",
        "preset",
        "*_{}.png",
    ),
    Kind(
        "ortilo analyze",
        frozenset({"scenario", "linearization", "riccati", "margins"}),
        r"# Analysis of (\S+)",
        "scenario",
        "*.png",
    ),
    Kind(
        "ortilo sensitivity",
        frozenset({"scenario", "rows", "limits"}),
        r"# What must you know, how well: (\S+)",
        "scenario",
        "{}.png",
    ),
    Kind(
        "ortilo faults",
        frozenset({"scenarios", "flights", "start", "rows"}),
        r"# Faults in flight()",
        None,
        "faults.png",
    ),
    Kind("ortilo hil check", frozenset({"identical", "latency_ms", "missed_deadlines", "lost"}), None, None, ""),
)


def report_page(path: Path) -> str:
    """Return one self-contained page of a folder or a JSON file.

    Raises:
        InputError: naming the file, if none of those commands wrote it or it cannot be read.
    """
    return _of_folder(path) if path.is_dir() else _of_json(path)


def _of_json(path: Path) -> str:
    content = read_bytes(path, LARGEST_JSON)
    try:
        data = json.loads(content)
    except (ValueError, RecursionError):
        raise InputError(f"{path}: is no JSON: {ALLOWED}") from None
    kind = next((k for k in KINDS if isinstance(data, dict) and k.keys <= data.keys()), None)
    if kind is None or _depth(data) > DEEPEST:
        raise InputError(f"{path}: not written by a command that reports: {ALLOWED}")
    subject = "" if kind.names is None else str(data[kind.names])
    title = f"{kind.command.removesuffix(' --preset')} {subject}".strip()
    return _page(title, f"<h1>{escape(title)}</h1>\n{data_html(data)}", path, [_command(kind, subject)])


def _of_folder(path: Path) -> str:
    body, figures, commands = [], [], []
    for file in sorted(path.glob("*.md")):
        text = read_text(file)
        for kind in KINDS:
            found = re.match(kind.heading, text) if kind.heading else None
            if found:
                body.append(markdown_html(text))
                commands.append(_command(kind, found[1]))
                figures += [f for f in sorted(path.glob(kind.figures.format(found[1]))) if f not in figures]
    if not body:
        raise InputError(f"{path}: holds no report: {ALLOWED}")
    pictures = "".join(_figure(figure) for figure in figures)
    return _page(path.resolve().name, "\n<hr>\n".join(body) + pictures, path, commands)


def _command(kind: Kind, subject: str) -> str:
    return f"{kind.command} {shlex.quote(subject)}" if subject else kind.command


def _figure(file: Path) -> str:
    data = read_bytes(file, LARGEST_FIGURE)
    if not data.startswith(_PNG):
        raise InputError(f"{file}: is no PNG picture")
    name = escape(file.stem.replace("_", " "))
    picture = base64.b64encode(data).decode()
    return f'<figure><img alt="{name}" src="data:image/png;base64,{picture}"><figcaption>{name}</figcaption></figure>'


def _page(title: str, body: str, path: Path, commands: list[str]) -> str:
    rows = [("read from", path.name), ("page made with", versions())]
    rows += [("written by", f"$ {command}") for command in commands]
    if "<p>Made by " not in body:
        rows.append(("not recorded", "its other options, such as --set and --flights, and its versions"))
    origin = f"<section><h2>Where it is from</h2>{facts(rows)}</section>"
    return whole_page(title, f'<main class="report"><section>{body}</section>{origin}</main>')


def _depth(data: Any, depth: int = 0) -> int:
    """Return how deep objects and lists lie within one another, no more than DEEPEST + 1."""
    parts = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    if depth > DEEPEST:
        return depth
    return max((_depth(part, depth + 1) for part in parts if isinstance(part, dict | list)), default=depth)
