"""The paper's block diagram as an SVG picture: blocks in signal order, feedback below them, shortcuts above them."""

from collections.abc import Iterable
from html import escape
from typing import NamedTuple

from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.views.blocks import COLUMNS, WORLD, Block, blocks_of, signals_between
from ortilo_drake.views.palette import BLUE, ORANGE

WIDE, HIGH, GAP, ROW, LANE, MARGIN = 96, 46, 88, 78, 26, 34  # width and height of a block, distances [px]
SLIDE = 1920  # width of the picture in its own file [px]
LABEL = 11  # largest number of characters in a line beside an arrow between neighbours
STACKED = ("sensor", "fix")  # columns with a row for each sensor; all other columns have one block
STYLE = """
.blocks .node rect { fill: #fff; stroke: #1f2733; stroke-width: 1.4 }
.blocks .edge path { fill: none; stroke: #1f2733; stroke-width: 1.2 }
.blocks text { font: 14px Helvetica, Arial, sans-serif; fill: #1f2733; text-anchor: middle }
.blocks .signal { font: italic 14px Georgia, "Times New Roman", serif }
.blocks .half { font-size: 11.5px; fill: #5a6675; text-anchor: start }
"""
HEAD = """<svg class="blocks" xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}"
 viewBox="0 0 {w:g} {h:g}">
<style>{style}</style>
<defs><marker id="head" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">
<path d="M0 0.5 L8 4 L0 7.5 z" style="fill: #1f2733; stroke: none"/></marker></defs>
<rect width="100%" height="100%" rx="6" style="fill: #fff"/>
"""


class Placed(NamedTuple):
    """A block's place: its column and row (-1 if it is alone in its column), its left, top and height."""

    column: int
    row: int
    left: float
    top: float
    high: float

    @property
    def right(self) -> float:
        """The x of the block's right edge [px]."""
        return self.left + WIDE

    @property
    def middle(self) -> float:
        """The y of the block's middle [px]."""
        return self.top + self.high / 2


class Net(NamedTuple):
    """A signal that passes other blocks: its source, whether it passes above them, its targets and names."""

    source: str
    above: bool
    targets: list[str]
    names: list[str]


def block_picture(wiring: Wiring) -> str:
    """Return the paper's block diagram of a scenario's wiring as SVG."""
    blocks = blocks_of(wiring)
    signals = signals_between(wiring, blocks)
    columns = [column for column in COLUMNS if any(block.column == column for block in blocks.values())]
    rows = [name for name, block in blocks.items() if block.column == "sensor"]
    cells = {name: (columns.index(b.column), _row(b, rows)) for name, b in blocks.items()}
    straight = {(a, b): names for (a, b), names in signals.items() if _is_straight(cells[a], cells[b], cells)}
    nets = nets_of({pair: names for pair, names in signals.items() if pair not in straight}, cells)
    lanes_above = sum(net.above for net in nets)
    top = MARGIN + LANE * lanes_above
    placed = {name: _placed(name, cells, straight, top, len(rows)) for name in blocks}

    width = max(its.right for its in placed.values()) + MARGIN + 14
    bottom = top + ROW * max(len(rows) - 1, 0) + HIGH
    height = bottom + 30 + LANE * (len(nets) - lanes_above)
    drawn = [HEAD.format(wide=SLIDE, high=round(SLIDE * height / width), w=width, h=height, style=STYLE)]
    drawn += halves(columns, top, bottom)
    drawn += [between(pair, names, placed) for pair, names in straight.items()]
    drawn += detours(nets, placed, straight, top, bottom)
    drawn += [block_box(blocks[name], its) for name, its in placed.items()]
    return "\n".join([*drawn, "</svg>\n"])


def _row(block: Block, rows: list[str]) -> int:
    """Return the row of a sensor's block or of its fix's block; -1 for any other block."""
    return rows.index(block.name.removesuffix(" fix")) if block.column in STACKED else -1


Cell = tuple[int, int]


def _is_straight(source: Cell, target: Cell, cells: dict[str, Cell]) -> bool:
    """Return whether a straight arrow between two blocks crosses no other block."""
    (first, row), (last, other) = source, target
    if first >= last or (row >= 0 and other >= 0 and row != other):
        return False
    its = max(row, other)
    between = [r for column, r in cells.values() if first < column < last]
    return not between or (its >= 0 and all(r >= 0 and r != its for r in between))


def _placed(name: str, cells: dict[str, Cell], straight: Iterable[tuple[str, str]], top: float, rows: int) -> Placed:
    column, row = cells[name]
    left = MARGIN + column * (WIDE + GAP)
    if row >= 0:
        return Placed(column, row, left, top + ROW * row, HIGH)
    reached = any(name in pair and max(cells[pair[0]][1], cells[pair[1]][1]) >= 0 for pair in straight)
    whole = ROW * max(rows - 1, 0) + HIGH
    high = whole if reached else HIGH
    return Placed(column, row, left, top + (whole - high) / 2, high)


def nets_of(signals: dict[tuple[str, str], list[str]], cells: dict[str, Cell]) -> list[Net]:
    """Return the signals that pass other blocks, the shortest first: forward signals pass above, feedback below."""
    found: dict[tuple[str, bool], Net] = {}
    for (source, target), names in signals.items():
        above = cells[source][0] < cells[target][0]
        net = found.setdefault((source, above), Net(source, above, [], []))
        net.targets.append(target)
        net.names.extend(name for name in names if name not in net.names)
    return sorted(found.values(), key=lambda n: max(abs(cells[n.source][0] - cells[t][0]) for t in n.targets))


def halves(columns: list[str], top: float, bottom: float) -> list[str]:
    """Return the backgrounds of the world's half and of the onboard half."""
    drawn, runs = [], list[tuple[bool, int, int]]()
    for i, column in enumerate(columns):
        world = column in WORLD
        runs = [*runs[:-1], (world, runs[-1][1], i)] if runs and runs[-1][0] == world else [*runs, (world, i, i)]
    for world, first, last in runs:
        left, right = (MARGIN + i * (WIDE + GAP) for i in (first, last))
        color, said = (ORANGE, "world") if world else (BLUE, "onboard")
        size = f'x="{left - 20}" y="{top - 24}" width="{right - left + WIDE + 40}" height="{bottom - top + 40}"'
        drawn.append(f'<rect {size} rx="8" style="fill: {color}; opacity: 0.1"/>')
        drawn.append(f'<text class="half" x="{left - 8}" y="{top - 11}">{said}</text>')
    return drawn


def block_box(block: Block, its: Placed) -> str:
    """Return the SVG of a block: a box with the block's name, and a tooltip with the names of its boxes."""
    said = escape(f"{block.name}: {', '.join(block.boxes)}")
    fit = f' textLength="{WIDE - 8}" lengthAdjust="spacingAndGlyphs"' if len(block.name) > 11 else ""
    return (
        f'<g class="node"><title>{said}</title>'
        f'<rect x="{its.left}" y="{its.top}" width="{WIDE}" height="{its.high}"/>'
        f'<text x="{its.left + WIDE / 2}" y="{its.middle + 5}"{fit}>{escape(block.name)}</text></g>'
    )


def between(pair: tuple[str, str], names: list[str], placed: dict[str, Placed]) -> str:
    """Return the SVG of a straight arrow with the names of its signals."""
    source, target = (placed[name] for name in pair)
    y = _line(source, target)
    x = source.right + (GAP - 14) / 2
    lines = _lines(names)
    texts = [_signal(line, x, y - 7 if i == 0 else y + 2 + 16 * i) for i, line in enumerate(lines)]
    return arrow(pair, names, f"M{source.right} {y} H{target.left}") + "".join(texts)


def _line(source: Placed, target: Placed) -> float:
    """Return the y of a straight arrow [px]."""
    return next((its.middle for its in (source, target) if its.row >= 0), source.middle)


def _lines(names: list[str]) -> list[str]:
    """Return the names, joined to lines of at most LABEL characters where they fit."""
    lines = [names[0]]
    for name in names[1:]:
        longer = f"{lines[-1]}, {name}"
        lines = [*lines[:-1], longer] if len(longer) <= LABEL else [*lines, name]
    return lines


def detours(
    nets: list[Net], placed: dict[str, Placed], straight: Iterable[tuple[str, str]], top: float, bottom: float
) -> list[str]:
    """Return the SVG of the arrows that pass other blocks; each net has its own lane."""
    drawn = []
    for above in (True, False):
        side = [net for net in nets if net.above == above]
        for i, net in enumerate(side):
            lane = top - 34 - LANE * i if above else bottom + 40 + LANE * i
            source = placed[net.source]
            leaves = [_line(source, placed[target]) for name, target in straight if name == net.source]
            y = (min if above else max)(leaves, default=source.middle)
            x = source.right + (12 if above or len({n.above for n in nets if n.source == net.source}) < 2 else 22)
            x += 8 * sum(
                placed[other.source].column == source.column for other in side[i + 1 :]
            )  # two nets that start in the same column are drawn apart
            start = f"M{x} {y} V{lane}" if leaves else f"M{source.right} {y} H{x} V{lane}"
            ends = [_end(net, target, placed, side) for target in net.targets]
            far = (max if above else min)(x_end for x_end, _ in ends)
            for target, (x_end, end) in zip(net.targets, ends, strict=True):
                path = f"{start} H{x_end} {end}" if x_end == far else f"M{x_end} {lane} {end}"
                drawn.append(arrow((net.source, target), net.names, path))
            dots = [(x_end, lane) for x_end, _ in ends if x_end != far] + ([(x, y)] if leaves else [])
            drawn += [f'<circle cx="{x}" cy="{y}" r="2.6" style="fill: #1f2733"/>' for x, y in dots]
            said = net.source if net.names == ["fix"] else ", ".join(net.names)
            drawn.append(_signal(said, x + (1 if above else -1) * (12 + 4 * len(said)), lane - 5))
    return drawn


def _end(net: Net, target: str, placed: dict[str, Placed], side: list[Net]) -> tuple[float, str]:
    """Return the x at which a net leaves its lane for a target, and the SVG path from there; `side` has its nets."""
    its = placed[target]
    rows = [other.row for other in placed.values() if other.column == its.column]
    if its.row == (min if net.above else max)(rows):
        inputs = [other for other in side if target in other.targets]
        at = (inputs.index(net) + 1) / (len(inputs) + 1)
        return its.left + WIDE * (at if net.above else 1 - at), f"V{its.top if net.above else its.top + its.high}"
    y = its.middle + HIGH / 4 * (-1 if net.above else 1)
    return its.left - 14, f"V{y} H{its.left}"


def arrow(pair: tuple[str, str], names: list[str], path: str) -> str:
    """Return an arrow along a path, with its name, source and target as a browser's tooltip."""
    said = escape(f"{', '.join(names)}: {pair[0]} → {pair[1]}")
    return f'<g class="edge"><title>{said}</title><path d="{path}" marker-end="url(#head)"/></g>'


def _signal(said: str, x: float, y: float) -> str:
    return f'<text class="signal" x="{x}" y="{y}">{escape(said)}</text>'
