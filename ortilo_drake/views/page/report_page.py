"""The page of a command's results: its folder with a Markdown report and figures, or its JSON file."""

import base64
import json
import os
from html import escape
from pathlib import Path
from typing import Any, Final

from markdown_it import MarkdownIt

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import MIB, read_bytes, read_text
from ortilo_drake.views.page.shell import facts, versions, whole_page
from ortilo_drake.views.page.written_kinds import (
    ALLOWED,
    SHOWN,
    command_of,
    figures_of,
    kind_of,
    kinds_of_report,
    subject_of,
)

LARGEST_JSON = 16 * MIB  # of short lists and objects a parser makes thirty times as much
LARGEST_FIGURE = 16 * MIB
LARGEST_FOLDER = 64 * MIB  # of its figures and the HTML of its reports
_PNG = b"\x89PNG\r\n\x1a\n"
# HTML in a report is shown as text, and nothing leads out of the page.
_MARKDOWN: Final = MarkdownIt("commonmark", {"html": False}).enable("table")
_MARKDOWN.disable(["link", "image", "autolink", "reference"])


def markdown_html(text: str) -> str:
    """Return HTML of a Markdown text; HTML in it is shown as text."""
    return str(_MARKDOWN.render(text))


def report_page(path: Path) -> str:
    """Return one self-contained page of a folder or a JSON file.

    InputError names the file, if none of those commands wrote it or it cannot be read.
    """
    return _of_folder(path) if os.path.isdir(path) else _of_json(path)


def _of_json(path: Path) -> str:
    content = read_bytes(path, LARGEST_JSON)
    try:
        data = json.loads(content)
        body = data_html(data if isinstance(data, dict) else {"rows": data})
    except (ValueError, RecursionError):  # of lists in lists in lists
        raise InputError(f"{path}: is no JSON: {ALLOWED}") from None
    kind = kind_of(data)
    if kind is None:
        raise InputError(f"{path}: not written by a command that reports: {ALLOWED}")
    subject = subject_of(kind, data)
    title = f"{kind.name} {subject}".strip()
    return _page(title, f"<h1>{escape(title)}</h1>\n{body}", path, [command_of(kind, subject)])


def _of_folder(path: Path) -> str:
    body, figures, commands = [], [], []
    for file in sorted(path.glob("*.md")):
        text = read_text(file)
        for kind, subject in kinds_of_report(text):
            _check_inside(path, file)
            body.append(markdown_html(text))
            commands.append(command_of(kind, subject))
            figures += [file for file in figures_of(kind, subject, path) if file not in figures]
    if not body:
        raise InputError(f"{path}: holds no report: {ALLOWED}")
    parts = ["\n<hr>\n".join(body)]
    size = len(parts[0])
    for file in figures:
        _check_inside(path, file)
        data = _picture(file)
        size += len(data)
        if size > LARGEST_FOLDER:
            raise InputError(f"{path}: its reports and figures must have at most {LARGEST_FOLDER // MIB} MiB in all")
        parts.append(_figure(file, data))
    title = _unicode(os.path.basename(os.path.realpath(path)))
    return _page(title, "".join(parts), path, commands)


def _check_inside(folder: Path, file: Path) -> None:
    """Refuse a file of a folder that is a link to one outside of it."""
    inside = os.path.realpath(folder)
    if os.path.commonpath([inside, os.path.realpath(file)]) != inside:
        raise InputError(f"{file}: is a link out of the folder: must be in it")


def _picture(file: Path) -> bytes:
    data = read_bytes(file, LARGEST_FIGURE)
    if not data.startswith(_PNG if file.suffix == ".png" else b"<?xml"):
        raise InputError(f"{file}: is no {file.suffix[1:].upper()} picture")
    return data


def _figure(file: Path, data: bytes) -> str:
    """Return the HTML of a picture; an image element runs no script of an SVG and loads nothing that it names."""
    name = escape(_unicode(file.stem).replace("_", " "))
    source = f"data:{SHOWN[file.suffix]};base64,{base64.b64encode(data).decode()}"
    return f'<figure><img alt="{name}" src="{source}"><figcaption>{name}</figcaption></figure>'


def _page(title: str, body: str, path: Path, commands: list[str]) -> str:
    rows = [("read from", _unicode(path.name)), ("page made with", versions())]
    rows += [("written by", f"$ {command}") for command in commands]
    if "<p>Made by " not in body:
        rows.append(("not recorded", "its other options, such as --set and --flights, and its versions"))
    origin = f"<section><h2>Where it is from</h2>{facts(rows)}</section>"
    return whole_page(title, f'<main class="report"><section>{body}</section>{origin}</main>')


def _unicode(name: str) -> str:
    """Return a file's name with a mark in place of each byte that is no UTF-8."""
    return os.fsencode(name).decode(errors="replace")


MOST_SHOWN = 8  # numbers of a long list


def data_html(data: dict[str, Any], level: int = 2) -> str:
    """Return the HTML of an object; its parts have headings below that level."""
    plain = {name: value for name, value in data.items() if not _is_nested(value)}
    parts = [facts([(_words(name), cell(value)) for name, value in plain.items()])] if plain else []
    for name, value in data.items():
        if name not in plain:
            parts += [f"<h{level}>{escape(_words(name))}</h{level}>", _nested(value, min(level + 1, 6))]
    return "\n".join(parts)


def cell(value: Any) -> str:
    """Return a value as text; a long list by its first values and its length."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        more = f" … ({len(value)} values)" if len(value) > MOST_SHOWN else ""
        return ", ".join(cell(part) for part in value[:MOST_SHOWN]) + more
    if isinstance(value, dict):
        return ", ".join(f"{_words(name)} {cell(part)}" for name, part in value.items())
    return str(value)


def _nested(value: Any, level: int) -> str:
    if isinstance(value, list):
        value = {str(i + 1): part for i, part in enumerate(value)}
    rows = list(value.values())
    if len(rows) > 1 and all(isinstance(row, dict) and row.keys() == rows[0].keys() for row in rows):
        header = ["", *(_words(name) for name in rows[0])]
        if all(not _is_deep(part) for row in rows for part in row.values()):
            return _table(header, [[_words(name), *map(cell, row.values())] for name, row in value.items()])
    return data_html(value, level)


def _table(header: list[str], rows: list[list[str]]) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _is_nested(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(part, dict) for part in value))


def _is_deep(value: Any) -> bool:
    """Return whether a value is too much for a cell."""
    return _is_nested(value) and (isinstance(value, list) or any(_is_nested(part) for part in value.values()))


def _words(name: str) -> str:
    return name.replace("_", " ")
