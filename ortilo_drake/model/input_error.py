"""The one error for bad input: a line for whoever gave it."""

LONGEST = 600  # characters of a line; of a longer one the middle is left out


class InputError(ValueError):
    """Bad input from a user: one line that names the file, the field, the value and what is allowed.

    It may quote a file or a message: line breaks and other control characters are written as escapes, so that one line
    stays one line and a terminal obeys none of it.
    """

    def __init__(self, line: str) -> None:
        super().__init__(one_line(line))


def one_line(text: str) -> str:
    """Return a text as at most LONGEST printable characters, others escaped as in Python."""
    if len(text) > LONGEST:
        part = (LONGEST - 5) // 2
        text = f"{text[:part]} ... {text[-part:]}"
    if text.isprintable():
        return text
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return shown if len(shown) <= LONGEST else one_line(shown)
