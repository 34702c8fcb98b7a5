"""Text from other processes, made safe for a terminal."""


def plain(text: str) -> str:
    """Return a text with U+FFFD in place of each character that str.isprintable refuses.

    These are the control characters of C0 and C1 (with ESC), characters that change the direction of writing or are
    invisible, line and paragraph separators, surrogates, and characters that Unicode has not assigned.
    """
    return "".join(character if character.isprintable() else "\ufffd" for character in text)
