"""The flights of a map: all points' chunks on the workers, and a row of figures for each point."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ortilo_drake.flight.ensemble import flight_folder, fly_many
from ortilo_drake.flight.intervals import Interval, middle_of, quantile, quantile_interval, share_interval
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.flight.players import choose, flown_by
from ortilo_drake.flight.processes.workers import kept_workers, run_all
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.maps.chunks import (
    chunk_file,
    chunks_of,
    columns_of,
    fly_figures,
    player_of_chunk,
    read_chunk,
    write_chunk,
)
from ortilo_drake.studies.maps.sweep import Sweep, Until, Value, points_of, scenario_at
from ortilo_drake.theory.consistency.consistency import nees_interval


@dataclass(frozen=True)
class MapPoint:
    """The flights at a point of a map."""

    point: dict[str, Value]
    """its settings."""
    flights: int
    """number of flights."""
    lost: int
    """number of lost flights."""
    lost_low: float
    """lower end of Wilson's 95 % interval of the share of lost flights [1]."""
    lost_high: float
    """upper end of that interval [1]."""
    rms: float | None
    """median root mean squared error of the estimated position [m]; infinite (null in JSON) if the median is that of a
    lost flight, as each lost flight is worse than any that was kept."""
    rms_interval: Interval | None
    """95 % interval of rms; None for too few flights."""
    kept_rms: float | None
    """median of the flights that were not lost, as all that follow; None if all were lost."""
    kept_interval: Interval | None
    """95 % interval of kept_rms; None for too few flights."""
    rms_low: float | None
    """lower quartile of the kept flights' errors [m]."""
    rms_high: float | None
    """upper quartile of the kept flights' errors [m]."""
    farthest: float | None
    """median of the largest distance from the path [m]."""
    farthest_interval: Interval | None
    """95 % interval of farthest; None for too few flights."""
    nees: float | None
    """mean of the position's NEES, 3 if the filter is consistent."""
    nees_interval: Interval | None
    """95 % interval of nees by Student's t; None for fewer than two flights."""
    arrived: dict[str, float]
    """measurements used over those due, by sensor [1], over all flights."""


@dataclass(frozen=True)
class Map:
    """A map: its sweep, a row for each point, and the players that flew."""

    sweep: Sweep
    rows: list[MapPoint]
    flown_by: str


def is_enough(sweep: Sweep, lost: int, flights: int) -> bool:
    """Return whether these numbers of flights and lost flights at a point are precise enough."""
    if not isinstance(sweep.flights, Until):
        return flights >= sweep.flights
    low, high = share_interval(lost, flights)
    return flights >= sweep.flights.at_most or high - low <= 2.0 * sweep.flights.half_width


def fly_map(
    sweep: Sweep,
    source: str,
    out: Path,
    workers: int,
    progress: Callable[[int], None] = lambda flown: None,
    player: str = "fastest",
) -> Map:
    """Fly a map; `source` begins its errors, and progress gets the number of flights that came in.

    Chunks that are already in the folder `out` are not flown again; 1 worker flies in this process. If the number of
    flights is open, the points that need more get a chunk each, round by round: so their number depends on the flights
    alone, not on which worker was first. `player` is as in players.choose; chunks already in the folder stay, whichever
    player flew them. InputError if a point's scenario is wrong, the player cannot fly it, a flight cannot be flown, or
    a file cannot be written.
    """
    points = points_of(sweep)
    scenarios = [scenario_at(sweep, point, source) for point in points]
    folders = [flight_folder(out, scenario) for scenario in scenarios]
    chunks = chunks_of(sweep.seed, sweep.most_flights)
    counts = [[0, 0] for _ in points]  # lost, flights
    open_points, number = list(range(len(points))), 0
    step = 1 if isinstance(sweep.flights, Until) else len(chunks)
    with kept_workers():
        while open_points and number < len(chunks):
            of_round = chunks[number : number + step]
            wanted = [(scenarios[i], folders[i], chunk) for i in open_points for chunk in of_round]
            _fly(wanted, workers, progress, player)
            for i in open_points:
                for chunk in of_round:
                    figures = _kept(scenarios[i], folders[i], chunk)
                    counts[i][0] += int(np.sum(figures[:, 1] != NOT_LOST))
                    counts[i][1] += len(figures)
            open_points = [i for i in open_points if not is_enough(sweep, *counts[i])]
            number += step
        if sweep.whole:
            seeds = range(sweep.seed, sweep.seed + min(sweep.whole, sweep.most_flights))
            for scenario in scenarios:
                fly_many(scenario, seeds, out / "whole", workers, player=player)
    rows, players = [], set[str]()
    for point, scenario, folder, (_, flights) in zip(points, scenarios, folders, counts, strict=True):
        used = [chunk for chunk in chunks if chunk.start - sweep.seed < flights]
        rows.append(_row(point, scenario, folder, used))
        players.update(player_of_chunk(folder, chunk) for chunk in used)
    return Map(sweep, rows, flown_by(scenarios, players))


def figures_of_points(
    scenarios: list[Scenario], out: Path, seed: int, flights: int, workers: int, player: str = "fastest"
) -> tuple[list[np.ndarray], set[str]]:
    """Fly scenarios, each on `flights` seeds from `seed` on; return each one's figures (n, columns), and the players.

    Flights kept in the folder `out` are not flown again; 1 worker flies in this process; player as in fly_map.
    """
    folders, chunks = [flight_folder(out, scenario) for scenario in scenarios], chunks_of(seed, flights)
    pairs = list(zip(scenarios, folders, strict=True))
    _fly([(*pair, chunk) for pair in pairs for chunk in chunks], workers, lambda flown: None, player)
    figures = [np.concatenate([_kept(*pair, chunk) for chunk in chunks]) for pair in pairs]
    return figures, {player_of_chunk(folder, chunk) for folder in folders for chunk in chunks}


def _fly(
    wanted: Sequence[tuple[Scenario, Path, range]], workers: int, progress: Callable[[int], None], player: str
) -> None:
    """Fly the chunks that are missing, and keep their figures; InputError if the player cannot fly one of all."""
    players = {id(scenario): choose(scenario, player) for scenario, _, _ in wanted}
    missing = []
    for scenario, folder, chunk in wanted:
        if read_chunk(folder, chunk, columns_of(scenario)) is not None:
            progress(len(chunk))
        else:
            missing.append((scenario, folder, chunk))
    texts = {id(scenario): scenario.model_dump_json() for scenario, _, _ in missing}
    jobs = [(texts[id(scenario)], chunk, folder.name, players[id(scenario)]) for scenario, folder, chunk in missing]

    def take(number: int, figures: np.ndarray) -> None:
        scenario, folder, chunk = missing[number]
        write_chunk(folder, chunk, columns_of(scenario), figures, players[id(scenario)])
        progress(len(chunk))

    run_all(fly_figures, jobs, workers, take)


def _kept(scenario: Scenario, folder: Path, chunk: range) -> np.ndarray:
    figures = read_chunk(folder, chunk, columns_of(scenario))
    if figures is None:
        raise InputError(f"{chunk_file(folder, chunk)}: was flown, and is gone or damaged now; run it again")
    return figures


def _row(point: dict[str, Value], scenario: Scenario, folder: Path, used: list[range]) -> MapPoint:
    """Return the figures of a point from the chunks used; only one point's figures are in memory at a time."""
    columns = columns_of(scenario)
    figures = np.concatenate([_kept(scenario, folder, chunk) for chunk in used])
    named = dict(zip(columns, figures.T, strict=True))
    is_lost = named["cause"] != NOT_LOST
    lost = int(is_lost.sum())
    rms = np.sqrt(named["mse_x"] + named["mse_y"] + named["mse_z"])[~is_lost].tolist()
    middle = middle_of(rms, lost)
    arrived = {
        sensor: float(named[f"arrived_{sensor}"].sum() / named[f"due_{sensor}"].sum())
        for sensor in (name.removeprefix("due_") for name in columns if name.startswith("due_"))
    }
    farthest = named["max_path_distance"][~is_lost].tolist()
    nees = named["nees"][~is_lost].tolist()
    return MapPoint(
        point=point,
        flights=len(figures),
        lost=lost,
        lost_low=share_interval(lost, len(figures))[0],
        lost_high=share_interval(lost, len(figures))[1],
        rms=middle.median,
        rms_interval=middle.interval,
        kept_rms=middle.kept,
        kept_interval=middle.kept_interval,
        rms_low=quantile(rms, 0.25),
        rms_high=quantile(rms, 0.75),
        farthest=quantile(farthest),
        farthest_interval=quantile_interval(farthest),
        nees=float(np.mean(nees)) if nees else None,
        nees_interval=nees_interval(np.array(nees)),
        arrived=arrived,
    )
