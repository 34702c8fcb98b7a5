"""The engine: a scenario's flights, compiled, any number of them on any number of threads."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property, partial

import numpy as np
import xarray as xr

from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.figures import FIGURES, REFERENCE, TRACE_SIZE, TRUE, figures_of
from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.lost import CAUSES, NOT_LOST, Lost
from ortilo_drake.flight.played import Played
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, with_seed
from ortilo_drake.world.drawn_truth import AtStart, of_seed
from ortilo_drake.world.given_noise import GivenNoise

NO_LOG = np.zeros((0, 0))
_LEARNED_BY = 4  # flights by which it is learned what noise a flight draws


class Engine:
    """A scenario's flights, played from its wiring by compiled code.

    A flight is that of flight.flight.FlightSimulator: the same functions on the same noise, in the same order. It
    depends on its scenario and seed alone, not on what flies beside it or on which thread.

    Args:
        scenario: the scenario; its own seed is not used.

    Attributes:
        columns: names of the figures of a flight, those of figures.py and, for each sensor that flies, how many of its
            values reached the filter and how many were due.

    Raises:
        InputError: if a part of the scenario is no element, see why_not, or if it cannot be flown.
    """

    def __init__(self, scenario: Scenario):
        reason = why_not(scenario)
        if reason is not None:
            raise InputError(f"{scenario.name}: {reason}: Drake flies it")
        self._scenario = scenario
        self._flights = Played(scenario)
        self._ticks = self._flights.ticks
        self._sensors = scenario.measurement.sensors
        counted = [f"{what}_{sensor}" for sensor in self._flying for what in ("arrived", "due")]
        self.columns = (*FIGURES, *counted)

    @property
    def _flying(self) -> list[str]:
        return [sensor for sensor in self._sensors if sensor in self._scenario.sensors]

    def fly(self, seed: int, progress: Callable[[int], None] | None = None) -> xr.Dataset:
        """Fly one seed; return its Dataset over ticks, see flight.flight.FlightSimulator.fly.

        Args:
            seed: of all noise.
            progress: called with the number of ticks flown, once it is flown.

        Raises:
            InputError: if a scenario allows no such seed.
        """
        scenario = with_seed(self._scenario, seed)
        log = np.zeros((self._ticks + 1, sum(scenario.measurement.logged_sizes().values())))
        trace, arrived = np.zeros((self._ticks + 1, TRACE_SIZE)), np.zeros(len(self._sensors))
        seeds = np.full(self._ticks + 1, seed, dtype=np.int64)
        self._flights.compile_logged()
        started = time.perf_counter()
        last, cause = self._flights.fly(seeds, of_seed(seed), trace, arrived, log)
        wall = time.perf_counter() - started
        if progress:
            progress(last)
        lost = None if cause == NOT_LOST else Lost(last, last * scenario.h, CAUSES[cause])
        flight = flight_dataset(scenario, np.arange(last + 1) * scenario.h, log[: last + 1], lost)
        flight.attrs |= {"player": "engine", "real_time_factor": last * scenario.h / wall}
        return flight

    def trace(self, seed: int) -> tuple[np.ndarray, Lost | None]:
        """Fly one seed; return its figures, a row of figures.py for each tick flown, and its loss.

        Raises:
            InputError: if a scenario allows no such seed.
        """
        scenario = with_seed(self._scenario, seed)
        trace, arrived = np.zeros((self.ticks, TRACE_SIZE)), np.zeros(len(self._sensors))
        seeds = np.full(self.ticks, seed, dtype=np.int64)
        last, cause = self._flights.fly(seeds, of_seed(seed), trace, arrived, NO_LOG)
        lost = None if cause == NOT_LOST else Lost(last, last * scenario.h, CAUSES[cause])
        return trace[: last + 1], lost

    def figures(self, seeds: Sequence[int], threads: int = 1) -> np.ndarray:
        """Fly seeds and return the figures of each (n, columns).

        Args:
            seeds: of all noise.
            threads: that fly.
        """
        all_seeds = np.asarray(seeds, dtype=np.int64)
        found, arrived = np.empty((all_seeds.size, len(FIGURES))), np.empty((all_seeds.size, len(self._sensors)))
        to_fly = iter(range(all_seeds.size))

        def work() -> None:
            trace = np.zeros((self.ticks, TRACE_SIZE))
            for i in to_fly:
                seeds_of_ticks = np.full(self.ticks, all_seeds[i])
                draw = of_seed(int(all_seeds[i]))
                last, cause = self._flights.fly(seeds_of_ticks, draw, trace, arrived[i], NO_LOG)
                found[i, 0], found[i, 1] = last, cause
                flown = trace[: last + 1]
                figures_of(flown, np.ascontiguousarray(flown[:, REFERENCE]), found[i])

        if threads == 1:
            work()
        else:
            with ThreadPoolExecutor(threads) as pool:
                for done in [pool.submit(work) for _ in range(threads)]:
                    done.result()
        return np.column_stack((found, *self._counts(found[:, 0], arrived)))

    @property
    def ticks(self) -> int:
        """The number of ticks of a flight that is not lost, the first and the last included."""
        return self._ticks + 1

    @property
    def h(self) -> float:
        """The tick [s]."""
        return self._scenario.h

    @cached_property
    def drawn(self) -> dict[str, int]:
        """The number of standard normals that each stream gives to the draws at the start, by its name."""
        return self._flights.normals_at_start()

    @cached_property
    def noise(self) -> GivenNoise:
        """The place of each stream's numbers in the noise that a flight is given."""
        return GivenNoise(self.ticks, partial(self._fly_away, draw=of_seed(0)), _LEARNED_BY)

    @property
    def numbers(self) -> int:
        """The number of standard normals that decide a flight."""
        return self.ticks * self.noise.width + sum(self.drawn.values())

    def distances(self, seeds: np.ndarray) -> np.ndarray:
        """Fly, and return how far each flight is from its reference at each tick [m] (n, ticks); infinity once lost.

        What is drawn at the start is of each flight's first seed.

        Args:
            seeds: of all noise, of each flight at each tick (n, ticks).
        """
        return np.array([self._fly_away(its, of_seed(int(its[0]))) for its in seeds.astype(np.int64)])

    def distances_given(self, numbers: np.ndarray) -> np.ndarray:
        """Fly, and return the same of the numbers that decide each flight.

        Args:
            numbers: standard normal (n, numbers): the rows of `noise` for one tick after the other, then what is drawn
                at the start, stream after stream as `drawn` has them.
        """
        names, ends = list(self.drawn), np.cumsum(list(self.drawn.values()))
        found, at = np.empty((len(numbers), self.ticks)), self.ticks * self.noise.width
        for i, its in enumerate(numbers.astype(np.float32, copy=False)):
            parts = dict(zip(names, np.split(its[at:].astype(float), ends[:-1]), strict=True)) if names else {}
            found[i] = self._fly_away(self.noise.seeds(its[:at].reshape(self.ticks, -1)), _among(parts))
        return found

    def _fly_away(self, seeds: np.ndarray, draw: AtStart) -> np.ndarray:
        """Return the distance of one flight to its reference at each tick [m], infinity once lost."""
        found = np.full(self.ticks, np.inf)
        trace, arrived = np.zeros((self.ticks, TRACE_SIZE)), np.zeros(len(self._sensors))
        last, cause = self._flights.fly(seeds, draw, trace, arrived, NO_LOG)
        flown = slice(0, last + 1 if cause == NOT_LOST else last)
        away = trace[flown, TRUE] - trace[flown, REFERENCE]
        found[flown] = np.sqrt(np.sum(away**2, axis=1))
        return found

    def simulated_time(self, figures: np.ndarray) -> float:
        """Return the total time of flights of these figures [s]."""
        return float(np.sum(figures[:, FIGURES.index("ticks")])) * self._scenario.h

    def _counts(self, last: np.ndarray, arrived: np.ndarray) -> list[np.ndarray]:
        """Return the columns of arrivals, after the figures."""
        columns = []
        for sensor in self._flying:
            columns += [arrived[:, self._sensors.index(sensor)], last // self._scenario.every(sensor) + 1]
        return columns


def _among(parts: dict[str, np.ndarray]) -> AtStart:
    """Return the draws at the start, from given numbers where there are some."""
    return lambda name, n: parts[name]
