"""JSON data as HTML: tables where rows are alike, names and values elsewhere."""

from html import escape
from typing import Any

from ortilo_drake.views.page.plain_markdown import html_table
from ortilo_drake.views.page.shell import facts

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
            return html_table(header, [[_words(name), *map(cell, row.values())] for name, row in value.items()])
    return data_html(value, level)


def _is_nested(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(part, dict) for part in value))


def _is_deep(value: Any) -> bool:
    """Return whether a value is too much for a cell."""
    return _is_nested(value) and (isinstance(value, list) or any(_is_nested(part) for part in value.values()))


def _words(name: str) -> str:
    return name.replace("_", " ")
