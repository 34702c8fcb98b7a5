"""Graphviz, and the closed loop as Drake draws it."""

import shutil
import subprocess

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

OPEN = 4  # how far Drake opens nested diagrams: to every system


def drake_svg(scenario: Scenario) -> str:
    """Return Drake's picture of a scenario's closed loop as SVG; InputError if Graphviz is not installed."""
    return svg_of(make_closed_loop(scenario).GetGraphvizString(max_depth=OPEN))


def svg_of(graph: str) -> str:
    """Return Graphviz's SVG of a graph in the dot language.

    Raises:
        InputError: if Graphviz is not installed.
    """
    if shutil.which("dot") is None:
        raise InputError("diagram: needs Graphviz's 'dot'; on Debian or Ubuntu: apt-get install graphviz")
    done = subprocess.run(["dot", "-Tsvg"], input=graph, capture_output=True, text=True, check=True)
    return done.stdout
