"""The engine: compiled code that flies a scenario any number of times, on any number of threads."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import xarray as xr
from numba import types

from ortilo_drake.compiled.inlined import helpers_only_linked
from ortilo_drake.diagrams.wiring.truth import drawn_values, normals_at_start
from ortilo_drake.diagrams.wiring.whole import boxes_of, signals_of, why_not
from ortilo_drake.flight.figures import (
    FIGURES,
    REFERENCE,
    TRACE_SIZE,
    TRUE,
    figures_box,
    figures_of,
    squared_distances_from,
)
from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.flyable import check_flyable
from ortilo_drake.flight.lost import CAUSES, NOT_LOST, Lost, bounds_of
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, with_seed
from ortilo_drake.world.drawn_truth import AtStart, of_seed
from ortilo_drake.world.given_noise import GivenNoise

_LOGGED = ("state", "control", "y", "delta", "V2", "belief", "reference")  # in the order of Measurement.logged_sizes
_LEARNED_BY = 4  # number of flights that show which noise streams a flight draws from


class Engine:
    """The compiled code that flies the wiring of a scenario.

    A flight equals the one of flight.flight.FlightSimulator: the same functions run on the same noise, in the same
    order. A flight depends on its scenario and seed alone, not on its thread or on other flights. InputError if a part
    of the scenario is no element (see why_not), or if the scenario cannot be flown.

    Args:
        scenario: a ready-made scenario's name, a .yaml file, or a Scenario; its own seed is not used.

    Attributes:
        columns: names of the figures of a flight: FIGURES of figures.py, then two for each sensor that flies, the
            number of its values that reached the filter and the number that were due.
        ticks: number of ticks of a flight that is not lost, the first and the last included.
        h: length of a tick [s].
    """

    def __init__(self, scenario: str | Path | Scenario):
        scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        reason = why_not(scenario)
        if reason is not None:
            raise InputError(f"{scenario.name}: {reason}: Drake flies it")
        self._scenario, self._room, self.h = scenario, scenario.load_room(), scenario.h
        last = check_flyable(scenario)
        boxes, self.ticks = boxes_of(scenario, last), last + 1
        self._signals = signals_of(boxes)
        read = {name: self._signals[name] for name in ("state", "belief", "reference")}
        self._wiring = Wiring([*boxes, figures_box(bounds_of(self._room, scenario.vehicle)).with_inputs(**read)])
        self._player = self._player_of(())
        with helpers_only_linked():  # what the draws at the start call
            drawn_values(self._wiring, scenario, self._room, of_seed(0))
        told = scenario.measurement.sensors
        sensors = [sensor for sensor in told if sensor in scenario.sensors]
        self._log_from, self._flying = TRACE_SIZE + 1 + len(told), [told.index(sensor) for sensor in sensors]
        self._periods = np.array([scenario.every(sensor) for sensor in sensors])
        self.columns = (*FIGURES, *(f"{what}_{sensor}" for sensor in sensors for what in ("arrived", "due")))

    @property
    def text(self) -> str:
        """The generated source code of a flight that writes no log."""
        return self._player.text

    def fly(self, seed: int, progress: Callable[[int], None] | None = None) -> xr.Dataset:
        """Fly with one seed of all noise; return the Dataset over ticks, see flight.flight.FlightSimulator.fly.

        `progress` is called once, at the end, with the number of ticks flown. InputError if the seed is not allowed.
        """
        scenario = with_seed(self._scenario, seed)
        _ = self._logger  # compiling does not count as flying time
        started = time.perf_counter()
        rows = self._fly_seed(seed, self._logger.rows(self.ticks), self._logger)
        wall = time.perf_counter() - started
        last = len(rows) - 1
        if progress:
            progress(last)
        flight = flight_dataset(scenario, np.arange(last + 1) * self.h, rows[:, self._log_from :], self._loss(rows))
        flight.attrs |= {"player": "engine", "real_time_factor": last * self.h / wall}
        return flight

    def trace(self, seed: int) -> tuple[np.ndarray, Lost | None]:
        """Fly one seed; return a row for each tick flown, which begins as in figures.py, and the loss of the flight.

        InputError if the seed is not allowed.
        """
        with_seed(self._scenario, seed)
        rows = self._fly_seed(seed, self._player.rows(self.ticks))
        return rows, self._loss(rows)

    def figures(self, seeds: Sequence[int], threads: int = 1) -> np.ndarray:
        """Fly n seeds on `threads` threads, and return the figures of each flight (n, columns)."""
        found = np.empty((len(seeds), len(self.columns)))
        with helpers_only_linked():
            figures_of.compile((types.float64[:, ::1], types.float64[:, ::1], types.float64[::1]))
        to_fly = iter(range(len(seeds)))

        def work() -> None:
            rows = self._player.rows(self.ticks)
            for i in to_fly:
                self._put_figures(self._fly_seed(int(seeds[i]), rows), found[i])

        if threads == 1:
            work()
        else:
            with ThreadPoolExecutor(threads) as pool:
                for done in [pool.submit(work) for _ in range(threads)]:
                    done.result()
        return found

    def _put_figures(self, rows: np.ndarray, out: np.ndarray) -> None:
        last, n = len(rows) - 1, len(FIGURES)
        out[0], out[1] = last, rows[last, TRACE_SIZE]
        figures_of(rows, np.ascontiguousarray(rows[:, REFERENCE]), out[:n])
        out[n::2] = rows[:, TRACE_SIZE + 1 : self._log_from].sum(axis=0)[self._flying]
        out[n + 1 :: 2] = last // self._periods + 1

    def simulated_time(self, figures: np.ndarray) -> float:
        """Return the total simulated time [s] of the flights whose figures (n, columns) are given."""
        return float(np.sum(figures[:, FIGURES.index("ticks")])) * self.h

    @cached_property
    def drawn(self) -> dict[str, int]:
        """The number of standard normals that the draws at the start take from each noise stream, by stream name."""
        return normals_at_start(self._wiring, self._scenario, self._room)

    @cached_property
    def noise(self) -> GivenNoise:
        """The layout of given noise: the place of each stream's numbers in it."""
        return GivenNoise(self.ticks, partial(self._fly_away, draw=of_seed(0)), _LEARNED_BY)

    @property
    def numbers(self) -> int:
        """The number of standard normals that determine a flight."""
        return self.ticks * self.noise.width + sum(self.drawn.values())

    def distances(self, seeds: np.ndarray, from_path: bool = False) -> np.ndarray:
        """Fly, and return each flight's distance from its reference at each tick [m] (n, ticks); infinity once lost.

        The seeds (n, ticks) give the seed of all noise of each flight at each tick. The draws at the start take the
        first seed of the flight. With `from_path` the distance is the one to the nearest point of the whole reference,
        else to the reference of the same tick.
        """
        return np.array([self._fly_away(its, of_seed(int(its[0])), from_path) for its in seeds.astype(np.int64)])

    def distances_given(self, numbers: np.ndarray, from_path: bool = False) -> np.ndarray:
        """Fly with given noise, and return the same distances as `distances` (n, ticks) [m].

        The standard normal numbers (n, numbers) of a flight are its rows of `noise`, tick after tick, then the numbers
        of the draws at the start, stream after stream in the order of `drawn`.
        """
        names, ends = list(self.drawn), np.cumsum(list(self.drawn.values()))
        found, at = np.empty((len(numbers), self.ticks)), self.ticks * self.noise.width
        for i, its in enumerate(numbers.astype(np.float32, copy=False)):
            parts = dict(zip(names, np.split(its[at:].astype(float), ends[:-1]), strict=True)) if names else {}
            found[i] = self._fly_away(self.noise.seeds(its[:at].reshape(self.ticks, -1)), _among(parts), from_path)
        return found

    def _fly_away(self, seeds: np.ndarray, draw: AtStart, from_path: bool = False) -> np.ndarray:
        """Return the distance of one flight from its reference or path at each tick [m] (ticks); infinity once lost."""
        rows, found = self._fly(seeds, draw, self._player.rows(self.ticks)), np.full(self.ticks, np.inf)
        rows = rows if self._loss(rows) is None else rows[:-1]
        if from_path and len(rows):
            squared = squared_distances_from(np.ascontiguousarray(rows[:, REFERENCE]), rows)
        else:
            squared = np.sum((rows[:, TRUE] - rows[:, REFERENCE]) ** 2, axis=1)
        found[: len(rows)] = np.sqrt(squared)
        return found

    def _player_of(self, logged: tuple[str, ...]) -> Player:
        return Player(self._wiring, ("figures", *(self._signals[name] for name in ("delta", *logged))), "figures")

    @cached_property
    def _logger(self) -> Player:
        player = self._player_of(_LOGGED)
        player.fly(np.zeros(1, dtype=np.int64), player.rows(1))  # compiles
        return player

    def _fly_seed(self, seed: int, rows: np.ndarray, player: Player | None = None) -> np.ndarray:
        return self._fly(np.full(self.ticks, seed), of_seed(seed), rows, player)

    def _fly(self, seeds: np.ndarray, draw: AtStart, rows: np.ndarray, player: Player | None = None) -> np.ndarray:
        """Fly once; return a row for each tick flown: the trace of figures.py, cause of loss, arrivals and any log.

        The seeds (ticks) give the seed of all noise at each tick: the same at all ticks for an ordinary flight, another
        from some tick on for a flight that branches off. `draw` gives the draws at the start. The function writes to
        `rows` (ticks, width). The default player is the one without a log.
        """
        given = drawn_values(self._wiring, self._scenario, self._room, draw)
        return rows[: (player or self._player).fly(seeds, rows, given) + 1]

    def _loss(self, rows: np.ndarray) -> Lost | None:
        last, cause = len(rows) - 1, int(rows[-1, TRACE_SIZE])
        return None if cause == NOT_LOST else Lost(last, last * self.h, CAUSES[cause])


def _among(parts: dict[str, np.ndarray]) -> AtStart:
    """Return a function that gives the draws at the start from the given numbers of each stream."""
    return lambda name, n: parts[name]
