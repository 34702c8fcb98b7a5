"""The smoother of a run: each estimate by all measurements, later ones included (modified Bryson-Frazier).

Backwards, with lambda and Lambda from 0 on: at a row H with gain K, innovation e of variance S, over a step F, and at
what is asked for

    lambda <- H' (-e / S) + (I - K H)' lambda,   Lambda <- H' H / S + (I - K H)' Lambda (I - K H)
    lambda <- F' lambda,                         Lambda <- F' Lambda F
    error = -P lambda,                           P_smoothed = P - P Lambda P

No covariance is inverted, so that a state may be known exactly.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18, 1973.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.inertial import turn
from ortilo_drake.onboard.estimator.tight.layout import GYRO, N_INERTIAL, THETA, Q
from ortilo_drake.studies.recorded.filter_types import TRANSITION, Run, Tape


@register_jitable
def _through(M: np.ndarray, A: np.ndarray, keeps: np.ndarray) -> None:
    """Replace M by F' M; on M and then on its transpose this is F' M F."""
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


@njit(cache=True)
def _back(tape: Tape, x: np.ndarray, P: np.ndarray, adjoint: np.ndarray, information: np.ndarray) -> None:
    """Go back through a tape; x (q, N + 1) and P (q, 3, 3) become the smoothed ones, adjoint and information go on."""
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
    """Return smoothed nominal states (q, N + 1) and covariances of position (q, 3, 3) of runs with tapes, in order."""
    N = runs[0].tape.gain.shape[1]
    adjoint, information = np.zeros(N), np.zeros((N, N))
    x, P = [run.x.copy() for run in runs], [run.P.copy() for run in runs]
    for run, x_of, P_of in reversed(list(zip(runs, x, P, strict=True))):
        _back(run.tape, x_of, P_of, adjoint, information)
    return np.concatenate(x), np.concatenate(P)
