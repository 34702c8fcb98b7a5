"""The intermittent Kalman filter with a history for late measurements, as a system."""

from functools import partial

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import ARRIVED, STAMP
from ortilo_drake.onboard.commands.timeline import mean_control, unpacked, with_command
from ortilo_drake.onboard.estimator.belief import diagonal_of_P
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel
from ortilo_drake.onboard.estimator.kalman_filter import Predictor, handed_over
from ortilo_drake.onboard.estimator.late_measurements import (
    N_BELIEF,
    empty_history,
    past_belief,
    replay_step,
    row_of_past,
    slot_of,
    with_acted,
)


class ReplayKalmanFilter(LeafSystem, Predictor):
    """A Kalman filter that puts a late measurement into the tick of its stamp and runs again from there.

    Ports, beside those of KalmanFilter_:
        stamps (s): when each sensor's measurement was true [s].
        message_<sensor> (n): the stamped message of each sensor whose fix is made about an estimate.
        belief_<sensor> (240, output): the belief of the tick of that stamp, by all that has arrived since; the present
            one where no message arrived or its stamp is of this tick (or of a later one), that of the oldest tick kept
            where the stamp is older.
        whole_belief_<sensor> (n + n^2, output): the same of [x; e; i]; only if opens.
        timeline (n): what acted and what will, see onboard/commands/command_log.py; only where the filter goes by it.
            The control of a tick is then the mean over the tick of what acts.

    The last N ticks are a discrete state of their own. Equations: late_measurements.py.

    Args:
        model, measurement, hover_thrust, xbar_0, P_0, h, imu_variances: as KalmanFilter_'s.
        ticks: N.
        messages: size of the message of each sensor whose fix is made about an estimate.
        timeline: n, 0 where the filter takes its commands to act at once.
        opens: whether P can be opened; the P of all ticks kept then is.
    """

    def __init__(
        self,
        model: FilterModel,
        measurement: Measurement,
        hover_thrust: float,
        xbar_0: np.ndarray,
        P_0: np.ndarray,
        h: float,
        ticks: int,
        messages: dict[str, int],
        imu_variances: np.ndarray | None = None,
        timeline: int = 0,
        opens: bool = False,
    ):
        super().__init__()
        self.declare_predictor(float, model, measurement, hover_thrust, xbar_0, P_0, h, imu_variances, opens)
        self._slot = slot_of(measurement, self._n)
        self._stamps = self.DeclareVectorInputPort("stamps", handed_over(measurement)["delta"])
        self._timeline = self.DeclareVectorInputPort("timeline", timeline) if timeline else None
        self._history = self.DeclareDiscreteState(empty_history(ticks, self._slot).ravel())
        for sensor, size in messages.items():
            message = self.DeclareVectorInputPort(f"message_{sensor}", size)
            needs = {message.ticket(), self.xd_ticket()}
            calc = partial(self._calc_past, message)
            self.DeclareVectorOutputPort(f"belief_{sensor}", N_BELIEF, calc, prerequisites_of_calc=needs)
            if opens:
                calc, n = partial(self._calc_whole_past, message), self._n
                self.DeclareVectorOutputPort(f"whole_belief_{sensor}", n + n * n, calc, prerequisites_of_calc=needs)

    def HasHistory(self) -> bool:
        """Return whether there is more in the state than the belief."""
        return True

    def _calc_past(self, message: InputPort, context: Context, output: BasicVector) -> None:
        history = context.get_discrete_state(self._history).value().reshape(-1, self._slot.size)
        known = context.get_discrete_state(self._known).value()
        output.set_value(past_belief(history, self._slot, self._n, message.Eval(context), known, self._h))

    def _calc_whole_past(self, message: InputPort, context: Context, output: BasicVector) -> None:
        """Return the belief of [x; e; i] of the tick of a message's stamp, the present one's if that is not kept."""
        received = message.Eval(context)
        history = context.get_discrete_state(self._history).value().reshape(-1, self._slot.size)
        row = row_of_past(history, tick_of(received[STAMP], self._h)) if received[ARRIVED] else -1
        past = history[row, self._slot.belief : self._slot.y]
        output.set_value(past if row >= 0 else context.get_discrete_state(self._belief).value())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        y, delta, V2, u, r = self.inputs_in(context)
        stamps = self._stamps.Eval(context)
        if self._imu_variances is not None:
            stamps = np.append(stamps, np.repeat(stamps[self._imu_number], len(self._imu_variances) // 3))
        k, known = tick_of(context.get_time(), self._h), (self._model, self._layout)
        # A copy of the state's, changed here.
        history = values.get_mutable_value(self._history).reshape(-1, self._slot.size)
        belief, opening = context.get_discrete_state(self._belief).value(), self.opening_in(context)
        if opening is not None:
            # Of all ticks that are kept: run again from a past one, the filter would forget what it is told now.
            belief = belief.copy()
            for believed in (belief, history[:, self._slot.belief : self._slot.y]):
                diagonal_of_P(believed, self._n)[:] += opening
        if self._timeline is not None:
            timeline = self._timeline.Eval(context)
            rows = with_command(unpacked(timeline), k * self._h + timeline[0], u + self._hover)
            belief = with_acted(history, self._slot, belief, k, rows, self._hover, self._h, *known)
            u = mean_control(rows, k * self._h, (k + 1) * self._h) - self._hover
        belief = replay_step(
            history,
            self._slot,
            belief,
            k,
            y,
            delta,
            V2,
            stamps,
            self._h,
            u,
            r,
            *known,
        )
        self.set_belief(values, belief)
