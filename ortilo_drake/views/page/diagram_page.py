"""The block diagram in three depths as one page, with zoom."""

import re
from html import escape

from ortilo_drake.scenario import Scenario
from ortilo_drake.views.block_diagram import diagram_svg
from ortilo_drake.views.page.shell import asset

DEPTHS = {"the closed loop": 1, "its two halves": 2, "every system": 4}


def _inline(svg: str) -> str:
    """Return an SVG file's element, without what a page must not have before it."""
    found = re.search(r"<svg.*</svg>", svg, re.DOTALL)
    assert found is not None
    return found.group()


def diagram_page(scenario: Scenario) -> str:
    """Return a page with a scenario's block diagram in three depths; InputError if Graphviz is not installed."""
    name = escape(scenario.name)
    buttons = "".join(f'<button type="button" data-depth="{depth}">{title}</button>' for title, depth in DEPTHS.items())
    parts = "".join(f'<div class="depth">{_inline(diagram_svg(scenario, depth))}</div>' for depth in DEPTHS.values())
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{name}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<style>\n{asset('diagram.css')}</style>\n</head>\n<body>\n<header><h1>{name}</h1>{buttons}"
        '<button type="button" id="whole">whole picture</button></header>\n'
        f'<main id="frame">{parts}</main>\n<script>\n{asset("diagram.js")}</script>\n</body>\n</html>\n'
    )
