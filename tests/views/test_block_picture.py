"""The paper's block diagram as a picture: its arrows end at their blocks, go through no other, and blocks lie apart."""

import re
from itertools import combinations, pairwise
from xml.etree import ElementTree

import pytest
from views.test_wiring_text import CASES, richest, wired

from ortilo_drake.views.block_picture import block_picture
from ortilo_drake.views.blocks import blocks_of, signals_between

SVG = "{http://www.w3.org/2000/svg}"
Point = tuple[float, float]
Rect = tuple[float, float, float, float]


def corners(path: str) -> list[Point]:
    """The corners of a path of M, H and V."""
    x = y = 0.0
    found = []
    for letter, numbers in re.findall(r"([MHV])([-\d. ]+)", path):
        values = [float(number) for number in numbers.split()]
        x, y = {"M": (values[0], values[-1]), "H": (values[0], y), "V": (x, values[0])}[letter]
        found.append((x, y))
    return found


def crosses(a: Point, b: Point, rect: Rect) -> bool:
    """Whether a level or upright line goes through the inside of a rectangle."""
    left, top, right, bottom = rect
    return max(a[0], b[0]) > left and min(a[0], b[0]) < right and max(a[1], b[1]) > top and min(a[1], b[1]) < bottom


def upright(line: list[Point]) -> list[tuple[float, float, float]]:
    """The upright pieces of a line: x, upper and lower end."""
    return [(a[0], min(a[1], b[1]), max(a[1], b[1])) for a, b in pairwise(line) if a[0] == b[0] and a[1] != b[1]]


def touches(point: Point, rect: Rect) -> bool:
    left, top, right, bottom = rect
    inside = left <= point[0] <= right and top <= point[1] <= bottom
    return inside and (point[0] in (left, right) or point[1] in (top, bottom))


@richest
@pytest.mark.parametrize("case", CASES)
def test_blocks_and_arrows_are_the_wirings_and_keep_clear_of_each_other(case: str) -> None:
    root = ElementTree.fromstring(block_picture(wired(case)))
    rects: dict[str, Rect] = {}
    for group in root.iter(f"{SVG}g"):
        if group.get("class") == "node":
            x, y, wide, high = (float(group.find(f"{SVG}rect").get(k)) for k in ("x", "y", "width", "height"))  # type: ignore[union-attr, arg-type]
            rects[group.find(f"{SVG}text").text] = (x, y, x + wide, y + high)  # type: ignore[union-attr, index]
    blocks = blocks_of(wired(case))
    assert rects.keys() == blocks.keys()
    for a, b in combinations(rects.values(), 2):
        assert a[0] >= b[2] or b[0] >= a[2] or a[1] >= b[3] or b[1] >= a[3]

    pairs, going = [], []
    width, height = (float(side) for side in (root.get("viewBox") or "").split()[2:])
    for group in root.iter(f"{SVG}g"):
        if group.get("class") == "edge":
            said, path = group.find(f"{SVG}title").text, group.find(f"{SVG}path").get("d")  # type: ignore[union-attr]
            source, target = str(said).rpartition(": ")[2].split(" → ")
            line = corners(str(path))
            pairs.append((source, target))
            going += [(source, *piece) for piece in upright(line)]
            assert touches(line[-1], rects[target])
            assert [name for name, r in rects.items() if any(crosses(a, b, r) for a, b in pairwise(line))] == []
            assert all(0 < x < width and 0 < y < height for x, y in line)
    for (one, x, top, low), (other, x_other, top_other, low_other) in combinations(going, 2):
        assert one == other or x != x_other or max(top, top_other) >= min(low, low_other), (one, other)
    assert sorted(pairs) == sorted(signals_between(wired(case), blocks))
