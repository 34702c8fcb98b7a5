"""Position from ranges to surveyed anchors (paper, section III-B).

Either the spheres of the three nearest anchors are met, as the authors do, or all ranges are fitted by weighted
least squares; the covariance comes from the geometry (range_equations.py). There is *no fix* with fewer than three
ranges, from anchors on one line, where the covariance is worse than MAX_SD, or if the fit does not converge.
"""

import numpy as np
from numba import njit
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import ARRIVED, FIX_SIZE, N_XBAR, uwb_size
from ortilo_drake.onboard.ranging.nearest_three import nearest_three
from ortilo_drake.onboard.ranging.range_least_squares import least_squares
from ortilo_drake.scenario import Multilateration as MultilaterationSettings


@njit(cache=True)
def fix_message(uwb: np.ndarray, anchors: np.ndarray, noise: np.ndarray, xhat: np.ndarray, three: bool) -> np.ndarray:
    """Return the fix message (14) of a uwb message (2 + 2 n) that arrived; zeros if there is no fix."""
    message = np.zeros(14)
    n = anchors.shape[0]
    ranges, there, p_last = uwb[2 : 2 + n], uwb[2 + n :], xhat[:3]
    if three:
        found, p, C = nearest_three(ranges, there, anchors, noise, p_last)
    else:
        found, p, C = least_squares(ranges, there, anchors, noise, p_last)
    if found:
        message[0] = 1.0
        message[1] = uwb[1]
        message[2:5] = p
        for i in range(3):
            message[5 + 3 * i : 8 + 3 * i] = C[i]
    return message


class Multilateration(LeafSystem):
    """A memoryless solver for the position of the UWB antenna.

    Ports:
        uwb (2 + 2 n): the uwb message as it arrives, see model/signals.py.
        estimate (15): the filter's xhat; its first three are the last estimate of p_WB.
        fix (14, output): the fix message, stamped as the uwb message; zeros if nothing arrived or no fix.

    Args:
        settings: method, and the noise it believes of the ranges.
        anchors: a_i in W (n, 3).
    """

    def __init__(self, settings: MultilaterationSettings, anchors: np.ndarray):
        super().__init__()
        self.set_name("multilateration")
        noise = settings.noise
        self._noise = np.array([noise.sd, 0.0] if noise.kind == "constant" else [0.0, noise.fraction])
        self._anchors = np.ascontiguousarray(anchors, dtype=float)
        self._three = settings.method == "nearest_three"
        self._uwb = self.DeclareVectorInputPort("uwb", uwb_size(len(anchors)))
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        ports = {self._uwb.ticket(), self._estimate.ticket()}
        self.DeclareVectorOutputPort("fix", FIX_SIZE, self._calc_fix, prerequisites_of_calc=ports)

    def _calc_fix(self, context: Context, output: BasicVector) -> None:
        uwb = self._uwb.Eval(context)
        if uwb[ARRIVED]:
            xhat = self._estimate.Eval(context)
            output.set_value(fix_message(uwb, self._anchors, self._noise, xhat, self._three))
        else:
            output.SetZero()
