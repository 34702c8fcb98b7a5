"""The arrays that a run of the filter writes: allocated in full first, cut to the written rows at the end."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.signals import MAX_DETECTIONS
from ortilo_drake.onboard.estimator.tight.layout import GYRO
from ortilo_drake.studies.recorded.event_rows import SparseRow
from ortilo_drake.studies.recorded.filter_types import (
    BOXES,
    ENTRIES,
    FINDER,
    FLOW,
    FORCE,
    LANDED,
    QUERY,
    RANGE,
    TRANSITION,
    Events,
    Run,
    Tape,
)
from ortilo_drake.studies.recorded.imu_watch import AVERAGED
from ortilo_drake.studies.recorded.passing import Passing

STEP, ROW, ASKED = 0, 1, 2  # what stands on the tape
HEARD, ON_TAPE = 3, 4  # of the numbers written so far: steps, rows, queries, ranges, and all on the tape


@register_jitable
def room_for(events: Events, N: int, whole: bool) -> tuple[Run, np.ndarray]:
    """Return a run with arrays large enough for the events, and the number of rows written so far (5).

    Args:
        events: all that may be taken in.
        N: error states.
        whole: whether a tape is kept.
    """
    ranges = queries = epochs = rows = 0
    last = -np.inf
    for k in range(len(events.t)):
        kind = events.kind[k]
        ranges += kind == RANGE
        queries += kind == QUERY
        rows += 4 * (kind == LANDED) + 2 * (kind == FLOW) + (kind in (RANGE, FINDER))
        rows += 2 * MAX_DETECTIONS * (kind == BOXES)
        if kind > FORCE and events.t[k] > last:
            epochs, last = epochs + 1, events.t[k]
    averages = 0 if len(events.t) == 0 else int((events.t[-1] - events.t[0]) / AVERAGED) + 2  # of force, two rows each
    epochs, rows = epochs + averages, rows + 2 * averages
    steps = epochs if whole else 0
    rows = rows + 6 + 2 * epochs if whole else 0  # a new start's rows, and two of the height at each epoch
    asked = queries if whole else 0
    tape = Tape(
        np.empty(steps + rows + asked, np.int8),
        np.empty((steps, 9, TRANSITION)),
        np.empty((steps, N - GYRO)),
        np.zeros((rows, ENTRIES), np.int64),
        np.zeros((rows, ENTRIES)),
        np.empty((rows, N)),
        np.empty(rows),
        np.empty(rows),
        np.empty((asked, 9, N)),
    )
    seen = (np.zeros(ranges), np.ones(ranges), np.zeros(ranges, np.bool_))
    return Run(np.empty((queries, N + 1)), np.empty((queries, 3, 3)), *seen, tape), np.zeros(5, np.int64)


@register_jitable
def cut_to(run: Run, written: np.ndarray) -> Run:
    """Return a run's arrays, cut to the rows that were written."""
    steps, rows, asked, heard, all_ = written[0], written[1], written[2], written[3], written[4]
    tape = run.tape
    tape = Tape(
        tape.what[:all_], tape.A[:steps], tape.keeps[:steps], tape.where[:rows], tape.row[:rows], tape.gain[:rows],
        tape.e[:rows], tape.S[:rows], tape.C[:asked],
    )  # fmt: skip
    return Run(run.x[:asked], run.P[:asked], run.innovation[:heard], run.variance[:heard], run.taken[:heard], tape)


@register_jitable
def _next(tape: Tape, written: np.ndarray, what: int) -> int:
    """Return the index of the next entry of a kind, and count it."""
    at = written[what]
    tape.what[written[ON_TAPE]] = what
    written[what], written[ON_TAPE] = at + 1, written[ON_TAPE] + 1
    return int(at)


@register_jitable
def write_step(tape: Tape, written: np.ndarray, passing: Passing) -> None:
    """Write a step in time to a tape, if there is one."""
    if len(tape.what) > 0:
        at = _next(tape, written, STEP)
        tape.A[at], tape.keeps[at] = passing.A, passing.keeps


@register_jitable
def write_row(tape: Tape, written: np.ndarray, row: SparseRow, e: float, S: float) -> None:
    """Write an accepted row, its innovation e and variance S to a tape, if there is one."""
    if len(tape.what) > 0:
        at = _next(tape, written, ROW)
        tape.where[at], tape.row[at], tape.e[at], tape.S[at] = row.where, row.of, e, S
        tape.gain[at] = row.PHt / S


@register_jitable
def write_range(run: Run, written: np.ndarray, e: float, S: float, taken: bool) -> None:
    """Write the innovation of a range, its variance and whether it was taken."""
    at = written[HEARD]
    run.innovation[at], run.variance[at], run.taken[at] = e, S, taken
    written[HEARD] = at + 1


@register_jitable
def write_query(run: Run, written: np.ndarray, x: np.ndarray, C: np.ndarray) -> None:
    """Write a query's answer: the nominal state and the position's covariance."""
    at = written[ASKED]
    run.x[at], run.P[at] = x, C[:3, :3]
    if len(run.tape.what) > 0:
        run.tape.C[_next(run.tape, written, ASKED)] = C[:9]
    else:
        written[ASKED] = at + 1
