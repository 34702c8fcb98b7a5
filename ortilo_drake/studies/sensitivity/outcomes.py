"""Losses and the filter's errors of each flight: all that a study of hundreds keeps, as a flight takes megabytes.

A flight's whole summary, with its Cramer-Rao floor, takes 50 times as long, a fifth of a quick flight. The compiled
engine flies what it can (flight/engine.py), Drake the rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from ortilo_drake.flight.figures import FIGURES
from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.kept import fly_kept
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.flight.store import Count, Error
from ortilo_drake.studies.maps.chunks import fly_figures

COMPILED_AT_ONCE = 16  # flights in one job of a worker


@dataclass(frozen=True)
class Outcome:
    """The outcome of a flight in a study of mismatches: the seed of all noise, and whether it was lost.

    Up to a loss there are the mean squared error of the estimate per axis [m^2], see metrics.estimation_mse, and the
    mean of metrics.position_nees, 3 if the filter is consistent.
    """

    seed: Count
    lost: bool
    mse: dict[str, Error]
    nees: float


def outcome(seed: int, figures: Sequence[float]) -> Outcome:
    """Return the figures that are kept of a flight, of all that flight/figures.py has; up to where it diverged."""
    found = dict(zip(FIGURES, map(float, figures), strict=False))
    return Outcome(seed, found["cause"] != NOT_LOST, {axis: found[f"mse_{axis}"] for axis in AXES}, found["nees"])


def fly_outcomes_of(scenario_json: str, seeds: list[int], folder: str) -> list[Outcome]:
    """Fly some seeds and return their outcomes. Runs in a worker: the arguments are plain data."""
    return list(map(outcome, seeds, fly_figures(scenario_json, seeds, folder)))


fly_outcomes = partial(fly_kept, Outcome, fly_outcomes_of, at_once=COMPILED_AT_ONCE)
