"""The text of a MAP.yaml with new numbers in its `filter`; comments and layout stay as they are."""

from collections.abc import Mapping
from pathlib import Path

import yaml

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.model.input_files import exists, read_text


def map_text(map_: Map) -> str:
    """Return a map as YAML, without default values."""
    return yaml.safe_dump(map_.model_dump(mode="json", exclude_defaults=True), sort_keys=False, allow_unicode=True)


def tuned_map_text(file: Path, map_: Map, numbers: Mapping[str, float], out: Path) -> str:
    """Return the text of the map `file`, read as `map_`, with new numbers of its filter, to be written to `out`.

    A map that names files beside it and goes to another folder is written anew: its old text would not find the files.
    """
    own = [] if map_.boxes is None else [map_.boxes.room, map_.boxes.camera]
    named = yaml.safe_load(read_text(file)).get("anchors")
    beside = [file.parent / name for name in (*own, named) if isinstance(name, str)]
    if file.resolve().parent != out.resolve().parent and any(exists(one) for one in beside):
        return map_text(map_.model_copy(update={"filter": map_.filter.model_copy(update=dict(numbers))}))
    changed = {name: number for name, number in numbers.items() if number != getattr(map_.filter, name)}
    told = f"# `ortilo tune` fitted {', '.join(changed)}; a comment beside one is of the number before.\n"
    return told * bool(changed) + with_filter(read_text(file), changed)


def with_filter(text: str, numbers: Mapping[str, float]) -> str:
    """Return a map's text in which these numbers of the filter replace its own or are added."""
    root = yaml.compose(text, yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    held = next((value for key, value in root.value if key.value == "filter"), None)
    written = {name: yaml.safe_dump(number).split()[0] for name, number in numbers.items()}
    if not isinstance(held, yaml.MappingNode):
        entries = ", ".join(f"{name}: {number}" for name, number in written.items())
        return _added(text, root, [f"filter: {{{entries}}}"]) if written else text
    there = {key.value: value for key, value in held.value if key.value in written}
    text = _added(text, held, [f"{name}: {written[name]}" for name in written if name not in there])
    for name in sorted(there, key=lambda name: -there[name].start_mark.index):  # last first: earlier marks stay valid
        node = there[name]
        text = text[: node.start_mark.index] + written[name] + text[node.end_mark.index :]
    return text


def _added(text: str, mapping: yaml.MappingNode, entries: list[str]) -> str:
    """Return the text with entries added at the end of a mapping: within its braces, or on their own lines."""
    if not entries:
        return text
    if mapping.flow_style:
        before = text[: mapping.end_mark.index - 1].rstrip().removesuffix(",")
        return f"{before}{', ' * bool(mapping.value)}{', '.join(entries)}" + text[mapping.end_mark.index - 1 :]
    last = mapping.value[-1][1].end_mark.index  # for a block this is the start of the text that follows it
    line_end = text.find("\n", last - (text[last - 1] == "\n"))
    at = len(text) if line_end < 0 else line_end + 1
    indent = " " * mapping.start_mark.column
    return text[:at].rstrip("\n") + "".join(f"\n{indent}{entry}" for entry in entries) + "\n" + text[at:]
