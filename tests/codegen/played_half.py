"""Python's onboard half on its own, compiled into one function that plays given inputs."""

import numpy as np

from ortilo_drake.codegen.half import Half
from ortilo_drake.diagrams.wiring.onboard import measurement_in
from ortilo_drake.loop.element import OUTSIDE, Box, Element, Values, constant
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.placing import put


def sent_out(k: int, rows: np.ndarray, out: np.ndarray) -> None:
    """Say the row of tick k."""
    put(rows[k], out)


SENT = Element("sent", out=sent_out)


class PlayedHalf:
    """The onboard half of a scenario, played tick after tick from its start.

    Args:
        half: what is exported of it.
    """

    def __init__(self, half: Half):
        self._inputs, boxes = half.inputs, list(half.wiring.boxes.values())
        measured = measurement_in(boxes)["delta"]
        played = [constant("going_on", -1.0), *map(self._alone, boxes)]
        self._player = Player(Wiring(played), ("servo", "belief_parts", measured), "going_on")

    def _alone(self, box: Box) -> Box:
        if box.name in self._inputs:
            return Box(box.name, SENT, box.size, Values(tables={"rows": np.zeros((1, box.size))}))
        return constant(box.name, np.zeros(box.size)) if box.element is OUTSIDE else box

    def play(self, inputs: np.ndarray) -> np.ndarray:
        """Return control, estimate, covariance and delta of each tick, a row each, of its inputs as they lie in C."""
        parts = np.split(inputs, np.cumsum([*self._inputs.values()])[:-1], axis=1)
        given = {
            name: Values(tables={"rows": np.ascontiguousarray(part)})
            for name, part in zip(self._inputs, parts, strict=True)
        }
        said = np.empty((len(inputs), self._player.width))
        self._player.fly(np.zeros(len(inputs), dtype=np.int64), said, given)
        return said
