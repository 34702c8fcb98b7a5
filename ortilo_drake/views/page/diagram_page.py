"""The wiring of a scenario in three depths as one page, with zoom."""

import re
from html import escape

from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.views.page.shell import asset
from ortilo_drake.views.wiring_picture import wiring_picture

DEPTHS = {"the paper's blocks": 1, "every box": 2, "every element": 3}


def _inline(svg: str) -> str:
    """Return the svg element of an SVG file, without the header that a page must not contain."""
    found = re.search(r"<svg.*</svg>", svg, re.DOTALL)
    assert found is not None
    return found.group()


def diagram_page(scenario: str, wiring: Wiring) -> str:
    """Return a page with a scenario's wiring under the scenario's name; InputError if Graphviz is not installed."""
    name = escape(scenario)
    buttons = "".join(f'<button type="button" data-depth="{depth}">{title}</button>' for title, depth in DEPTHS.items())
    parts = "".join(f'<div class="depth">{_inline(wiring_picture(wiring, depth))}</div>' for depth in DEPTHS.values())
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{name}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<style>\n{asset('diagram.css')}</style>\n</head>\n<body>\n<header><h1>{name}</h1>{buttons}"
        '<button type="button" id="whole">whole picture</button>'
        "<span>drag to move, wheel or pinch to zoom</span></header>\n"
        f'<main id="frame">{parts}</main>\n<script>\n{asset("diagram.js")}</script>\n</body>\n</html>\n'
    )
