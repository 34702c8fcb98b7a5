"""A process whose highest value has a known law, and the estimate of a study of it."""

from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from ortilo_drake.studies.rare.estimate import Estimate, counted_of, estimate
from ortilo_drake.studies.rare.subset import Climb, Plan

TICKS, KEPT = 40, 0.9  # of the process x' = KEPT x + sqrt(1 - KEPT^2) w, stationary of variance 1
FRESH = np.sqrt(1.0 - KEPT**2)


def highest(z: np.ndarray) -> np.ndarray:
    """The largest value of the process in its ticks (n)."""
    x = z[:, 0].astype(float)
    top = x.copy()
    for k in range(1, TICKS):
        x = KEPT * x + FRESH * z[:, k]
        np.maximum(top, x, out=top)
    return top


def law(goal: float) -> float:
    """P(largest >= goal): the density of those still below it, carried from tick to tick by quadrature."""
    ends = np.linspace(-8.0, goal, 801)
    grid, width = 0.5 * (ends[1:] + ends[:-1]), ends[1] - ends[0]
    kernel = norm.pdf((grid[:, np.newaxis] - KEPT * grid) / FRESH) / FRESH * width
    density = norm.pdf(grid)
    for _ in range(TICKS - 1):
        density = kernel @ density
    return float(1.0 - width * density.sum())


@cache
def goal_of(probability: float) -> float:
    return float(brentq(lambda goal: law(goal) - probability, -1.0, 7.0))


def answer(plan: Plan, found: list[Climb], paths: int, counted: int = 0, events: int = 0) -> Estimate:
    """The estimate of a study that counted so many flights beside its repetitions."""
    met = plan.met + sum(one.met for one in found) + events
    return estimate(plan, found, paths, counted_of(paths * (1 + len(found)) + counted, met), counted, events)
