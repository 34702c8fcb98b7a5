"""The closed loop drawn as a block diagram."""

import shutil
import subprocess

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario


def diagram_svg(scenario: Scenario, depth: int) -> str:
    """Return the closed loop's Graphviz picture as SVG.

    Args:
        scenario: the scenario.
        depth: how far to open nested diagrams.

    Raises:
        InputError: if Graphviz is not installed.
    """
    if shutil.which("dot") is None:
        raise InputError("diagram: needs Graphviz's 'dot'; on Debian or Ubuntu: apt-get install graphviz")
    graph = make_closed_loop(scenario).GetGraphvizString(max_depth=depth)
    done = subprocess.run(["dot", "-Tsvg"], input=graph, capture_output=True, text=True, check=True)
    return done.stdout
