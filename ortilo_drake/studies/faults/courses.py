"""The course of the filter's error through a flight, by half seconds: all that the study keeps of a flight.

The compiled engine flies what it can (flight/engine.py), Drake the rest; of the same flights the courses are the same.
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from ortilo_drake.flight.figures import ESTIMATED, NEES, TRUE
from ortilo_drake.flight.kept import fly_kept
from ortilo_drake.flight.lost import Lost
from ortilo_drake.flight.players import kept_player
from ortilo_drake.flight.store import Amount, Count, Error
from ortilo_drake.flight.summary import Loss
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.maps.chunks import traced

BIN: Final = 0.5  # [s]
COMPILED_AT_ONCE: Final = 50  # flights in one job of a worker


@dataclass(frozen=True)
class Course:
    """The errors over time that are kept of a flight, by the seed of all its noise; lost at [s], None if it was not.

    In each BIN, up to a loss, there are the mean squared distance of estimated and true position [m^2] and the mean of
    the position's NEES, 3 if the filter is consistent.
    """

    seed: Count
    lost: Amount | None
    square: list[Error]
    nees: list[float]


def course_of(seed: int, trace: np.ndarray, loss: Loss | Lost | None, h: float) -> Course:
    """Return the course of a flight up to where it diverged, from its trace (n, 10 or more), loss and tick h [s]."""
    trace = trace[np.isfinite(trace[:, :NEES]).all(axis=1)]
    bins = np.floor(np.arange(len(trace)) * h / BIN + 1e-6).astype(int)
    square = np.sum((trace[:, ESTIMATED] - trace[:, TRUE]) ** 2, axis=1)
    return Course(seed, None if loss is None else loss.time, _means(bins, square), _means(bins, trace[:, NEES]))


def _means(bins: np.ndarray, values: np.ndarray) -> list[float]:
    mean: list[float] = (np.bincount(bins, values) / np.bincount(bins)).tolist()
    return mean


def fly_courses_of(scenario_json: str, seeds: list[int], folder: str) -> list[Course]:
    """Fly some seeds and return their courses. Runs in a worker: the arguments are plain data."""
    player, h = kept_player(scenario_json, folder), Scenario.model_validate_json(scenario_json).h
    return [course_of(seed, *traced(player, seed), h) for seed in seeds]


fly_courses = partial(fly_kept, Course, fly_courses_of, at_once=COMPILED_AT_ONCE)
