"""The record of a run of the filter, and the smoother that goes back through it (modified Bryson-Frazier).

The arrays that a run writes are allocated in full first, and cut to the written rows at the end. The smoother bases
each estimate on all measurements, later ones included. It goes backwards, from lambda = 0 and Lambda = 0: at a row H
with gain K and innovation e of variance S, over a step F, and at a query,

    lambda <- H' (-e / S) + (I - K H)' lambda,   Lambda <- H' H / S + (I - K H)' Lambda (I - K H)
    lambda <- F' lambda,                         Lambda <- F' Lambda F
    error = -P lambda,                           P_smoothed = P - P Lambda P

No covariance is inverted, so a state may be known exactly.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18, 1973.
"""

from collections.abc import Sequence

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.signals import MAX_DETECTIONS
from ortilo_drake.onboard.estimator.tight.inertial import turn
from ortilo_drake.onboard.estimator.tight.layout import GYRO, N_INERTIAL, THETA, Q
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
    SparseRow,
    Tape,
)
from ortilo_drake.studies.recorded.imu_watch import AVERAGED
from ortilo_drake.studies.recorded.passing import Passing

STEP, ROW, ASKED = 0, 1, 2  # kinds of entries on the tape
HEARD, ON_TAPE = 3, 4  # `written` counts steps, rows, queries, ranges, and all entries on the tape


@register_jitable
def room_for(events: Events, N: int, whole: bool) -> tuple[Run, np.ndarray]:
    """Return a run with arrays for all events and N states, with a tape if `whole`, and the counts `written` (5)."""
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
    rows = rows + 6 + 2 * epochs if whole else 0  # six rows of a restart, and two of the height at each epoch
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
    """Return the run with its arrays cut to the rows that were written."""
    steps, rows, asked, heard, all_ = written[0], written[1], written[2], written[3], written[4]
    tape = run.tape
    tape = Tape(
        tape.what[:all_], tape.A[:steps], tape.keeps[:steps], tape.where[:rows], tape.row[:rows], tape.gain[:rows],
        tape.e[:rows], tape.S[:rows], tape.C[:asked],
    )  # fmt: skip
    return Run(run.x[:asked], run.P[:asked], run.innovation[:heard], run.variance[:heard], run.taken[:heard], tape)


@register_jitable
def _next(tape: Tape, written: np.ndarray, what: int) -> int:
    """Return the index of the next entry of the kind `what`, and count the entry."""
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
    """Write the innovation e of a range, its variance S, and whether the range was taken."""
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


@register_jitable
def _through(M: np.ndarray, A: np.ndarray, keeps: np.ndarray) -> None:
    """Replace M by F' M; applied to M and then to M's transpose, this gives F' M F."""
    N = len(M)
    top = np.zeros((TRANSITION, N))
    for i in range(GYRO):
        for j in range(TRANSITION):
            if A[i, j] != 0.0:
                for c in range(N):
                    top[j, c] += A[i, j] * M[i, c]
    for j in range(N):
        for c in range(N):
            kept = keeps[j - GYRO] * M[j, c] if j >= GYRO else 0.0
            M[j, c] = kept + (top[j, c] if j < N_INERTIAL else top[N_INERTIAL, c] if j == N - 1 else 0.0)


@cached_njit
def _back(tape: Tape, x: np.ndarray, P: np.ndarray, adjoint: np.ndarray, information: np.ndarray) -> None:
    """Go back through a tape: smooth x (q, N + 1) and P (q, 3, 3), update adjoint lambda and information Lambda."""
    step, number, asked, N = len(tape.A), len(tape.e), len(x), len(adjoint)
    for k in range(len(tape.what) - 1, -1, -1):
        if tape.what[k] == 2:
            asked -= 1
            rows = tape.C[asked]
            error = -rows @ adjoint
            x[asked, :THETA] += error[:THETA]
            turn(x[asked, Q : Q + 4], error[THETA], error[THETA + 1], error[THETA + 2])
            P[asked] -= rows[:3] @ information @ rows[:3].T
        elif tape.what[k] == 1:
            number -= 1
            where, row, K, S = tape.where[number], tape.row[number], tape.gain[number], tape.S[number]
            u = information @ K
            s, along = 1.0 / S, -tape.e[number] / S
            for i in range(N):
                s += K[i] * u[i]
                along -= K[i] * adjoint[i]
            for a in range(len(row)):
                if row[a] != 0.0:
                    at, of = where[a], row[a]
                    adjoint[at] += of * along
                    for j in range(N):
                        information[at, j] -= of * u[j]
                        information[j, at] -= of * u[j]
                    for b in range(len(row)):
                        information[at, where[b]] += of * row[b] * s
        else:
            step -= 1
            A, keeps = tape.A[step], tape.keeps[step]
            new = np.zeros(N)
            for j in range(GYRO, N):
                new[j] = keeps[j - GYRO] * adjoint[j]
            for i in range(GYRO):
                for j in range(N_INERTIAL):
                    new[j] += A[i, j] * adjoint[i]
                new[N - 1] += A[i, N_INERTIAL] * adjoint[i]
            adjoint[:] = new
            _through(information, A, keeps)
            _through(information.T, A, keeps)


def smooth(runs: Sequence[Run]) -> tuple[np.ndarray, np.ndarray]:
    """Return the smoothed nominal states (q, N + 1) and position covariances (q, 3, 3) of runs with tapes, in order."""
    N = runs[0].tape.gain.shape[1]
    adjoint, information = np.zeros(N), np.zeros((N, N))
    x, P = [run.x.copy() for run in runs], [run.P.copy() for run in runs]
    for run, x_of, P_of in reversed(list(zip(runs, x, P, strict=True))):
        _back(run.tape, x_of, P_of, adjoint, information)
    return np.concatenate(x), np.concatenate(P)
