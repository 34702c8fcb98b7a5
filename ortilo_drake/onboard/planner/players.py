"""The players of a path: the reference from a table with a row for each tick, or from a path at an input port."""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.trajectories import Trajectory

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import REFERENCE_SIZE
from ortilo_drake.onboard.planner.planner import make_planner


def reference_out(k: int, path: np.ndarray, out: np.ndarray) -> None:
    """Output r, r_dot and r_ddot (9) of tick k, or of the table's last tick if k is later."""
    put(path[min(k, path.shape[0] - 1)], out)


def reference_box(path: Trajectory, ticks: int, h: float) -> Box:
    """Return the box that plays a path: it outputs r, r_dot and r_ddot (9) at every tick of h [s]."""
    planner = make_planner(path)
    context, table = planner.CreateDefaultContext(), np.empty((ticks + 1, REFERENCE_SIZE))
    for k in range(ticks + 1):
        context.SetTime(k * h)
        table[k] = planner.get_output_port().Eval(context)
    return Box("reference", Element("reference", out=reference_out), REFERENCE_SIZE, Values(tables={"path": table}))


class Path(NamedTuple):
    """A path p_WB(t) (3 rows) [m] with its two derivatives, the content of the player's input port."""

    position: Trajectory
    velocity: Trajectory
    acceleration: Trajectory


def path_value(trajectory: Trajectory) -> Value:
    """Return a trajectory p_WB(t) (3 rows) [m] as a value for the player's input port."""
    return Value[object](Path(trajectory, trajectory.MakeDerivative(1), trajectory.MakeDerivative(2)))


class PathPlayer(LeafSystem):
    """A system that plays the path at its input, then stays at the path's end; bit for bit Drake's TrajectorySource.

    Ports:
        path (object): a value made by path_value.
        y0 (9, output): r, r_dot and r_ddot in W, see model/signals.py.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_name("planner")
        self._path = self.DeclareAbstractInputPort("path", Value[object]())  # Drake 1.58 makes no Value of None
        needs = {self._path.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("y0", REFERENCE_SIZE, self._calc_reference, prerequisites_of_calc=needs)

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        path, t = self._path.Eval(context), context.get_time()
        start, end = path.position.start_time(), path.position.end_time()
        reference = np.zeros(REFERENCE_SIZE)
        reference[0:3] = path.position.value(min(max(t, start), end))[:, 0]
        if start <= t <= end:
            reference[3:6], reference[6:9] = path.velocity.value(t)[:, 0], path.acceleration.value(t)[:, 0]
        output.set_value(reference)
