"""Equations as MathML, which browsers draw by themselves: no JavaScript, nothing from a network."""

import re
from typing import Any, Final

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.errors import SphinxError

_SAME: Final = {r"\dots": r"\ldots", r"\lvert": r"\vert", r"\rvert": r"\vert", r"\lVert": r"\Vert", r"\rVert": r"\Vert"}
# Docutils sets the index of a letter with an accent under it, and not beside it: braces that hold nothing prevent it.
_ACCENT: Final = re.compile(r"\\(?:bar|ddot|dot|hat|tilde)(?![A-Za-z])\s*(?:\\[A-Za-z]+|\{[^{}]*\}|[A-Za-z])")


def draw_inline(writer: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    writer.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def draw_block(writer: Any, node: nodes.math_block) -> None:
    """Write an equation of its own, of one line or several."""
    writer.body.append(f'<div class="equation">{mathml(node.astext(), as_block=True)}</div>\n')
    raise nodes.SkipNode


def mathml(tex: str, as_block: bool = False) -> str:
    """Return LaTeX as MathML.

    Raises:
        SphinxError: if docutils does not know what stands there.
    """
    known = re.sub(r"\\[A-Za-z]+", lambda found: _SAME.get(found[0], found[0]), tex)
    known = _ACCENT.sub(lambda found: f"{{{{}}{found[0]}}}", known)
    try:
        drawn: str = tex2mathml(known, as_block=as_block)
    except MathError as error:
        raise SphinxError(f"equation {tex!r}: {error}") from None
    return drawn
