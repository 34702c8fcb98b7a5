"""The frame of every page: one HTML file with its style and script, usable without a network."""

import json
import platform
from functools import lru_cache
from html import escape
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from typing import Any

from ortilo_drake import __version__

Rows = list[tuple[str, str]]


@lru_cache
def asset(name: str) -> str:
    """Return one of the text files beside this module."""
    return (files("ortilo_drake.views.page") / name).read_text(encoding="utf-8")


def versions() -> str:
    """Return the versions of this program, Drake and Python."""
    try:
        drake = version("drake")
    except PackageNotFoundError:
        drake = "built from source"
    return f"ortilo-drake {__version__}, Drake {drake}, Python {platform.python_version()}"


def embedded(data: Any) -> str:
    """Return data as JSON that can be embedded in a script element."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def facts(rows: Rows) -> str:
    """Return a table of names and values; a value that begins with '$ ' is a command."""
    lines = []
    for name, value in rows:
        shown = f"<code>{escape(value[2:])}</code>" if value.startswith("$ ") else escape(value)
        lines.append(f"<tr><th>{escape(name)}</th><td>{shown}</td></tr>")
    return f'<table class="facts">{"".join(lines)}</table>'


def whole_page(title: str, body: str, script: str = "") -> str:
    """Return a page; title is plain text, body is HTML."""
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<title>{escape(title)}</title>\n<style>\n{asset('page.css')}</style>\n</head>\n<body>\n{body}\n"
        + (f"<script>\n{script}</script>\n" if script else "")
        + "</body>\n</html>\n"
    )
