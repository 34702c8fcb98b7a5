"""The course of the filter's error through a flight, by half seconds: all that the study keeps of a flight.

The compiled engine flies what it can (flight/engine.py), Drake the rest; of the same flights the courses are the same.
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.figures import ESTIMATED, NEES, TRUE, nees_of_ticks
from ortilo_drake.flight.kept import fly_kept
from ortilo_drake.flight.metrics import loss_of
from ortilo_drake.flight.players import kept_player
from ortilo_drake.flight.store import Amount, Count, Error

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


def course(flight: xr.Dataset) -> Course:
    """Return the figures that are kept of a flight."""
    whole = np.isfinite(flight["truth"].values).all(axis=1) & np.isfinite(flight["estimate"].values).all(axis=1)
    if not whole.all():
        flight = flight.isel(tick=whole)  # all but the end of a flight that diverged
    x, xhat = np.ascontiguousarray(flight["truth"].values), np.ascontiguousarray(flight["estimate"].values)
    nees = nees_of_ticks(x, xhat, flight["covariance"].values.reshape(len(x), -1))
    loss = loss_of(flight)
    lost = None if loss is None else loss.time
    return course_of(int(flight.attrs["seed"]), flight["time"].values, xhat[:, :3] - x[:, :3], nees, lost)


def compiled_course(engine: Engine, seed: int) -> Course:
    """Return the figures that are kept of a flight of the engine."""
    trace, loss = engine.trace(seed)
    trace = trace[np.isfinite(trace[:, :NEES]).all(axis=1)]
    e = trace[:, ESTIMATED] - trace[:, TRUE]
    return course_of(seed, np.arange(len(trace)) * engine.h, e, trace[:, NEES], None if loss is None else loss.time)


def course_of(seed: int, time: np.ndarray, e: np.ndarray, nees: np.ndarray, lost: float | None) -> Course:
    """Return the course of a flight: times (n) [s], estimated less true position (n, 3) [m], NEES (n), its loss [s]."""
    bins = np.floor(time / BIN + 1e-6).astype(int)
    return Course(seed, lost, _means(bins, np.sum(e**2, axis=1)), _means(bins, nees))


def _means(bins: np.ndarray, values: np.ndarray) -> list[float]:
    mean: list[float] = (np.bincount(bins, values) / np.bincount(bins)).tolist()
    return mean


def fly_courses_of(scenario_json: str, seeds: list[int], folder: str) -> list[Course]:
    """Fly some seeds and return their courses. Runs in a worker: the arguments are plain data."""
    player = kept_player(scenario_json, folder)
    if isinstance(player, Engine):
        return [compiled_course(player, seed) for seed in seeds]
    return [course(player.fly(seed)) for seed in seeds]


fly_courses = partial(fly_kept, Course, fly_courses_of, at_once=COMPILED_AT_ONCE)
