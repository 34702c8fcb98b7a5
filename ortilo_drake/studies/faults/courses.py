"""The course of the filter's error through a flight, in half seconds: all that the study keeps of it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from ortilo_drake.flight.ensemble import simulator_of
from ortilo_drake.flight.kept import fly_kept
from ortilo_drake.flight.metrics import loss_of, position_nees
from ortilo_drake.scenario import Scenario

BIN: Final = 0.5  # [s]


@dataclass(frozen=True)
class Course:
    """What is kept of a flight.

    Attributes:
        seed: of all noise.
        lost: when it was lost [s]; None if it was not.
        square: mean squared distance of estimated and true position in each BIN [m^2]; up to a loss.
        nees: mean of metrics.position_nees in each BIN, 3 if the filter is consistent; up to a loss.
    """

    seed: int
    lost: float | None
    square: list[float]
    nees: list[float]


def course(flight: xr.Dataset) -> Course:
    """Return what is kept of a flight."""
    whole = np.isfinite(flight["truth"].values).all(axis=1) & np.isfinite(flight["estimate"].values).all(axis=1)
    if not whole.all():
        flight = flight.isel(tick=whole)  # all but the end of a flight that diverged
    e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    bins = np.floor(flight["time"].values / BIN + 1e-6).astype(int)
    square, nees = (_means(bins, values) for values in (np.sum(e**2, axis=1), position_nees(flight)))
    loss = loss_of(flight)
    return Course(int(flight.attrs["seed"]), None if loss is None else loss.time, square, nees)


def _means(bins: np.ndarray, values: np.ndarray) -> list[float]:
    mean: list[float] = (np.bincount(bins, values) / np.bincount(bins)).tolist()
    return mean


def fly_courses_of(scenario_json: str, seeds: list[int], folder: str) -> list[Course]:
    """Fly some seeds and return their courses. Runs in a worker: the arguments are plain data."""
    simulator = simulator_of(scenario_json, folder)
    return [course(simulator.fly(seed)) for seed in seeds]


def fly_courses(
    wanted: Sequence[tuple[Scenario, Iterable[int]]],
    out: Path,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> list[list[Course]]:
    """Fly scenarios and return their courses; arguments and errors as fly_kept's."""
    return fly_kept(Course, fly_courses_of, wanted, out, workers, progress)
