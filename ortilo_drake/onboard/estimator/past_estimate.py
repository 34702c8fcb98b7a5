"""The filter's prediction for the tick at which a late message was true."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import ARRIVED, N_XBAR, STAMP
from ortilo_drake.onboard.estimator.late_measurements import COVARIANCE, MEASUREMENT, SLOT_SIZE, XHAT, row_of_past


class PastEstimate(LeafSystem):
    """Memoryless: looks a message's stamp up in the filter's history.

    Ports:
        message (n): a stamped message, see model/signals.py.
        present_estimate (15), present_covariance (225): the filter's, of this tick.
        history (N SLOT_SIZE): the filter's last N ticks.
        estimate (15, output): xhat_{j|j-1} of the tick j of the stamp, by all that has arrived since.
        covariance (225, output): P_j row by row.

    The outputs are the present ones where no message arrived or its stamp is of this tick (or of a later one), and
    those of the oldest tick kept where the stamp is older than the history.

    Args:
        name: whose message it is.
        size: n.
        ticks: N.
        h: tick [s].
    """

    def __init__(self, name: str, size: int, ticks: int, h: float):
        super().__init__()
        self.set_name(f"past_estimate_{name}")
        self._h = h
        self._message = self.DeclareVectorInputPort("message", size)
        self._present = [
            self.DeclareVectorInputPort("present_estimate", N_XBAR),
            self.DeclareVectorInputPort("present_covariance", N_XBAR * N_XBAR),
        ]
        self._history = self.DeclareVectorInputPort("history", ticks * SLOT_SIZE)
        for port, present, calc in zip(
            ("estimate", "covariance"), self._present, (self._calc_estimate, self._calc_covariance), strict=True
        ):
            needs = {self._message.ticket(), present.ticket(), self._history.ticket()}
            self.DeclareVectorOutputPort(port, present.size(), calc, prerequisites_of_calc=needs)

    def _past(self, context: Context, which: int) -> np.ndarray:
        message = self._message.Eval(context)
        if message[ARRIVED]:
            history = self._history.Eval(context).reshape(-1, SLOT_SIZE)
            row = row_of_past(history, tick_of(message[STAMP], self._h))
            if row >= 0:
                return np.asarray(history[row, (XHAT, COVARIANCE)[which] : (COVARIANCE, MEASUREMENT)[which]])
        return np.asarray(self._present[which].Eval(context))

    def _calc_estimate(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._past(context, 0))

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._past(context, 1))
