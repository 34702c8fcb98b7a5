"""The error for all bad input: one line for the user."""

LONGEST = 600  # largest number of characters of a line; the middle of a longer line is left out


class InputError(ValueError):
    """Bad input from a user: one line that names the file, the field, the value and the allowed values.

    The line may quote a file or a message. Line breaks and other control characters are written as escapes, so that the
    text stays one line and a terminal does not execute it.
    """

    def __init__(self, line: str) -> None:
        super().__init__(one_line(line))


def one_line(text: str) -> str:
    """Return a text as at most LONGEST printable characters; other characters are escaped as in Python."""
    if len(text) > LONGEST:
        part = (LONGEST - 5) // 2
        text = f"{text[:part]} ... {text[-part:]}"
    if text.isprintable():
        return text
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return shown if len(shown) <= LONGEST else one_line(shown)
