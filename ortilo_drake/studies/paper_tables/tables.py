"""The paper's tables I and II, ours beside its own."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

from ortilo_drake.flight.efficiency import Ratio, ratio_of_means
from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.summary import Summary, players_of

SCENARIOS = ("imu_uwb", "imu_uwb_yolo")
PRESETS = ("tuned", "nominal", "paper")
STATISTICS = ("mean", "median", "p75", "p25")

Statistics = dict[str, float | None]  # by name of STATISTICS; None each of no values
Interval = tuple[float, float]


@dataclass(frozen=True)
class PaperTables:
    """The paper's figures by scenario: of the estimation by axis, and of the path following [m^2]."""

    estimation: dict[str, dict[str, dict[str, float]]]
    path: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Drop:
    """The share by which the camera lowers the median MSE in x, and its 95 % interval."""

    median: float
    interval: Interval


@dataclass(frozen=True)
class AxisEfficiency:
    """An axis's efficiency over flights: statistics, their intervals, of all together, tick by tick, the mean floor."""

    mean: float | None
    median: float | None
    p75: float | None
    p25: float | None
    intervals: dict[str, Interval | None]
    all: Ratio
    ticks: Ratio
    floor: float | None


@dataclass(frozen=True)
class Tables:
    """The tables of an ensemble, as `ortilo tables --json` writes them; each field by scenario, but for a few.

    Attributes:
        preset: 'tuned', 'nominal' or 'paper'.
        flights: of each scenario.
        lost: how many were lost; they are not averaged.
        touched: how many of the others touched furniture.
        estimation: statistics of the mean squared error by axis [m^2].
        path: statistics of the path-following error [m^2].
        path_distance: statistics of the mean squared distance to the path [m^2].
        intervals: 95 % intervals by column, the axes and 'path', and statistic.
        efficiency: by axis.
        drop_in_x: of both scenarios together.
        nees: mean NEES of the position.
        arrivals: mean rate of arrivals by sensor.
        players: who flew.
        paper: the paper's own tables.
    """

    preset: str
    flights: int
    lost: dict[str, int]
    touched: dict[str, int]
    estimation: dict[str, dict[str, Statistics]]
    path: dict[str, Statistics]
    path_distance: dict[str, Statistics]
    intervals: dict[str, dict[str, dict[str, Interval | None]]]
    efficiency: dict[str, dict[str, AxisEfficiency]]
    drop_in_x: Drop | None
    nees: dict[str, float | None]
    arrivals: dict[str, dict[str, float | None]]
    players: dict[str, str]
    paper: PaperTables


# The paper's tables (mean squared errors [m^2]), each in the order of STATISTICS.
_PAPER_ESTIMATION = {
    "imu_uwb": {
        "x": (0.0920, 0.0993, 0.1210, 0.0673),
        "y": (0.0071, 0.0049, 0.0072, 0.0041),
        "z": (0.0226, 0.0179, 0.0310, 0.0028),
    },
    "imu_uwb_yolo": {
        "x": (0.0120, 0.0066, 0.0082, 0.0037),
        "y": (0.0412, 0.0032, 0.0103, 0.0020),
        "z": (0.0173, 0.0120, 0.0277, 0.0005),
    },
}
_PAPER_PATH = {
    "imu_uwb": (0.0098, 0.0080, 0.0096, 0.0071),
    "imu_uwb_yolo": (0.0101, 0.0052, 0.0066, 0.0046),
}
PAPER = PaperTables(
    estimation={
        scenario: {axis: dict(zip(STATISTICS, row, strict=True)) for axis, row in rows.items()}
        for scenario, rows in _PAPER_ESTIMATION.items()
    },
    path={scenario: dict(zip(STATISTICS, row, strict=True)) for scenario, row in _PAPER_PATH.items()},
)

_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "mean": np.mean,
    "median": np.median,
    "p75": lambda values, axis=-1: np.percentile(values, 75, axis=axis),
    "p25": lambda values, axis=-1: np.percentile(values, 25, axis=axis),
}

# Flights needed for a percentile bootstrap's 95 % interval to hold the true value in 90 % of all cases, with log-normal
# errors of sigma 1. Coverage by simulation: mean 0.39 with 2 flights, 0.83 with 13, 0.86 with 20, 0.90 with 60; median
# 0.74 with 3, 0.93 with 5; quartile 0.75 with 5, 0.89 with 8, 0.91 with 10.
ENOUGH_FLIGHTS = {"mean": 60, "median": 6, "p75": 10, "p25": 10}


def statistics(values: list[float]) -> Statistics:
    """Return mean, median and quartiles; None each if there is no value."""
    if not values:
        return dict.fromkeys(STATISTICS)
    return {name: float(_FUNCTIONS[name](np.array(values))) for name in STATISTICS}


def bootstrap_interval(values: list[float], statistic: str) -> Interval | None:
    """Return the bootstrap 95 % interval (percentile method) of a statistic; None below two values."""
    if len(values) < 2:
        return None
    found = scipy.stats.bootstrap(
        (np.array(values),),
        _FUNCTIONS[statistic],
        vectorized=True,
        method="percentile",
        rng=np.random.default_rng(0),
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def intervals_of(values: list[float]) -> dict[str, Interval | None]:
    """Return the bootstrap interval of every statistic."""
    return {statistic: bootstrap_interval(values, statistic) for statistic in STATISTICS}


def drop_in_x(without: list[float], with_camera: list[float]) -> Drop | None:
    """Return the share by which the camera lowers the median MSE in x, with its bootstrap 95 % interval.

    The paper's own 93.35 % is 1 - 0.0066 / 0.0993.
    """
    if len(without) < 2 or len(with_camera) < 2:
        return None

    def drop(a: np.ndarray, b: np.ndarray, axis: int = -1) -> np.ndarray:
        return 1.0 - np.median(b, axis=axis) / np.median(a, axis=axis)

    samples = (np.array(without), np.array(with_camera))
    found = scipy.stats.bootstrap(samples, drop, vectorized=True, method="percentile", rng=np.random.default_rng(0))
    low, high = found.confidence_interval
    return Drop(float(drop(*samples)), (float(low), float(high)))


def efficiency_table(rows: list[Summary]) -> dict[str, AxisEfficiency]:
    """Return each axis's efficiency over flights: statistics, of all together, tick by tick, and the mean floor."""
    table = {}
    for axis in AXES:
        known = [s for s in rows if s.efficiency[axis] is not None]
        values = [value for s in known if (value := s.efficiency[axis]) is not None]
        floors = [s.floor[axis] for s in known if s.floor]
        ticks = [value for s in known if (value := s.tick_efficiency[axis]) is not None]
        table[axis] = AxisEfficiency(
            **statistics(values),
            intervals=intervals_of(values),
            all=ratio_of_means([s.mse[axis] for s in known], floors),
            ticks=Ratio(statistics(ticks)["mean"], bootstrap_interval(ticks, "mean")),
            floor=float(np.mean(floors)) if floors else None,
        )
    return table


def make_tables(preset: str, summaries: dict[str, list[Summary]]) -> Tables:
    """Return the tables of an ensemble, as `ortilo tables --json` writes them.

    Lost flights are counted, not averaged.

    Args:
        preset: 'tuned', 'nominal' or 'paper'.
        summaries: the flights' summaries by scenario: 'imu_uwb', 'imu_uwb_yolo' and any others to stand beside them.
    """
    kept = {name: [s for s in rows if s.lost is None] for name, rows in summaries.items()}
    x = {name: [s.mse["x"] for s in rows] for name, rows in kept.items()}
    estimation, path, intervals = {}, {}, {}
    for name, rows in kept.items():
        columns = {axis: [s.mse[axis] for s in rows] for axis in AXES}
        columns["path"] = [s.path_mse for s in rows if s.path_mse is not None]
        intervals[name] = {column: intervals_of(values) for column, values in columns.items()}
        path[name] = statistics(columns.pop("path"))
        estimation[name] = {axis: statistics(values) for axis, values in columns.items()}
    return Tables(
        preset=preset,
        flights=max(len(rows) for rows in summaries.values()),
        lost={name: sum(s.lost is not None for s in rows) for name, rows in summaries.items()},
        touched={name: sum(bool(s.contacts) for s in rows) for name, rows in kept.items()},
        estimation=estimation,
        path=path,
        path_distance={name: statistics([s.path_distance_mse for s in rows]) for name, rows in kept.items()},
        intervals=intervals,
        efficiency={name: efficiency_table(rows) for name, rows in kept.items()},
        drop_in_x=drop_in_x(x["imu_uwb"], x["imu_uwb_yolo"]),
        nees={name: statistics([s.nees for s in rows])["mean"] for name, rows in kept.items()},
        arrivals={
            name: {
                sensor: statistics([rate for s in rows if (rate := s.arrivals[sensor]) is not None])["mean"]
                for sensor in (rows[0].arrivals if rows else ())
            }
            for name, rows in kept.items()
        },
        players={name: players_of(rows) for name, rows in summaries.items()},
        paper=PAPER,
    )
