"""An error that a scenario's truth leaves unknown, as extra states of the Cramer-Rao bound.

Each component is an unknown of mean zero, with a variance that is the square of its value plus the square of its
spread: a team knows how large its errors may be, but neither their sign nor their size. floor/unknown_errors.py
collects the errors of a scenario.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.signals import N_X
from ortilo_drake.sensors.information_rows import GRADIENT, SOURCE

Seen = Callable[[np.ndarray], np.ndarray]  # rows (l, 17) -> coefficients of an error's e components in them (l, e)
Made = tuple[np.ndarray, np.ndarray]  # D (m, l), rows (l, 17): errors e of the rows give the value the error D e


class Error(NamedTuple):
    """An unknown error: independent components, all of the same kind."""

    sd: np.ndarray
    """initial standard deviations (e)."""
    step_sd: np.ndarray
    """standard deviations of the noise added in a tick (e)."""
    keeps: np.ndarray
    """share of the value that is left after one tick (e)."""
    G: np.ndarray
    """input matrix of the components into x (12, e)."""
    by_x: np.ndarray
    """transposed input matrix of x into the components (12, e)."""
    sees: dict[str, Seen]
    """for each kind of rows, the coefficients of the components in them."""


def walk(sd: np.ndarray, step_sd: np.ndarray | float, sees: dict[str, Seen], G: np.ndarray | None = None) -> Error:
    """Return an error that is a random walk with an initial `sd` (e); a constant if step_sd is 0."""
    e = len(sd)
    nothing = np.zeros((N_X, e))
    return Error(sd, np.broadcast_to(step_sd, e), np.ones(e), nothing if G is None else G, nothing, sees)


def gauss_markov(sd: np.ndarray, time: float, h: float, sees: dict[str, Seen], G: np.ndarray | None = None) -> Error:
    """Return an error that is first-order Gauss-Markov noise with constant `sd` (e) and correlation time [s]."""
    keeps = np.full(len(sd), np.exp(-h / time))
    return walk(sd, sd * np.sqrt(1.0 - keeps**2), sees, G)._replace(keeps=keeps)


def one_per_source(number: int, each: int = 1) -> Seen:
    """Return coefficients 1 for the component of a row's source; `each` consecutive sources share a component."""
    return lambda rows: np.eye(number)[rows[:, SOURCE].astype(int) // each]


def along_position(sign: float, number: int = 1, each: int = 1) -> Seen:
    """Return coefficients of a displacement with the effect of p times `sign`: one for all rows, or one per source."""

    def coefficients(rows: np.ndarray) -> np.ndarray:
        g = sign * rows[:, GRADIENT][:, :3]
        whose = np.ones((len(rows), 1)) if number == 1 else one_per_source(number, each)(rows)
        return (whose[:, :, np.newaxis] * g[:, np.newaxis]).reshape(len(rows), 3 * whose.shape[1])

    return coefficients


def spread(*parts: tuple[float, ...] | float, number: int = 3) -> np.ndarray:
    """Return the sd of each component of an error (number): the root of the sum of the squares of `parts`."""
    return np.sqrt(sum(np.broadcast_to(part, number).astype(float) ** 2 for part in parts))


def derivative(
    fix: Callable[[np.ndarray], np.ndarray], message: np.ndarray, at: list[list[int]] | np.ndarray, step: float
) -> np.ndarray:
    """Return the derivative of a fix (m, l) with respect to the message's numbers `at`, or groups of numbers."""
    columns = []
    for places in at:
        change = np.zeros(len(message))
        change[places] = step
        columns.append((fix(message + change) - fix(message - change)) / (2.0 * step))
    return np.column_stack(columns)
