"""Text from other processes, made safe for a terminal."""


def plain(text: str) -> str:
    """Return a text with U+FFFD for each character that is not shown as itself.

    That is every control character of C0 and C1 (ESC among them), those that turn the direction of writing or are
    invisible, line and paragraph separators, surrogates, and what Unicode has not assigned: str.isprintable.
    """
    return "".join(character if character.isprintable() else "\ufffd" for character in text)
