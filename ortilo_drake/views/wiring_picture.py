"""The wiring of a scenario as an SVG picture in three depths: the paper's blocks, boxes, boxes with their elements.

The module also has Drake's picture of the closed loop. Graphviz draws everything except depth 1.
"""

import shutil
import subprocess
from collections.abc import Iterator
from html import escape

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.loop.element import Box
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.views.block_picture import block_picture
from ortilo_drake.views.blocks import WORLD, arrows_of, blocks_of
from ortilo_drake.views.palette import BLUE, ORANGE
from ortilo_drake.views.wiring_text import kind_of, parts_of, row

OPEN = 4  # depth to which Drake draws nested diagrams: every system
HEAD = """digraph {
rankdir=TB; nodesep=0.15; ranksep=0.35; fontname="Helvetica"; fontsize=11; style="rounded,filled"; color="transparent";
node [shape=box, fontname="Helvetica", fontsize=11, height=0.3, style=filled, fillcolor=white];
edge [fontname="Times-Italic", fontsize=10, arrowsize=0.6];
"""


def wiring_picture(wiring: Wiring, depth: int) -> str:
    """Return a wiring as SVG, in the depths of wiring_text; depths 2 and 3 raise InputError without Graphviz."""
    return block_picture(wiring) if depth == 1 else svg_of("\n".join(graph_of(wiring, depth)))


def graph_of(wiring: Wiring, depth: int) -> Iterator[str]:
    """Yield the lines of a wiring's graph in Graphviz's dot language: boxes in their blocks, and arrows."""
    yield HEAD
    for block in blocks_of(wiring).values():
        color = f"{ORANGE if block.column in WORLD else BLUE}1a"
        yield f'subgraph "cluster {block.name}" {{ label="{block.name}"; fillcolor="{color}";'
        for name in block.boxes:
            yield f'"{name}" [label=<{label_of(wiring, wiring.boxes[name], depth)}>];'
        yield "}"
    said: dict[tuple[str, str], list[str]] = {}
    for arrow in arrows_of(wiring):
        said.setdefault((arrow.wire.box, arrow.reader), []).append(f"{arrow.port} ({arrow.wire.size})")
    for (source, reader), names in said.items():
        text = "\\n".join(names)
        yield f'"{source}" -> "{reader}" [label="{text}"];'
    yield "}"


def label_of(wiring: Wiring, box: Box, depth: int) -> str:
    """Return the label of a box in Graphviz's HTML."""
    lines = [f"<b>{escape(box.name)}</b> ({box.size})"]
    if depth == 3:
        lines.append(escape(kind_of(box)))
        for name, said in parts_of(wiring, box):
            if name not in ("reads", "holds"):
                lines += [escape(line) for line in row((name, said), (10, 60))]
    return '<br align="left"/>'.join(lines) + ('<br align="left"/>' if depth == 3 else "")


def drake_svg(scenario: Scenario) -> str:
    """Return Drake's picture of a scenario's closed loop as SVG; InputError if Graphviz is not installed."""
    return svg_of(make_closed_loop(scenario).GetGraphvizString(max_depth=OPEN))


def svg_of(graph: str) -> str:
    """Return Graphviz's SVG of a graph in the dot language; InputError if Graphviz is not installed."""
    if shutil.which("dot") is None:
        raise InputError("diagram: needs Graphviz's 'dot'; on Debian or Ubuntu: apt-get install graphviz")
    done = subprocess.run(["dot", "-Tsvg"], input=graph, capture_output=True, text=True, check=True)
    return done.stdout
