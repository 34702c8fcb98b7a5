"""The errors at hover that follow from the errors of a scenario's world.

Errors e of the world (fix_errors.py) drive the loop z = [x; f; xhat; ehat; i] of command_loop.py, with a perfect link:

    z_{k+1} = A_k z_k + B_k e_k,   e_{k+1} = a e_k + w_k,   B_k = [G; K_k Delta_k C_e; -E_k C_e]

G is how they push the vehicle, C_e what they add to the rows of y. E[z z^T] goes from a flight's start, z = 0, tick by
tick, since errors that last have no steady state to come from. The integral takes the fix of the first sensor that
gives the position: in the long run the vehicle stands where that fix says r, whatever other sensors say.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from ortilo_drake.model.signals import N_X
from ortilo_drake.onboard.estimator.extra_states import F
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.unknown_error import Error
from ortilo_drake.studies.command_link.command_loop import behind_a_link, commanded_loop
from ortilo_drake.studies.loop.fix_errors import errors_of_rows, numbered
from ortilo_drake.studies.loop.hover_loop import HoverLoop, hover_loop

SMALL = 1e-12  # variance over the largest at which a combination of errors counts as none


class Drive(NamedTuple):
    """Independent errors that drive the loop.

    Attributes:
        sd: standard deviations at first (e).
        step_sd: of what is added in a tick (e).
        keeps: share of the value that is left a tick later (e).
        G: how they push the world's states (M, e).
        C: what they add to the rows of y (p, e).
    """

    sd: np.ndarray
    step_sd: np.ndarray
    keeps: np.ndarray
    G: np.ndarray
    C: np.ndarray


def drive_of(error: Error, C: np.ndarray, loop: HoverLoop) -> Drive:
    """Return an error with its coefficients in the rows of y (p, e), in as few components as do the same."""
    G = np.zeros((len(loop.world), len(error.sd)))
    G[:N_X] = error.G
    names = [loop.names[k] for k in loop.world]
    if set(F) <= set(names) and "force" in error.sees and error.G.any():
        G[[names.index(name) for name in F]] = error.sees["force"](numbered(3))
    drive = Drive(error.sd, error.step_sd, error.keeps, G, C)
    alike = error.keeps == error.keeps[0]
    steps = error.step_sd * error.sd[0] == error.step_sd[0] * error.sd
    return merged_components(drive) if len(error.sd) > 3 and error.sd.any() and alike.all() and steps.all() else drive


def merged_components(drive: Drive) -> Drive:
    """Return errors that vary alike in as few components as act differently: those of the covariance of their sum.

    Some sd is not 0.
    """
    first = int(np.argmax(drive.sd))
    U, s, _ = np.linalg.svd(np.vstack([drive.G, drive.C]) * drive.sd, full_matrices=False)
    there = s**2 > SMALL * max(s[0] ** 2, np.finfo(float).tiny)
    acts, n, split = (U * s)[:, there], int(there.sum()), len(drive.G)
    step = drive.step_sd[first] / drive.sd[first]
    return Drive(np.ones(n), np.full(n, step), np.full(n, drive.keeps[first]), acts[:split], acts[split:])


def error_inputs(scenario: Scenario, x: np.ndarray) -> list[Drive]:
    """Return the error inputs that drive a scenario's loop at state x (12), hovering, beside the white noise."""
    loop = hover_loop(scenario)
    found = [drive_of(error, C, loop) for error, C in errors_of_rows(scenario, loop.measurement, x)]
    return [drive for drive in found if (drive.sd.any() or drive.step_sd.any()) and (drive.G.any() or drive.C.any())]


def position_moments(scenario: Scenario, V: np.ndarray, some: list[Drive], ticks: int) -> np.ndarray:
    """Return E[(p - r) (p - r)^T] that errors make, in each tick from the start of a flight (ticks, 3, 3).

    Args:
        scenario: the scenario; its sensors' losses, delays and blackouts do not enter.
        V: covariance of the measurements (p x p).
        some: what drives the loop.
        ticks: how many.
    """
    if not some:
        return np.zeros((ticks, 3, 3))
    loop = commanded_loop(scenario, V)
    A, _ = behind_a_link(loop, "hold")
    n, e = A.shape[-1], sum(len(drive.sd) for drive in some)
    whole = np.zeros((len(A), n + e, n + e))
    whole[:, :n, :n] = A[:, 0]
    G, C = np.hstack([drive.G for drive in some]), np.hstack([drive.C for drive in some])
    whole[:, : loop.by_v.shape[1], n:] = loop.by_v @ C
    whole[:, : len(G), n:] += G
    whole[:, n:, n:] = np.diag(np.concatenate([drive.keeps for drive in some]))
    S, N = np.zeros((n + e, n + e)), np.zeros(n + e)
    S[n:, n:] = np.diag(np.concatenate([drive.sd for drive in some]) ** 2)
    N[n:] = np.concatenate([drive.step_sd for drive in some]) ** 2
    return _moments(whole, S, N, ticks)


@njit(cache=True)
def _moments(A: np.ndarray, S: np.ndarray, N: np.ndarray, ticks: int) -> np.ndarray:
    found = np.zeros((ticks, 3, 3))
    for k in range(ticks):
        found[k] = S[:3, :3]
        A_k = np.ascontiguousarray(A[k % A.shape[0]])
        S = A_k @ S @ A_k.T
        for i in range(N.size):
            S[i, i] += N[i]
    return found
