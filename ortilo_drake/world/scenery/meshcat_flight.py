"""A flight shown live in Meshcat."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.world.scenery.meshcat_replay import draw_flown, draw_vehicle, show_pose

CHUNK = 30  # points in one object of a live trail


class MeshcatFlight(LeafSystem):
    """Shows a flight as it is simulated, with trails of the true and the estimated path.

    Ports:
        state (12): x of the vehicle.
        estimate (15): xhat.
        covariance (225): P row by row.

    State: the last CHUNK displayed rows [p_WB, estimate of p_WB] (CHUNK x 6). A trail is drawn in chunks. Only the
        newest chunk is sent again, so a frame of a long flight costs no more than one of a short flight.

    Args:
        meshcat: where to draw; the caller calls draw_room.
        h: tick [s].
        ticks: ticks from one displayed frame to the next.
        vehicle: the vehicle to draw, with its own arms.
    """

    def __init__(self, meshcat: Meshcat, h: float, ticks: int = 2, vehicle: Vehicle = M100):
        super().__init__()
        if ticks < 1:
            raise InputError(f"ticks: {ticks}: must be at least 1")
        self.set_name("meshcat_flight")
        self._meshcat, self._h, self._ticks, self._vehicle = meshcat, h, ticks, vehicle
        self._state = self.DeclareVectorInputPort("state", N_X)
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        self._covariance = self.DeclareVectorInputPort("covariance", N_XBAR * N_XBAR)
        self._trail = self.DeclareDiscreteState(CHUNK * 6)
        self.DeclareInitializationDiscreteUpdateEvent(self._start_trail)
        self.DeclareInitializationPublishEvent(self._draw)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._extend_trail)
        self.DeclarePeriodicPublishEvent(h, 0.0, self._show)
        draw_vehicle(meshcat, vehicle)

    def _now(self, context: Context) -> np.ndarray:
        return np.concatenate([self._state.Eval(context)[:3], self._estimate.Eval(context)[:3]])

    def _frame(self, context: Context) -> int | None:
        """Return the number of the frame to display in this tick, None if none is due."""
        frame, rest = divmod(tick_of(context.get_time(), self._h), self._ticks)
        return frame if rest == 0 else None

    def _start_trail(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(self._trail, np.tile(self._now(context), CHUNK))

    def _extend_trail(self, context: Context, values: DiscreteValues) -> None:
        if self._frame(context) is not None:
            trail = values.value(self._trail)
            values.set_value(self._trail, np.concatenate([trail[6:], self._now(context)]))

    def _draw(self, context: Context) -> None:
        draw_vehicle(self._meshcat, self._vehicle)

    def _show(self, context: Context) -> None:
        frame = self._frame(context)
        if frame is None:
            return
        xhat = self._estimate.Eval(context)
        P = self._covariance.Eval(context).reshape(N_XBAR, N_XBAR)[:3, :3]
        show_pose(self._meshcat, self._state.Eval(context), xhat, P, np.eye(3), context.get_time())
        # The periodic update of this tick has not happened yet: the state ends with the frame before.
        chunk, place = divmod(frame, CHUNK)
        trail = context.get_discrete_state().value(self._trail).reshape(CHUNK, 6)
        draw_flown(self._meshcat, np.vstack([trail[CHUNK - 1 - place :], self._now(context)]), f"/{chunk:04d}")
