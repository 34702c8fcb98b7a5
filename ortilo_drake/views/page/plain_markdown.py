"""The Markdown of our own reports as HTML: headings, paragraphs, lists and tables."""

import re
from collections.abc import Callable
from html import escape


def markdown_html(text: str) -> str:
    """Return HTML of a Markdown text; HTML in it is shown as text."""
    return "\n".join(_block(block) for block in re.split(r"\n\s*\n", _apart(text)) if block.strip())


def _apart(text: str) -> str:
    """Return the text with an empty line about each heading, list and table."""
    found: list[str] = []
    before = ""
    for line in text.splitlines():
        kind = line[:1] if line[:1] in ("#", "|", "-") else ("p" if line.strip() else "")
        if kind != before or kind == "#":
            found.append("")
        found.append(line)
        before = kind
    return "\n".join(found)


def _block(block: str) -> str:
    lines = block.strip("\n").splitlines()
    heading = re.match(r"(#{1,5})\s+(.*)", lines[0])
    if heading:
        level = len(heading[1])
        return f"<h{level}>{_inline(heading[2])}</h{level}>"
    if lines[0].startswith("|"):
        return _table(lines)
    if lines[0].startswith("- "):
        return "<ul>" + "".join(f"<li>{_inline(line[2:])}</li>" for line in lines) + "</ul>"
    return f"<p>{_inline(' '.join(lines))}</p>"


def _table(lines: list[str]) -> str:
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    rows = [row for row in rows if not all(re.fullmatch(r":?-+:?", cell) for cell in row)]
    return html_table(rows[0], rows[1:], _inline) if rows else ""


def html_table(header: list[str], rows: list[list[str]], shown: Callable[[str], str] = escape) -> str:
    """Return a table; shown makes HTML of a cell's text."""
    head = "".join(f"<th>{shown(cell)}</th>" for cell in header)
    body = "".join("<tr>" + "".join(f"<td>{shown(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _inline(text: str) -> str:
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))
    return re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", text)
