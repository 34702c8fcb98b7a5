"""An estimator of ours by itself: fixes, the measurements handler and the filter, as one Diagram."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from ortilo_drake.diagrams.wiring.intermittent import filtering_of
from ortilo_drake.diagrams.wiring.messages import message_boxes
from ortilo_drake.diagrams.wiring.onboard import ESTIMATORS, belief_parts_box, measurement_in
from ortilo_drake.diagrams.wiring.pictures import detected
from ortilo_drake.loop.diagram import Added, add_wiring
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_U, REFERENCE_SIZE
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.belief import with_vehicle_part
from ortilo_drake.onboard.estimator.filter_element import extra_box
from ortilo_drake.scenario import Belief, IntermittentFilter


class Estimator(Diagram):
    """The chain from messages to the estimate, by the paper's filter or the tight one: see diagrams/onboard.py.

    Ports:
        uwb, detections, imu, ...: the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        control (4): u_k, f_T absolute.
        reference (9): r, r_dot, r_ddot.
        estimate (15, output): xhat_{k|k-1} and the integral.
        covariance (225, output): P_k row by row.
        force (3, output): the disturbance force in W as estimated [N]; only where estimator.force has it estimated.
        extra (2 e, output): all states beside x and their standard deviations, see extra_states.py; likewise.
        y (p), delta (s), V2 (q) (outputs): the measurement as it reaches the filter in this tick, late ones included.

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
        self._settable, self._has_history = settable(belief), has_history(belief)
        if belief.commands.filter == "acted":
            raise InputError("commands: of an estimator by itself must be left as they are")
        room, builder = room or belief.load_room(), DiagramBuilder()
        messages = message_boxes(belief, room, detects)
        around = [*messages.values(), outside("servo", N_U), outside("reference", REFERENCE_SIZE)]
        seeing, messages = detected(belief, room, messages) if detects else ([], messages)
        boxes = ESTIMATORS[belief.estimator.kind](belief, room, xbar_0, messages)
        boxes += belief_part_boxes(belief, boxes)
        wiring = Wiring([*around, *seeing, *boxes])
        signals = {"estimate": "belief_parts.estimate", "covariance": "belief_parts.covariance"} | measurement_in(boxes)
        signals |= {"force": "vehicle_belief.force", "extra": "extra"} if "vehicle_belief" in wiring.boxes else {}
        self._added = add_wiring(builder, wiring, signals, belief.h, inputs_named={"servo": "control"})
        for name, port in self._added.outputs.items():
            builder.ExportOutput(port, name)
        builder.BuildInto(self)
        self.set_name("estimator")

    def SetBelief(self, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
        """Set estimate (15) and covariance (15 x 15); the context is the root's."""
        set_belief(self._added, self._settable, context, xbar, P)

    @property
    def has_history(self) -> bool:
        """True if its next estimates depend on past ticks as well as on the present belief."""
        return self._has_history


def belief_part_boxes(belief: Belief, boxes: list[Box]) -> list[Box]:
    """Return boxes that show what an estimator says, for the ports of a Diagram; those that are there are left out."""
    named, shown = {box.name for box in boxes}, list[Box]()
    if "belief_parts" not in named:
        shown.append(belief_parts_box(boxes))
    if "vehicle_belief" in named:
        its = filtering_of(belief)
        shown.append(extra_box("extra", its.n).with_inputs(belief=its.belief))
    return shown


class Settable(NamedTuple):
    """The places in which the paper's filter keeps its belief.

    Attributes:
        state: which of its states begins with it.
        n: how many states it estimates.
    """

    state: str
    n: int


def settable(belief: Belief) -> Settable | None:
    """Return the place of a scenario's filter's belief; None if the filter is not the paper's."""
    if not isinstance(belief.estimator, IntermittentFilter):
        return None
    its = filtering_of(belief)
    return Settable("memory" if its.replays else "belief", its.n)


def set_belief(added: Added, kept: Settable | None, context: Context, xbar: np.ndarray, P: np.ndarray) -> None:
    """Set estimate (15) and covariance (15 x 15) of the paper's filter; what else it estimates stays as it is.

    Args:
        added: the Diagram's part that has the filter.
        kept: where it keeps its belief.
        context: the root's.
        xbar: estimate of [x; i].
        P: its covariance.

    Raises:
        InputError: if the filter is another one.
    """
    if kept is None:
        raise InputError("estimator: has no method SetBelief, it cannot be resumed")
    size, values = kept.n + kept.n**2, added.state_of(context, "filter", kept.state).copy()
    values[:size] = with_vehicle_part(values[:size], kept.n, xbar, P)
    added.set_state(context, "filter", kept.state, values)


def has_history(belief: Belief) -> bool:
    """Return whether past ticks decide what an estimator of ours will estimate, beside its present belief."""
    if not isinstance(belief.estimator, IntermittentFilter):
        return True
    its, exclude = filtering_of(belief), belief.multilateration.exclude
    keeps = belief.landmark_fix.joint is not None or (exclude is not None and exclude.clock)
    return its.replays or bool(its.extras) or belief.estimator.robust is not None or keeps
