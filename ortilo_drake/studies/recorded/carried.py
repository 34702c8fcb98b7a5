"""The values that the recorded filter carries from one event to the next, beside its state.

A run that goes on with it gives the same numbers, bit for bit, as one run over all events, if all events of one stamp
are taken in by the same run.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.onboard.estimator.tight.update import Taken, none_taken
from ortilo_drake.studies.recorded.anchor_trust import Trust, new_trust
from ortilo_drake.studies.recorded.event_rows import SparseRow, row_of
from ortilo_drake.studies.recorded.passing import Passing, empty_passing

ROOM = 16  # rows that wait until the covariance is passed over
EPOCH, FORCE_AT, RATES_AT, GROWN, LOW, BEGUN = range(6)  # what stands where in `marks`


class Carried(NamedTuple):
    """The anchors' record, the time passed, rows that wait, a blank row, and marks (6).

    The marks: stamps of the last epoch and of the last samples of force and rates [s], the extra error of ranges near
    the floor, whether it is so large that no range counts, and whether the first epoch is past.
    """

    trust: Trust
    passing: Passing
    waiting: Taken
    row: SparseRow
    marks: np.ndarray


@njit(cache=True)
def initial_carried(anchors: int, N: int, t: float) -> Carried:
    """Return the values carried at the start of a run at t [s], with N error states."""
    marks = np.array([-np.inf, t, t, 1.0, 0.0, 0.0])
    return Carried(new_trust(anchors), empty_passing(N), none_taken(ROOM, N), row_of(N), marks)
