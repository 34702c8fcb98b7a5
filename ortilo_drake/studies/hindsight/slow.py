"""The sensors' slow errors as variables of the graph: constants, random walks, Gauss-Markov processes."""

from collections.abc import Iterator
from itertools import count

import gtsam
import numpy as np

from ortilo_drake.studies.hindsight.factors import LEAST_SD


class Process:
    """A slow quantity: a variable at each time at which it is used, and factors between successive ones.

    Of a Gauss-Markov process of standard deviation sd and correlation time T, and of a random walk,

        e(t) = e(s) exp(-(t - s) / T) + w,  w ~ N(0, sd^2 (1 - exp(-2 (t - s) / T)))
        e(t) = e(s) + w,                    w ~ N(0, rate^2 (t - s))

    A constant is one variable for all times.

    Args:
        graph: gets the factors.
        values: get the variables, at 0.
        keys: gives keys that are not yet used, see numbered.
        sd: standard deviation at first (m).
        rate: of the random walk, after 1 s.
        time: correlation time T [s]; None for a random walk or a constant.
    """

    def __init__(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        keys: Iterator[int],
        sd: np.ndarray,
        rate: float = 0.0,
        time: float | None = None,
    ):
        self._graph, self._values, self._keys = graph, values, keys
        self._sd, self._rate, self._time = np.maximum(sd, LEAST_SD), rate, time
        self._last: tuple[int, float] | None = None

    def at(self, t: float) -> int:
        """Return the key of the variable at a time [s]; times do not fall."""
        m = len(self._sd)
        if self._last is None:
            key = self._add()
            noise = gtsam.noiseModel.Diagonal.Sigmas(self._sd)
            self._graph.add(gtsam.PriorFactorVector(key, np.zeros(m), noise))
            self._last = key, t
            return key
        last, s = self._last
        constant = self._time is None and self._rate == 0.0
        if constant or t <= s:
            return last
        keep = 1.0 if self._time is None else float(np.exp((s - t) / self._time))
        sd = np.full(m, self._rate * np.sqrt(t - s)) if self._time is None else self._sd * np.sqrt(1.0 - keep**2)
        key = self._add()
        noise = gtsam.noiseModel.Diagonal.Sigmas(np.maximum(sd, LEAST_SD))
        linear = gtsam.JacobianFactor(last, -keep * np.eye(m), key, np.eye(m), np.zeros(m), noise)
        about = gtsam.Values()
        about.insert(last, np.zeros(m))
        about.insert(key, np.zeros(m))
        self._graph.add(gtsam.LinearContainerFactor(linear, about))
        self._last = key, t
        return key

    def _add(self) -> int:
        key = next(self._keys)
        self._values.insert(key, np.zeros(len(self._sd)))
        return key


def numbered() -> Iterator[int]:
    """Return keys of the variables of Processes, each given once."""
    return (int(gtsam.symbol("e", i)) for i in count(1))
