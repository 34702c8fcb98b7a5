"""Tables in Markdown."""

Rows = list[list[str]]


def table(header: list[str], rows: Rows) -> list[str]:
    """Return a Markdown table and the empty line after it."""
    lines = [" | ".join(header), " | ".join("---" for _ in header)]
    return [f"| {line} |" for line in (*lines, *(" | ".join(row) for row in rows))] + [""]
