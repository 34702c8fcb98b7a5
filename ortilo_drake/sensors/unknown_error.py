"""An error that a scenario's truth leaves unknown, as states of the Cramer-Rao bound beside the vehicle's twelve.

Each is an unknown of mean zero, whose variance is its value's square plus its spread's: a team knows how large its
errors may be, and neither their sign nor their size. floor/unknown_errors.py puts all of a scenario together.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE

Seen = Callable[[np.ndarray], np.ndarray]  # rows (l, 17) -> their coefficients of an error's e components (l, e)
Made = tuple[np.ndarray, np.ndarray]  # D (m, l) and rows (l, 17): a value errs by D e if these rows err by e


class Error(NamedTuple):
    """An unknown error: independent components, all of the same kind."""

    sd: np.ndarray
    """standard deviations at first (e)."""
    step_sd: np.ndarray
    """of what is added in a tick (e)."""
    keeps: np.ndarray
    """share of the value that is left a tick later (e)."""
    G: np.ndarray
    """how the components drive x (12, e)."""
    by_x: np.ndarray
    """how x drives the components (12, e)."""
    sees: dict[str, Seen]
    """by the kind of rows the coefficients of the components in them."""


def walk(sd: np.ndarray, step_sd: np.ndarray | float, sees: dict[str, Seen], G: np.ndarray | None = None) -> Error:
    """Return a random walk; a constant where step_sd is 0."""
    e = len(sd)
    nothing = np.zeros((N_X, e))
    return Error(sd, np.broadcast_to(step_sd, e), np.ones(e), nothing if G is None else G, nothing, sees)


def gauss_markov(sd: np.ndarray, time: float, h: float, sees: dict[str, Seen], G: np.ndarray | None = None) -> Error:
    """Return first-order Gauss-Markov noise of those sds at all times and that correlation time [s]."""
    keeps = np.full(len(sd), np.exp(-h / time))
    return walk(sd, sd * np.sqrt(1.0 - keeps**2), sees, G)._replace(keeps=keeps)


def one_per_source(number: int, each: int = 1) -> Seen:
    """Return coefficients 1 of the component that has the number of a row's source; each so many sources have one."""
    return lambda rows: np.eye(number)[rows[:, SOURCE].astype(int) // each]


def along_position(sign: float, number: int = 1, each: int = 1) -> Seen:
    """Return coefficients of what moves as p does, or against it: one vector for all rows, or one for each source."""

    def coefficients(rows: np.ndarray) -> np.ndarray:
        g = sign * rows[:, GRADIENT][:, :3]
        whose = np.ones((len(rows), 1)) if number == 1 else one_per_source(number, each)(rows)
        return (whose[:, :, np.newaxis] * g[:, np.newaxis]).reshape(len(rows), 3 * whose.shape[1])

    return coefficients


def spread(*parts: tuple[float, ...] | float, number: int = 3) -> np.ndarray:
    """Return the sd of each component of an error, the root of the sum of its parts' squares."""
    return np.sqrt(sum(np.broadcast_to(part, number).astype(float) ** 2 for part in parts))


def derivative(
    fix: Callable[[np.ndarray], np.ndarray], message: np.ndarray, at: list[list[int]] | np.ndarray, step: float
) -> np.ndarray:
    """Return the derivative of a fix by each of some numbers of its message, or of several that move together."""
    columns = []
    for places in at:
        change = np.zeros(len(message))
        change[places] = step
        columns.append((fix(message + change) - fix(message - change)) / (2.0 * step))
    return np.column_stack(columns)
