"""An estimator of ours by itself: fixes, the measurements handler and the filter, as one Diagram."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from ortilo_drake.diagrams.wiring.intermittent import Filtering, filtering_of
from ortilo_drake.diagrams.wiring.messages import heard_boxes
from ortilo_drake.diagrams.wiring.onboard import ESTIMATORS, INPUTS_NAMED, half_of
from ortilo_drake.loop.diagram import add_wiring
from ortilo_drake.loop.element import Box, Values
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.belief import with_vehicle_part
from ortilo_drake.scenario import Belief, IntermittentFilter


class OfBelief(Diagram):
    """A Diagram with an estimator in it: Estimator and Onboard, whose ports are described there."""

    def _assemble(self, name: str, belief: Belief, heard: list[Box], boxes: list[Box], fused: bool = False) -> None:
        """Build it, under a name; the other arguments as of half_of, and fused as of Onboard."""
        builder = DiagramBuilder()
        wiring, said = half_of(belief, heard, boxes)
        signals: dict[str, str | tuple[str, ...]] = dict(said)
        if "control" in signals:
            signals["logged"] = tuple(said[signal] for signal in belief.measurement.logged_sizes() if signal in said)
        self._added = add_wiring(builder, wiring, signals, belief.h, fused=fused, inputs_named=INPUTS_NAMED)
        for signal, port in self._added.outputs.items():
            builder.ExportOutput(port, signal)
        builder.BuildInto(self)
        self.set_name(name)
        self._own = wiring.boxes["estimator"].system if "estimator" in wiring.boxes else None
        its = filtering_of(belief) if isinstance(belief.estimator, IntermittentFilter) else None
        self._settable = None if its is None else ("memory" if its.replays else "belief", its.n)
        self._has_history = its is None or _has_history(belief, its)

    def SetBelief(self, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set the estimator's estimate (15) and covariance (15 x 15); the context is the root's.

        What else the paper's filter estimates stays as it is.

        Raises:
            InputError: if the estimator cannot be set.
        """
        own: Any = self._own
        if hasattr(own, "SetBelief"):
            own.SetBelief(context, xbar, P)
            return
        if own is not None or self._settable is None:
            whose = f"{own.get_name()}: " if own is not None else ""
            raise InputError(f"estimator: {whose}has no method SetBelief, it cannot be resumed")
        state, n = self._settable
        values = self._added.state_of(context, "filter", state).copy()
        values[: n + n * n] = with_vehicle_part(values[: n + n * n], n, xbar, P)
        self._added.give(context, {"filter": Values(start={state: values})})

    @property
    def has_history(self) -> bool:
        """True if the next estimates depend on past ticks as well as on the present belief."""
        return self._has_history if self._own is None else bool(getattr(self._own, "has_history", True))


def _has_history(belief: Belief, its: Filtering) -> bool:
    exclude = belief.multilateration.exclude
    keeps = belief.landmark_fix.joint is not None or (exclude is not None and exclude.clock)
    return its.replays or bool(its.extras) or belief.estimator.robust is not None or keeps


class Estimator(OfBelief):
    """The chain from messages to the estimate, by the paper's filter or the tight one: see diagrams/onboard.py.

    Ports: those of make_estimator (single_parts.py), and
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        extra (2 e, output): all states beside x and their standard deviations, see extra_states.py; only with force.

    Args:
        scenario: the scenario, of which the belief is all that is taken.
        xbar_0: first estimate (15).
        detects: whether the pictures of a rendered camera come here; if not, detections do.
        room: as it was surveyed; by default the scenario's.

    Raises:
        InputError: if the detector's files are wrong, or if the filter goes by commands that come from elsewhere.
    """

    def __init__(self, scenario: Belief, xbar_0: np.ndarray, detects: bool = True, room: Room | None = None):
        super().__init__()
        belief = scenario.belief
        if belief.commands.filter == "acted":
            raise InputError("commands: must be left at their defaults for an estimator alone")
        room = room or belief.load_room()
        heard, messages = heard_boxes(belief, room, detects)
        self._assemble("estimator", belief, heard, ESTIMATORS[belief.estimator.kind](belief, room, xbar_0, messages))
