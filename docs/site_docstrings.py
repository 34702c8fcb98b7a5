"""Our docstrings are plain text; Sphinx reads reStructuredText. What would be taken for its marks is kept as it is."""

import re
import sys
from collections.abc import Iterator
from typing import Annotated, Any, get_origin

from sphinx.pycode import ModuleAnalyzer
from sphinx.util import typing as sphinx_typing

_MARKS = re.compile(r"(`[^`]*`)|([\\*_|]|(?<=tcp):)")  # tcp://HOST is no link
_SECTIONS = ("Args:", "Attributes:", "Returns:", "Raises:", "Yields:", "Note:", "Example:")
_BULLET = re.compile(r"(- |\* |\d+\. )")


def as_restructured_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Change a docstring's lines in place: indented equations are set as they stand, all else as text.

    Args: are Sphinx's, for its event autodoc-process-docstring.
    """
    del app, name, obj, options
    changed: list[str] = []
    in_section = False
    for block in _blocks(lines):
        in_section = block[0].strip() in _SECTIONS or (in_section and block[0].startswith(" "))
        if in_section:
            changed += [_escaped(line) for line in block]
        elif block[0].startswith(" ") or not _is_text(block):
            changed += ["::", "", *("    " + line for line in block)]
        else:
            changed += [_escaped(line) for line in block]
        changed.append("")
    if what == "attribute" and changed:
        changed[0] = f": {changed[0]}"  # Napoleon takes the words before the first colon for the type
    lines[:] = changed


def leave_out_bounds() -> None:
    """Let Sphinx print the type alone of an Annotated one: the page Settings has the bounds."""
    whole = sphinx_typing.stringify_annotation

    def bare(annotation: Any, *args: Any, **options: Any) -> str:
        annotated = get_origin(annotation) is Annotated
        return whole(annotation.__origin__ if annotated else annotation, *args, **options)

    for module in list(sys.modules.values()):
        if getattr(module, "stringify_annotation", None) is whole:
            module.stringify_annotation = bare  # type: ignore[attr-defined]


def readable_signature(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, returned: Any
) -> Any:
    """Set ... for defaults such as <factory>: with one that is no Python, Sphinx shows a signature without links."""
    del app, what, name, obj, options
    return signature and re.sub(r"= ?<(?:[^<>]|<[^<>]*>)*>", "= ...", signature), returned


def leave_out(app: Any, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Say whether a member is left out: pydantic's machinery is, and a NamedTuple's field without a sentence."""
    del what, skip, options
    if type(obj).__name__ == "_tuplegetter":  # Python gives each the docstring "Alias for field number 0"
        page = app.env.current_document
        return (page.autodoc_class, name) not in ModuleAnalyzer.for_module(page.autodoc_module).find_attr_docs()
    return name.startswith("model_") or None


def _blocks(lines: list[str]) -> Iterator[list[str]]:
    """Yield what stands between empty lines."""
    block: list[str] = []
    for line in [*lines, ""]:
        if line.strip():
            block.append(line)
        elif block:
            yield block
            block = []


def _is_text(block: list[str]) -> bool:
    """Whether no line of a block is indented, but for those that go on with an entry of a list."""
    entry = bool(_BULLET.match(block[0]))
    return all(bool(_BULLET.match(line)) or line.startswith("  ") if entry else line[0] != " " for line in block)


def _escaped(line: str) -> str:
    if _BULLET.match(line):
        return line[:2] + _escaped(line[2:])
    return _MARKS.sub(lambda found: found[1] or "\\" + found[2], line)
