"""The text of a Darknet .cfg as sections of keys and values, each with its line for errors."""

import re
from dataclasses import dataclass

from ortilo_drake.model.typed_yaml import InputError

MAX_SECTIONS = 1000

_NUMBER = re.compile(r"[+-]?(\d{1,9}(\.\d{0,9})?|\.\d{1,9})", re.ASCII)
_WHOLE = re.compile(r"[+-]?\d{1,9}", re.ASCII)


@dataclass(frozen=True)
class Section:
    """A section as text; of each key its line and value."""

    source: str
    line: int
    name: str
    values: dict[str, tuple[int, str]]

    def fault(self, text: str) -> InputError:
        """Return the error of the whole section."""
        return InputError(f"{self.source}: line {self.line}: [{self.name}]: {text}")

    def error(self, key: str, allowed: str) -> InputError:
        """Return the error of a key's value, or of the whole section for a key that is not there."""
        if key not in self.values:
            return InputError(f"{self.source}: line {self.line}: [{self.name}] {key}: {allowed}")
        line, value = self.values[key]
        shown = repr(value if len(value) <= 60 else value[:57] + "...")
        return InputError(f"{self.source}: line {line}: [{self.name}] {key}: {shown}: {allowed}")

    def text(self, key: str) -> str:
        """Return a value that must be there."""
        if key not in self.values:
            raise self.error(key, "is missing")
        return self.values[key][1]

    def numbers(self, key: str, whole: bool) -> list[float]:
        """Return a value's numbers, separated by commas."""
        parts = [part.strip() for part in self.text(key).split(",")]
        if not all((_WHOLE if whole else _NUMBER).fullmatch(part) for part in parts):
            raise self.error(key, f"must be {'whole ' if whole else ''}numbers separated by commas")
        return [float(part) for part in parts]

    def whole(self, key: str, low: int, high: int) -> int:
        """Return a whole number between low and high."""
        value = self.text(key)
        if not _WHOLE.fullmatch(value) or not low <= int(value) <= high:
            raise self.error(key, f"must be a whole number from {low} to {high}")
        return int(value)

    def choice(self, key: str, allowed: tuple[str, ...]) -> str:
        """Return one of the allowed values."""
        if self.text(key) not in allowed:
            raise self.error(key, f"must be one of {', '.join(allowed)}")
        return self.text(key)


def read_sections(text: str, source: str) -> list[Section]:
    """Return the sections of a .cfg's text, [net] first; InputError if it is not of that form."""
    sections: list[Section] = []
    for line, raw in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        content = raw.strip()
        if not content or content[0] in "#;":
            continue
        if content[0] == "[" and content[-1] == "]":
            sections.append(Section(source, line, content[1:-1].strip(), {}))
            continue
        key, equals, value = (part.strip() for part in content.partition("="))
        if not key or not equals or not value:
            raise InputError(f"{source}: line {line}: {content[:60]!r}: must be [section], key = value or # comment")
        if not sections:
            raise InputError(f"{source}: line {line}: {content[:60]!r}: must come after [net]")
        if key in sections[-1].values:
            raise sections[-1].error(key, f"stands again in line {line}")
        sections[-1].values[key] = (line, value)
    if not sections or sections[0].name != "net":
        line = sections[0].line if sections else 1
        raise InputError(f"{source}: line {line}: the first section must be [net]")
    if len(sections) > MAX_SECTIONS:
        raise InputError(f"{source}: {len(sections)} sections: must not be more than {MAX_SECTIONS}")
    return sections
