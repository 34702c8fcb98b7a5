"""The page of a command's results: a folder with a Markdown report and figures, or a JSON file, known by its keys."""

import base64
import fnmatch
import glob
import json
import os
import re
import shlex
from html import escape
from pathlib import Path
from typing import Any, Final, NamedTuple

from markdown_it import MarkdownIt

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import MIB, read_bytes, read_text
from ortilo_drake.views.page.shell import facts, versions, whole_page


class Kind(NamedTuple):
    """A kind of file that a command writes."""

    command: str
    """the command, up to its scenario or preset."""
    keys: frozenset[str]
    """keys that identify the command's JSON file, or each row if the file is a list."""
    subject: str | None = None
    """the dotted key of the scenario or preset in the JSON file; None if the file does not name it."""
    heading: str | None = None
    """pattern of the heading of the .md file, whose group is the scenario or preset; None without an .md file."""
    figures: str = ""
    """pattern of the stems of the figures (PNG or SVG) in the folder; {} stands for the scenario or preset."""
    takes_subject: bool = True
    """whether the scenario or preset is the command's argument; for a sweep, for example, the argument is a file."""

    @property
    def name(self) -> str:
        """The command without the option that takes the scenario or preset."""
        return self.command.split(" --")[0]


SHOWN: Final = {".png": "image/png", ".svg": "image/svg+xml"}  # pictures that a page can hold, unlike PDF
_RARE = (
    r"# (.+?)(?:: (?:about|fewer than) one flight in "
    r"| (?:loses its vehicle|strays \S+ m or more from its (?:reference|path))"
    r"(?:: fewer | in (?:about|fewer than) \d+% of flights))"
)
KINDS: Final = (
    Kind("ortilo fly", frozenset({"scenario", "seed", "mse", "arrivals"}), "scenario"),
    Kind(
        "ortilo tables --preset",
        frozenset({"preset", "flights", "estimation", "path", "paper"}),
        "preset",
        r"# The paper's tables, preset '(\w+)'",
        "*_{}",
    ),
    Kind(
        "ortilo analyze",
        frozenset({"scenario", "flights", "no_theory", "no_tube"}),
        "scenario",
        r"# Analysis of (\S+)",
        "*",
    ),
    Kind(
        "ortilo sensitivity",
        frozenset({"scenario", "rows", "limits"}),
        "scenario",
        r"# What must you know, how well: (\S+)",
        "{}",
    ),
    Kind(
        "ortilo faults", frozenset({"scenarios", "flights", "start", "rows"}), None, r"# Faults in flight()", "faults"
    ),
    Kind("ortilo rare", frozenset({"scenario", "verdict", "probability", "independent"}), "scenario", _RARE),
    Kind("ortilo map", frozenset({"sweep", "rows"}), "sweep.scenario", r"# A map of (.+) over ", "map", False),
    Kind("ortilo replay --map", frozenset({"map", "motions"}), None, r"# Recorded motions()", "*"),
    Kind("ortilo fit", frozenset({"uwb", "imu", "intervals", "recordings"})),
    Kind("ortilo predict", frozenset({"noise", "flights", "group"}), None, r"# Predicted flights()", "predicted"),
    Kind("ortilo replay", frozenset({"ticks", "identical", "first_difference"})),
    Kind("ortilo hindsight", frozenset({"scenario", "estimator", "rows", "flights"}), "scenario"),
    Kind(
        "ortilo tune --fly", frozenset({"search", "best", "history", "judged"}), "search.scenario", takes_subject=False
    ),
    Kind("ortilo tune --map", frozenset({"settings", "settings_before", "computed", "motions"})),
    Kind(
        "ortilo tune", frozenset({"scenario", "numbers", "log_likelihood", "counted"}), "scenario", takes_subject=False
    ),
    Kind("ortilo room coverage", frozenset({"scenario", "room", "answer", "over_floor"}), "room", takes_subject=False),
    Kind(
        "ortilo room place", frozenset({"scenario", "candidates", "gain", "landmarks"}), "scenario", takes_subject=False
    ),
    Kind("ortilo room survey", frozenset({"room", "known", "anchors", "covariance"}), "room", takes_subject=False),
    Kind("ortilo detector evaluate", frozenset({"map50", "sets", "ms_per_frame"})),
    Kind("ortilo detector recognise", frozenset({"number", "label", "way", "near"})),
    Kind("ortilo doctor", frozenset({"name", "is_there", "weight", "mend"})),
    Kind("ortilo hil check", frozenset({"identical", "latency_ms", "missed_deadlines", "lost"})),
    Kind("ortilo hil bridge --from", frozenset({"messages", "taken", "estimates", "not_begun"})),
    Kind("ortilo hil bridge", frozenset({"ticks", "without_world", "without_answer"})),
    Kind("ortilo hil world", frozenset({"ticks", "packets", "rejected", "lost"})),
    Kind("ortilo hil onboard", frozenset({"ticks", "packets", "rejected"})),
    Kind("ortilo hil onboard --profile", frozenset({"block", "median_us", "p99_us", "share"})),
    Kind("ortilo hil relay", frozenset({"to_onboard", "to_world"})),
)
_GROUPS = dict.fromkeys(kind.name.split()[1] for kind in KINDS)
ALLOWED: Final = f"must be a flight's .nc, or the --out folder or --json file of {', '.join(_GROUPS)}"


def kind_of(data: Any) -> Kind | None:
    """Return the kind of a JSON file's data; None if no command of KINDS wrote them."""
    if isinstance(data, list):
        data = data[0] if data and all(isinstance(row, dict) and row.keys() == data[0].keys() for row in data) else None
    return next((kind for kind in KINDS if isinstance(data, dict) and kind.keys <= data.keys()), None)


def command_of(kind: Kind, subject: str) -> str:
    """Return the command line that wrote a file, as far as it is known."""
    return f"{kind.command} {shlex.quote(subject)}" if subject and kind.takes_subject else kind.command


def figures_of(kind: Kind, subject: str, folder: Path) -> list[Path]:
    """Return the figures of a report in its folder; a subject's name cannot lead to another folder."""
    pattern = kind.figures.format(glob.escape(subject))
    return [
        file for file in sorted(folder.iterdir()) if file.suffix in SHOWN and fnmatch.fnmatchcase(file.stem, pattern)
    ]


def subject_of(kind: Kind, data: Any) -> str:
    """Return the scenario or preset in a JSON file's data; empty if there is none."""
    for key in kind.subject.split(".") if kind.subject else ():
        data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, str) else ""


def kinds_of_report(text: str) -> list[tuple[Kind, str]]:
    """Return the kinds that match a Markdown report, each with its scenario or preset; empty if none matches."""
    found = [(kind, re.match(kind.heading, text)) for kind in KINDS if kind.heading]
    return [(kind, match[1]) for kind, match in found if match]


LARGEST_JSON = 16 * MIB  # short lists and objects take thirty times as much memory when parsed
LARGEST_FIGURE = 16 * MIB
LARGEST_FOLDER = 64 * MIB  # limit of a folder's figures and the HTML of its reports together
_PNG = b"\x89PNG\r\n\x1a\n"
# HTML in a report is shown as text, and no link leads out of the page.
_MARKDOWN: Final = MarkdownIt("commonmark", {"html": False}).enable("table")
_MARKDOWN.disable(["link", "image", "autolink", "reference"])


def markdown_html(text: str) -> str:
    """Return a Markdown text as HTML; HTML inside the text is shown as text."""
    return str(_MARKDOWN.render(text))


def report_page(path: Path) -> str:
    """Return one self-contained page of a folder or a JSON file.

    InputError, naming the file, if no command of KINDS wrote it or it cannot be read.
    """
    return _of_folder(path) if os.path.isdir(path) else _of_json(path)


def _of_json(path: Path) -> str:
    content = read_bytes(path, LARGEST_JSON)
    try:
        data = json.loads(content)
        body = data_html(data if isinstance(data, dict) else {"rows": data})
    except (ValueError, RecursionError):  # RecursionError: too deeply nested lists
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
    """Raise InputError if a file of a folder is a link to a file outside the folder."""
    inside = os.path.realpath(folder)
    if os.path.commonpath([inside, os.path.realpath(file)]) != inside:
        raise InputError(f"{file}: is a link out of the folder: must be in it")


def _picture(file: Path) -> bytes:
    data = read_bytes(file, LARGEST_FIGURE)
    if not data.startswith(_PNG if file.suffix == ".png" else b"<?xml"):
        raise InputError(f"{file}: is no {file.suffix[1:].upper()} picture")
    return data


def _figure(file: Path, data: bytes) -> str:
    """Return the HTML of a picture; an image element runs no script of an SVG and loads no file named in the SVG."""
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
    """Return a file's name with a mark in place of each invalid UTF-8 byte."""
    return os.fsencode(name).decode(errors="replace")


MOST_SHOWN = 8  # most values shown of a long list


def data_html(data: dict[str, Any], level: int = 2) -> str:
    """Return the HTML of an object; its nested parts have headings of this level and below."""
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
    """Return whether a value is too deeply nested for a table's cell."""
    return _is_nested(value) and (isinstance(value, list) or any(_is_nested(part) for part in value.values()))


def _words(name: str) -> str:
    return name.replace("_", " ")
