"""LCM types, read from their .lcm files; the bytes equal those of the code that lcm-gen writes.

A message is the fingerprint of its type (8 bytes) and its fields in order, big-endian. A text is its length and its
bytes with a final 0, which the length includes. An array is its entries; their number is in the type or in an earlier
field. Bytes come only in arrays. The fingerprint is a hash of the fields' names, kinds and sizes.

Source: LCM 1.5, "Type specification language" and lcmgen.c.
"""

import re
import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

CODES: Final = {"int32_t": "i", "int64_t": "q", "double": "d", "boolean": "?"}  # codes of Python's struct
FIELD: Final = re.compile(r"^ +(\w+) (\w+)(?:\[(\w+)\])?;$", re.MULTILINE)
WORD: Final = 2**64


class Field(NamedTuple):
    """A field: its name, its kind, and the size of an array (a number or the name of another field), '' if no array."""

    name: str
    kind: str
    size: str


def _hashed(fields: tuple[Field, ...]) -> bytes:
    """Return the fingerprint of a type that contains no other types."""
    value = 0x12345678

    def update(by: int) -> None:
        nonlocal value
        signed = value - WORD if value >= WORD // 2 else value
        value = (((value << 8) ^ (signed >> 55)) + by) % WORD

    for name, kind, size in fields:
        array = [1, int(not size.isdigit()), len(size), *size.encode()] if size else [0]
        for number in (len(name), *name.encode(), len(kind), *kind.encode(), *array):
            update(number)
    return struct.pack(">Q", (value << 1 | value >> 63) % WORD)


class LcmType:
    """The LCM type in lcmtypes/lcmt_NAME.lcm, with its fields in order and its fingerprint (8 bytes)."""

    def __init__(self, name: str):
        text = (Path(__file__).parent / "lcmtypes" / f"lcmt_{name}.lcm").read_text(encoding="utf-8")
        self.fields = tuple(Field(name, kind, size) for kind, name, size in FIELD.findall(text))
        self.fingerprint = _hashed(self.fields)

    def encode(self, **values: Any) -> bytes:
        """Return the bytes of a message; leave out the fields with sizes of arrays, which are counted."""
        values |= {size: len(values[name]) for name, _, size in self.fields if size and not size.isdigit()}
        parts = [self.fingerprint]
        for name, kind, size in self.fields:
            its: Any = values[name] if size else [values[name]]
            if kind == "string":
                texts = [text.encode() + b"\0" for text in its]
                parts += [struct.pack(">I", len(text)) + text for text in texts]
            elif kind == "byte":
                parts.append(its)
            else:
                parts.append(struct.pack(f">{size if size.isdigit() else len(its)}{CODES[kind]}", *its))
        return b"".join(parts)

    def decode(self, data: bytes) -> SimpleNamespace:
        """Return the fields of a message. The fingerprint is not checked, and a text may be cut short.

        struct.error if any other field is cut short, or if an array of numbers or bytes has a negative size.
        """
        at, values = len(self.fingerprint), dict[str, Any]()

        def take(count: int, code: str) -> tuple[Any, ...]:
            nonlocal at
            its = struct.unpack_from(f">{count}{code}", data, at)
            at += struct.calcsize(f">{count}{code}")
            return its

        def take_text() -> str:
            nonlocal at
            (length,) = take(1, "I")
            text = data[at : at + length][:-1].decode("utf-8", "replace")
            at += length
            return text

        for name, kind, size in self.fields:
            count = 1 if not size else int(size) if size.isdigit() else values[size]
            if kind == "string":
                found: Any = [take_text() for _ in range(count)]
            elif kind == "byte":
                (found,) = take(count, "s")
            else:
                found = take(count, CODES[kind])
            values[name] = found if size else found[0]
        return SimpleNamespace(**values)
