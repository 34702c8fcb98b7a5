"""The text of a Darknet .cfg as sections of keys and values, read as Darknet reads it (parser.c, option_list.c).

Darknet drops all spaces and tabs. A line that begins with '#' or ';' is a comment. Of a numeric value it reads the
number at the beginning: '21 #255' is 21. The first of two equal keys counts. A key without a value has its default. A
word cannot have a comment after it: 'leaky #mish' is not an activation.
"""

import re
from dataclasses import dataclass

from ortilo_drake.model.typed_yaml import InputError

MAX_SECTIONS = 1000

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)  # the numbers that C's atof reads
_WHOLE = re.compile(r"[+-]?\d{1,9}", re.ASCII)  # the numbers that C's atoi reads
_SPACES = str.maketrans("", "", " \t\r")
_ALIASES = {"conv": "convolutional", "max": "maxpool", "network": "net", "silence": "empty"}


@dataclass(frozen=True)
class Section:
    """A section as text; `values` has the line and the value of each key, None for a key without a value."""

    source: str
    line: int
    name: str
    values: dict[str, tuple[int, str | None]]

    @property
    def kind(self) -> str:
        """The full name of the section's kind: [conv] is short for convolutional."""
        return _ALIASES.get(self.name, self.name)

    def fault(self, text: str) -> InputError:
        """Return the InputError of the whole section."""
        return InputError(f"{self.source}: line {self.line}: [{self.name}]: {text}")

    def error(self, key: str, allowed: str) -> InputError:
        """Return the InputError of a key's value, with the section's line for a key that is not there."""
        line, value = self.values.get(key, (self.line, None))
        if value is None:
            return InputError(f"{self.source}: line {line}: [{self.name}] {key}: {allowed}")
        shown = repr(value if len(value) <= 60 else value[:57] + "...")
        return InputError(f"{self.source}: line {line}: [{self.name}] {key}: {shown}: {allowed}")

    def text(self, key: str) -> str | None:
        """Return a key's value, None if it has none."""
        return self.values.get(key, (0, None))[1]

    def numbers(self, key: str, whole: bool, comment: bool = False, most: int | None = None) -> list[float]:
        """Return a value's numbers, which are separated by commas; at most the first `most`, integers if `whole`.

        With `comment`, '#' ends the list. Without it, Darknet also reads the numbers after each comma of a comment.
        """
        value = self.text(key)
        if value is None:
            raise self.error(key, "is missing")
        parts = (value.partition("#")[0] if comment else value).split(",")[:most]
        found = [(_WHOLE if whole else _NUMBER).match(part) for part in parts]
        if not all(found):
            raise self.error(key, f"must be {'whole ' if whole else ''}numbers separated by commas")
        return [float(match.group()) for match in found if match]

    def whole(self, key: str, low: int, high: int, default: int | None = None) -> int:
        """Return a key's whole number from `low` to `high`; without a default the key must be there."""
        value = self.text(key)
        if value is None and default is not None:
            return default
        if value is None:
            raise self.error(key, "is missing")
        match = _WHOLE.match(value)
        if match is None or not low <= int(match.group()) <= high:
            raise self.error(key, f"must be {low}" if low == high else f"must be a whole number from {low} to {high}")
        return int(match.group())

    def number(self, key: str, default: float) -> float:
        """Return a key's number, or the default."""
        value = self.text(key)
        if value is None:
            return default
        match = _NUMBER.match(value)
        if match is None:
            raise self.error(key, "must be a number")
        return float(match.group())

    def choice(self, key: str, allowed: tuple[str, ...], default: str) -> str:
        """Return a key's word, which must be one of the allowed words, or the default."""
        value = self.text(key) or default
        if value not in allowed:
            note = "; Darknet reads a comment after a word as part of it" if "#" in value or ";" in value else ""
            raise self.error(key, f"must be one of {', '.join(allowed)}{note}")
        return value


def read_sections(text: str, source: str) -> list[Section]:
    """Return the sections of a .cfg's text, [net] first; InputError if the text does not have this form."""
    sections: list[Section] = []
    for line, raw in enumerate(text.removeprefix("\ufeff").split("\n"), start=1):
        content = raw.translate(_SPACES)
        if not content or content[0] in "#;":
            continue
        if content[0] == "[":
            if content[-1] != "]":
                raise InputError(f"{source}: line {line}: {content[:60]!r}: must be [name] with nothing behind it")
            sections.append(Section(source, line, content[1:-1], {}))
            continue
        if not sections:
            raise InputError(f"{source}: line {line}: {content[:60]!r}: must come after [net]")
        key, equals, value = content.partition("=")
        if value or not equals:  # Darknet ignores 'key='
            sections[-1].values.setdefault(key, (line, value or None))
    if not sections or sections[0].kind != "net":
        line = sections[0].line if sections else 1
        raise InputError(f"{source}: line {line}: the first section must be [net] or [network]")
    if len(sections) > MAX_SECTIONS:
        raise InputError(f"{source}: {len(sections)} sections: must not be more than {MAX_SECTIONS}")
    return sections
