"""The paper's tables I and II, with ours beside them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

from ortilo_drake.flight.efficiency import Ratio, ratio_of_means
from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.intervals import LEVEL, Interval, quantile, quantile_interval, share_interval
from ortilo_drake.flight.summary import Summary

SCENARIOS = ("imu_uwb", "imu_uwb_yolo")
PRESETS = ("tuned", "nominal", "paper", "printed")
STATISTICS = ("mean", "median", "p75", "p25")
QUANTILES = {"median": 0.5, "p75": 0.75, "p25": 0.25}

T = TypeVar("T")
Statistics = dict[str, float | None]  # by name of STATISTICS; each None if there are no values
Intervals = dict[str, Interval | None]  # by name of STATISTICS; None for too few values


@dataclass(frozen=True)
class PaperTables:
    """The paper's figures by scenario: estimation error by axis, and path-following error [m^2]."""

    estimation: dict[str, dict[str, dict[str, float]]]
    path: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Drop:
    """The share by which the camera lowers the median MSE in x, with lost flights as worst, and for the kept flights.

    median is None if the median without the camera is that of a lost flight, or both are. The intervals hold with a
    probability of at least 95 %; None for too few flights.
    """

    median: float | None
    interval: Interval | None
    kept: float | None
    kept_interval: Interval | None


@dataclass(frozen=True)
class AxisEfficiency:
    """An axis's efficiency over flights that were not lost; fields named with_lost include the lost ones.

    Mean, median and quartiles, with their intervals, are over single flights, with a lost one as worst. `all` is the
    error of all flights over their floor, `ticks` the mean over ticks, up to its loss for a lost flight. floor is the
    mean floor [m^2].
    """

    mean: float | None
    median: float | None
    p75: float | None
    p25: float | None
    intervals: Intervals
    with_lost: Statistics
    with_lost_intervals: Intervals
    all: Ratio
    all_with_lost: Ratio
    ticks: Ratio
    ticks_with_lost: Ratio
    floor: float | None


@dataclass(frozen=True)
class Tables:
    """The tables of an ensemble, as `ortilo tables --json` writes them; most fields are by scenario."""

    preset: str
    """one of PRESETS."""
    flights: int
    """number of flights of each scenario."""
    lost: dict[str, int]
    """number of lost flights; they are not averaged."""
    lost_share: dict[str, Interval]
    """Wilson's 95 % interval of the share of lost flights [1]."""
    touched: dict[str, int]
    """number of the other flights that touched furniture."""
    estimation: dict[str, dict[str, Statistics]]
    """statistics of the mean squared error by axis [m^2]."""
    path: dict[str, Statistics]
    """statistics of the path-following error [m^2]."""
    path_distance: dict[str, Statistics]
    """statistics of the mean squared distance to the path [m^2]."""
    intervals: dict[str, dict[str, Intervals]]
    """95 % intervals by column (the axes, 'path' and 'path_distance') and statistic."""
    with_lost: dict[str, dict[str, Statistics]]
    """median and quartiles of these columns with each lost flight as worst: null where the value is a lost flight's."""
    with_lost_intervals: dict[str, dict[str, Intervals]]
    """95 % intervals of with_lost: null at an end that is a lost flight's."""
    efficiency: dict[str, dict[str, AxisEfficiency]]
    """efficiency by axis."""
    drop_in_x: Drop
    """drop of the median in x between both scenarios; each part None if only one flew."""
    nees: dict[str, Ratio]
    """mean NEES of the position."""
    nees_with_lost: dict[str, Ratio]
    """mean NEES of the position, with the lost flights up to their losses."""
    arrivals: dict[str, dict[str, float | None]]
    """mean rate of arrivals by sensor."""
    players: dict[str, str]
    """the players that flew."""
    paper: PaperTables
    """the paper's own tables."""


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
_PAPER_PATH = {"imu_uwb": (0.0098, 0.0080, 0.0096, 0.0071), "imu_uwb_yolo": (0.0101, 0.0052, 0.0066, 0.0046)}
PAPER = PaperTables(
    estimation={
        scenario: {axis: dict(zip(STATISTICS, row, strict=True)) for axis, row in rows.items()}
        for scenario, rows in _PAPER_ESTIMATION.items()
    },
    path={scenario: dict(zip(STATISTICS, row, strict=True)) for scenario, row in _PAPER_PATH.items()},
)

# Flights needed for a percentile bootstrap's 95 % interval of a mean to hold the true one in 90 % of all cases, with
# log-normal errors of sigma 1. Coverage by simulation: 0.39 with 2 flights, 0.83 with 13, 0.86 with 20, 0.90 with 60.
ENOUGH_FOR_A_MEAN = 60


def statistics(values: Sequence[float]) -> Statistics:
    """Return mean, median and quartiles; each None if there is no value."""
    return {"mean": float(np.mean(values)) if len(values) else None} | _ranked(values, quantile)


def _ranked(values: Sequence[float], of: Callable[[Sequence[float], float], T]) -> dict[str, T]:
    """Return `of` (a quantile or its interval) for median and quartiles."""
    return {name: of(values, q) for name, q in QUANTILES.items()}


def mean_interval(values: Sequence[float]) -> Interval | None:
    """Return the bootstrap 95 % interval (percentile method) of a mean; None for fewer than two values."""
    if len(values) < 2:
        return None
    rng = np.random.default_rng(0)
    found = scipy.stats.bootstrap((np.array(values),), np.mean, vectorized=True, method="percentile", rng=rng)
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def mean_of(values: Sequence[float]) -> Ratio:
    """Return a mean and its 95 % interval."""
    return Ratio(statistics(values)["mean"], mean_interval(values))


def with_lost(kept: Sequence[float], lost: int) -> list[float]:
    """Return a figure for all flights, with infinity for each lost one."""
    return [*kept, *[math.inf] * lost]


class Spread(NamedTuple):
    """A figure over flights: statistics of the kept ones, quantiles with each lost one as worst, and intervals of both.

    The mean's interval is by bootstrap, those of quantiles are by ranks. A quantile is infinite if it is a lost
    flight's.
    """

    statistics: Statistics
    intervals: Intervals
    with_lost: Statistics
    with_lost_intervals: Intervals


def spread(kept: Sequence[float], lost: int) -> Spread:
    """Return the spread of a figure, given its values for the kept flights and the number of lost ones."""
    every, intervals = with_lost(kept, lost), {"mean": mean_interval(kept)} | _ranked(kept, quantile_interval)
    return Spread(statistics(kept), intervals, _ranked(every, quantile), _ranked(every, quantile_interval))


def _drop(without: Sequence[float], with_camera: Sequence[float]) -> tuple[float | None, Interval | None]:
    """Return the drop of a median and its interval.

    The interval combines those of both medians, each with half the error probability (Bonferroni), since flights of one
    seed may be correlated.
    """
    a, b = quantile(without), quantile(with_camera)
    low, high = (quantile_interval(values, 0.5, 0.5 * (1.0 + LEVEL)) for values in (without, with_camera))
    drop, ends = None if not a or b is None or math.isinf(a) else 1.0 - b / a, None
    if low is not None and high is not None and 0.0 < low[0] < math.inf:
        ends = (1.0 - high[1] / low[0], 1.0 - high[0] / low[1] if high[0] < math.inf else -math.inf)
    return drop, ends


def drop_in_x(without: Sequence[float], with_camera: Sequence[float], flights: tuple[int, ...]) -> Drop:
    """Return the share by which the camera lowers the median MSE in x.

    The values are those of the kept flights; `flights` are the numbers flown without and with the camera. The paper's
    own 93.35 % is 1 - 0.0066 / 0.0993.
    """
    every = (with_lost(kept, n - len(kept)) for kept, n in zip((without, with_camera), flights, strict=True))
    return Drop(*_drop(*every), *_drop(without, with_camera))


def efficiency_of(axis: str, rows: list[Summary]) -> AxisEfficiency:
    """Return an axis's efficiency over flights."""
    known = [s for s in rows if s.efficiency[axis] is not None]
    kept = [s for s in known if s.lost is None]
    figures = spread([value for s in kept if (value := s.efficiency[axis]) is not None], len(known) - len(kept))

    def whole(of: list[Summary]) -> Ratio:
        return ratio_of_means([s.mse[axis] for s in of], [s.floor[axis] for s in of if s.floor])

    def ticks(of: list[Summary]) -> Ratio:
        return mean_of([value for s in of if (value := s.tick_efficiency[axis]) is not None])

    return AxisEfficiency(
        **figures.statistics,
        intervals=figures.intervals,
        with_lost=figures.with_lost,
        with_lost_intervals=figures.with_lost_intervals,
        all=whole(kept),
        all_with_lost=whole(known),
        ticks=ticks(kept),
        ticks_with_lost=ticks(known),
        floor=statistics([s.floor[axis] for s in kept if s.floor])["mean"],
    )


def _spreads(kept: list[Summary], lost: int) -> dict[str, Spread]:
    """Return the spread of each column over flights; of the path-following error where it is defined."""
    path = [s.path_mse for s in kept if s.path_mse is not None]
    columns = {axis: spread([s.mse[axis] for s in kept], lost) for axis in AXES}
    columns["path"] = spread(path, lost if path or not kept else 0)
    return columns | {"path_distance": spread([s.path_distance_mse for s in kept], lost)}


def make_tables(preset: str, summaries: dict[str, list[Summary]]) -> Tables:
    """Return the tables of an ensemble for a preset, as `ortilo tables --json` writes them.

    The flights' summaries are by scenario: 'imu_uwb', 'imu_uwb_yolo' or both, and any others beside them. Lost flights
    are counted. They are worst in the fields named with_lost, and left out of all other figures.
    """
    kept = {name: [s for s in rows if s.lost is None] for name, rows in summaries.items()}
    lost = {name: len(rows) - len(kept[name]) for name, rows in summaries.items()}
    spreads = {name: _spreads(rows, lost[name]) for name, rows in kept.items()}
    without, with_camera = ([s.mse["x"] for s in kept.get(name, ())] for name in SCENARIOS)

    def of_columns(part: str) -> dict[str, Any]:
        return {name: {column: getattr(its, part) for column, its in of.items()} for name, of in spreads.items()}

    of_all = of_columns("statistics")
    return Tables(
        preset=preset,
        flights=max(len(rows) for rows in summaries.values()),
        lost=lost,
        lost_share={name: share_interval(lost[name], len(rows)) for name, rows in summaries.items()},
        touched={name: sum(bool(s.contacts) for s in rows) for name, rows in kept.items()},
        estimation={name: {axis: of[axis] for axis in AXES} for name, of in of_all.items()},
        path={name: of["path"] for name, of in of_all.items()},
        path_distance={name: of["path_distance"] for name, of in of_all.items()},
        intervals=of_columns("intervals"),
        with_lost=of_columns("with_lost"),
        with_lost_intervals=of_columns("with_lost_intervals"),
        efficiency={name: {axis: efficiency_of(axis, rows) for axis in AXES} for name, rows in summaries.items()},
        drop_in_x=drop_in_x(without, with_camera, tuple(len(summaries.get(name, ())) for name in SCENARIOS)),
        nees={name: mean_of([s.nees for s in rows]) for name, rows in kept.items()},
        nees_with_lost={name: mean_of([s.nees for s in rows]) for name, rows in summaries.items()},
        arrivals={
            name: {
                sensor: statistics([rate for s in rows if (rate := s.arrivals[sensor]) is not None])["mean"]
                for sensor in (rows[0].arrivals if rows else ())
            }
            for name, rows in kept.items()
        },
        players={k: ", ".join(sorted({s.player or "unknown" for s in rows})) for k, rows in summaries.items()},
        paper=PAPER,
    )
