"""The keys of a schema that an unknown key may have been meant for: mistyped, or looked for in another group."""

from collections.abc import Iterable, Iterator
from difflib import SequenceMatcher, get_close_matches
from typing import Any, NamedTuple

_ALIKE = 0.75  # least likeness of the last word of a key elsewhere; in the same group difflib's 0.6 is enough
_MOST = 3  # keys in an answer

Words = tuple[str, ...]


class Known(NamedTuple):
    """A key of a schema: the words of its dotted name, and the kinds of the groups around it ('' if they have none)."""

    words: Words
    kind: str


def keys_of(schema: dict[str, Any]) -> frozenset[Known]:
    """Return every key of a JSON schema but those within lists, which no dotted key names."""
    return frozenset(_keys(schema, schema, (), ""))


def _keys(schema: dict[str, Any], part: dict[str, Any], above: Words, kind: str) -> Iterator[Known]:
    if "$ref" in part:
        part = schema["$defs"][part["$ref"].rpartition("/")[2]]
    for other in (*part.get("anyOf", ()), *part.get("oneOf", ())):
        yield from _keys(schema, other, above, kind)
    fields = part.get("properties", {})
    own = fields.get("kind", {}).get("const")
    kind = f"{kind}, {own}" if kind and own else own or kind
    for name, field in fields.items():
        yield Known((*above, name), kind)
        yield from _keys(schema, field, (*above, name), kind)


def words_of(name: str, value: Any) -> Words:
    """Return an unknown key and the keys below it, as long as each group holds one setting."""
    words = [name]
    while isinstance(value, dict) and len(value) == 1:
        name, value = next(iter(value.items()))
        words.append(str(name))
    return tuple(words)


def did_you_mean(keys: frozenset[Known], group: Words, words: Words, siblings: Iterable[str]) -> str:
    """Return ", did you mean 'x.y'?" for the keys that words of no key may have been meant for, or nothing.

    The words are an unknown key in a group, which has siblings, and the keys below it as far as there is one each. In
    this order: a key of that very name below the group, or in another kind of it; a sibling that is nearly the same; a
    key of that name in another group; one there that is nearly the same.
    """
    inside = [key for key in keys if key.words[: len(group)] == group]
    kinds = sorted({key.kind for key in inside if key.kind and key.words == (*group, *words)})
    if kinds and len(words) == 1:
        return f", did you mean kind {' or '.join(kinds)}, which has '{'.'.join((*group, *words))}'?"
    hint = _ending_in(inside, words) if group else ""
    hint = hint or nearest(words[0], siblings)
    if hint:
        return hint
    alike = {key: SequenceMatcher(None, key.words[-1], words[-1]).ratio() for key in keys if key.words[-1] != "kind"}
    most = max(alike.values(), default=0.0)
    hint = _ending_in(keys, words) or _question([key for key in alike if alike[key] == most >= _ALIKE], ())
    known = ", ".join(siblings)
    return f"{hint} {'.'.join(group)} has {known}" if hint and group else hint


def _ending_in(keys: Iterable[Known], words: Words) -> str:
    """Return the question for the keys that end in the most of the words, from the first on."""
    for n in range(len(words), 0, -1):
        same = [key for key in keys if key.words[-n:] == words[:n]]
        if same:
            return _question(same, words[n:])
    return ""


def _question(found: list[Known], rest: Words) -> str:
    kinds: dict[Words, list[str]] = {}
    for key in sorted(found, key=lambda key: (len(key.words), key)):
        kinds.setdefault(key.words, []).append(key.kind)
    named = [
        f"'{'.'.join((*words, *rest))}'" + (f" (kind {' or '.join(sorted(its))})" if all(its) else "")
        for words, its in kinds.items()
    ]
    if not named:
        return ""
    return f", did you mean {' or '.join(named[:_MOST])}{', ...' if len(named) > _MOST else ''}?"


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ", did you mean 'x'?" for the known word nearest to one that is unknown, or nothing if none is near."""
    by_lower = {name.lower(): name for name in known}
    begun = [name for name in by_lower if len(word) > 2 and name.startswith(word.lower())]  # a word cut short
    found = sorted(begun, key=len) or get_close_matches(word.lower(), by_lower, n=1)
    return f", did you mean '{by_lower[found[0]]}'?" if found else ""
