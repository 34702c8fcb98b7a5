"""The keys of a schema that a user may have meant by an unknown key: mistyped, or put in a wrong group."""

from collections.abc import Iterable, Iterator
from difflib import SequenceMatcher, get_close_matches
from typing import Any, NamedTuple

_ALIKE = 0.75  # smallest similarity of the last word of a key in another group; in the same group difflib's 0.6 is used
_MOST = 3  # largest number of keys in an answer

Words = tuple[str, ...]


class Known(NamedTuple):
    """A key of a schema: the words of its dotted name, and the kinds of the groups around it ('' without kinds)."""

    words: Words
    kind: str


def keys_of(schema: dict[str, Any]) -> frozenset[Known]:
    """Return all keys of a JSON schema but those within lists, which have no dotted name."""
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
    """Return an unknown key and the keys below it, down to the first group that does not hold exactly one setting."""
    words = [name]
    while isinstance(value, dict) and len(value) == 1:
        name, value = next(iter(value.items()))
        words.append(str(name))
    return tuple(words)


def did_you_mean(keys: frozenset[Known], group: Words, words: Words, siblings: Iterable[str]) -> str:
    """Return ", did you mean 'x.y'?" for the keys that the user may have meant by an unknown key, or an empty text.

    `words` are the unknown key and the keys below it, see words_of; `group` is the group of the unknown key, `siblings`
    are the known keys of the group. The candidates, in this order: a key of the same name below the group or in another
    kind of the group; a sibling with a similar name; a key of the same name in another group; a key of a similar name
    there.
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
    """Return the question for the keys whose names end in the largest number of the first words."""
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
    """Return ", did you mean 'x'?" for the known word nearest to an unknown word; an empty text if none is near."""
    by_lower = {name.lower(): name for name in known}
    begun = [name for name in by_lower if len(word) > 2 and name.startswith(word.lower())]  # a word cut short
    found = sorted(begun, key=len) or get_close_matches(word.lower(), by_lower, n=1)
    return f", did you mean '{by_lower[found[0]]}'?" if found else ""
