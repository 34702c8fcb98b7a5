"""Errors that last: constants, and noise that changes slowly, sampled exactly at the ticks.

    e_k = b + x_k,   x_{k+1} = a x_k + q w_k,   w standard normal.

First-order Gauss-Markov noise of standard deviation s and correlation time T has a = exp(-h / T), q = s sqrt(1 - a^2)
and x_0 = s w: stationary with E[x_j x_k] = s^2 a^|j - k|. A random walk that comes to the standard deviation r in 1 s
has a = 1, q = r sqrt(h) and x_0 = 0. (A. Gelb, ed., "Applied Optimal Estimation", 1974, section 3.8.)
"""

import sys
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import BasicVector_, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.scalars import time_in
from ortilo_drake.world.noise import normals, stream_id
from ortilo_drake.world.seeded_system import Seeded


class SlowNoise(NamedTuple):
    """What x_k is, for each of its n components.

    Attributes:
        a: decay over a tick (n).
        q: standard deviation of what is new in a tick (n).
        start: standard deviation of x_0 (n).
    """

    a: np.ndarray
    q: np.ndarray
    start: np.ndarray


def gauss_markov(sd: np.ndarray, time: float, h: float) -> SlowNoise:
    """Return first-order Gauss-Markov noise of standard deviations (n), correlation time and tick [s]."""
    a = np.exp(-h / time)
    return SlowNoise(np.full(len(sd), a), sd * np.sqrt(1.0 - a * a), sd)


def random_walk(after_1_s: np.ndarray, h: float) -> SlowNoise:
    """Return a random walk of standard deviations after 1 s (n), and tick [s]."""
    return SlowNoise(np.ones(len(after_1_s)), after_1_s * np.sqrt(h), np.zeros(len(after_1_s)))


@njit(cache=True)
def slow_noise_after(
    x: np.ndarray, a: np.ndarray, q: np.ndarray, seed: int, stream: np.uint64, time: float, h: float
) -> np.ndarray:
    """Return x_{k+1} from x_k (n) at t_k [s]."""
    return a * x + q * normals(seed, stream, tick_of(time, h) + 1, len(a))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("SlowError_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def SlowError_(T: type) -> type:
    """Return the source for a scalar type: float or AutoDiffXd, for which it is a constant."""

    class Impl(LeafSystem_[T], Seeded):
        """A source of errors that last.

        Ports:
            error (n, output): e_k.

        State (discrete, updated each tick): x (n), 0 in a default Context.

        Parameters of the Context, beside the seed:
            bias (n): b, 0 by default.

        Args:
            name: of the system; its noise stream is 'slow error/<name>'.
            noise: of n components.
            seed: seed of all noise.
            h: tick [s].
        """

        def _construct(self, name: str, noise: SlowNoise, seed: int, h: float, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name(name)
            self.declare_seed(seed)
            self._arguments = {"name": name, "noise": noise, "seed": seed, "h": h}
            self._after = slow_noise_after if T is float else slow_noise_after.py_func
            self._noise, self._stream, self._h = noise, stream_id(f"slow error/{name}"), h
            n = len(noise.a)
            self._bias = self.DeclareNumericParameter(BasicVector_[T](np.zeros(n)))
            self._x = self.DeclareDiscreteState(BasicVector_[T](np.zeros(n)))
            self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
            needs = {self.xd_ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("error", n, self._calc_error, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def start_in(self, context: Any, bias: np.ndarray) -> None:
            """Set b (n), and x to the seed's x_0, in a context of this system."""
            first = normals(self.seed_in(context), self._stream, 0, len(bias))
            self.set_bias_in(context, bias)
            context.get_mutable_discrete_state(self._x).SetFromVector(self._noise.start * first)

        def set_bias_in(self, context: Any, bias: np.ndarray) -> None:
            """Set b (n) alone in a context of this system."""
            context.get_mutable_numeric_parameter(self._bias).SetFromVector(bias)

        def _calc_error(self, context: Any, output: Any) -> None:
            bias = context.get_numeric_parameter(self._bias).CopyToVector()
            output.set_value(bias + context.get_discrete_state(self._x).CopyToVector())

        def _update(self, context: Any, discrete_state: Any) -> None:
            x = context.get_discrete_state(self._x).CopyToVector()
            a, q, _ = self._noise
            after = self._after(x, a, q, self.seed_in(context), self._stream, time_in(context), self._h)
            discrete_state.set_value(self._x, after)

    return Impl
