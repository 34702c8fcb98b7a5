"""Efficiency: the filter's squared error over the Cramer-Rao floor (floor/cramer_rao.py)."""

from dataclasses import dataclass

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used
import xarray as xr

from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.floor.cramer_rao import position_floor

START = 2.0  # the start of a flight, which tick_efficiency leaves out [s]


@dataclass(frozen=True)
class Ratio:
    """A ratio over flights [1] and its 95 % interval; each is None where there are too few flights for it."""

    value: float | None
    interval: tuple[float, float] | None


def floor_at_ticks(flight: xr.Dataset) -> np.ndarray | None:
    """Return the least mean squared error of xhat_{k|k-1} per axis at every tick [m^2] (n, 3); see position_floor."""
    return position_floor(scenario_of(flight), flight["truth"].values)


def mean_floor(floor: np.ndarray | None) -> dict[str, float] | None:
    """Return the mean of the floor over all ticks, per axis [m^2]; None where there is no floor."""
    return None if floor is None else dict(zip(AXES, np.mean(floor, axis=0).tolist(), strict=True))


def efficiency(mse: dict[str, float], floor: dict[str, float] | None) -> dict[str, float | None]:
    """Return the ratio of the mean squared error to the mean floor, per axis [1]; None where no floor is above 0.

    Its average over many flights is at least 1. A single flight is often below 1: its errors are correlated in time.
    """
    floor = floor or {}
    return {axis: value / floor[axis] if floor.get(axis, 0.0) > 0.0 else None for axis, value in mse.items()}


def tick_efficiency(flight: xr.Dataset, floor: np.ndarray | None) -> dict[str, float | None]:
    """Return the mean over ticks of the ratio squared error / floor, per axis [1]; None where no floor is above 0.

    Almost all of the mean squared error comes from the blackouts, in which a flight drifts to one side. Here every tick
    has the same weight, so fewer flights are needed to tell a filter from the floor. The first START seconds are left
    out: there the floor rises from 0, and the filter's error depends on the initial belief that the filter assumes.
    """
    if floor is None:
        return dict.fromkeys(AXES)
    later = slice(round(START / scenario_of(flight).h), None)
    e2, floor = (flight["estimate"].values[later, :3] - flight["truth"].values[later, :3]) ** 2, floor[later]
    there = floor > 0.0
    return {
        axis: float(np.mean(e2[there[:, i], i] / floor[there[:, i], i])) if there[:, i].any() else None
        for i, axis in enumerate(AXES)
    }


def ratio_of_means(errors: list[float], floors: list[float]) -> Ratio:
    """Return sum(errors) / sum(floors) over flights, with a bootstrap 95 % interval over whole flights.

    Errors and floors have one value for each flight. By the Cramer-Rao bound the ratio is at least 1 on average.
    """
    if not floors or sum(floors) <= 0.0:
        return Ratio(None, None)

    def ratio(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return np.sum(a, axis=axis) / np.sum(b, axis=axis)

    samples, found = (np.array(errors), np.array(floors)), None
    if len(floors) > 1:
        rng = np.random.default_rng(0)
        found = scipy.stats.bootstrap(samples, ratio, vectorized=True, paired=True, method="percentile", rng=rng)
    low_high = found and (float(found.confidence_interval.low), float(found.confidence_interval.high))
    return Ratio(float(ratio(*samples)), low_high)
