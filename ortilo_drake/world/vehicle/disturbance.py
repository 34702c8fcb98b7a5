"""The disturbance: a random force and torque, drawn anew every tick."""

import sys
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.autodiffutils import AutoDiffXd
from pydrake.systems.framework import LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.placing import put
from ortilo_drake.model.scalars import time_in
from ortilo_drake.scenario import Disturbance
from ortilo_drake.world.noise import put_normals, stream_id
from ortilo_drake.world.seeded_system import Seeded
from ortilo_drake.world.slow_error import SlowNoise, slow_noise_after


@register_jitable
def put_disturbance(
    d: np.ndarray, force_sd: float, torque_sd: float, seed: int, stream: np.uint64, time: float, h: float
) -> None:
    """Write d = [force in W [N], torque in B [N m]] (6), Gaussian with these sd per axis, of one tick."""
    put_normals(d, seed, stream, tick_of(time, h))
    for i in range(3):
        d[i] *= force_sd
        d[3 + i] *= torque_sd


@njit(cache=True)
def disturbance_at(
    force_sd: float, torque_sd: float, seed: int, stream: np.uint64, time: float, h: float
) -> np.ndarray:
    """Return d of put_disturbance (6)."""
    d = np.empty(6)
    put_disturbance(d, force_sd, torque_sd, seed, stream, time, h)
    return d


def disturbance_out(n: Any, k: int, seed: int, out: np.ndarray) -> None:
    """Say d of put_disturbance (6)."""
    put_disturbance(out, n.force_sd, n.torque_sd, seed, n.stream, k * n.h, n.h)


WHITE = Element(
    "disturbance",
    out=disturbance_out,
    numbers=(Number("force_sd"), Number("torque_sd"), Number("stream", kind="u8"), Number("h")),
)


def disturbance_box(settings: Disturbance, h: float) -> Box:
    """Return the source of white disturbance: force in W [N], torque in B [N m] (6)."""
    numbers = {
        "force_sd": settings.force_sd,
        "torque_sd": settings.torque_sd,
        "stream": stream_id("disturbance"),
        "h": h,
    }
    return Box("disturbance", WHITE, 6, Given(numbers))


def lasting_out(disturbance: np.ndarray, bias: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Say the disturbance with what lasts of it (6), see world/slow_error.py."""
    for i in range(out.size):
        out[i] = disturbance[i] + (bias[i] + x[i])


def lasting_step(n: Any, k: int, seed: int, x: np.ndarray, a: np.ndarray, q: np.ndarray) -> None:
    """Go on to the gust of the next tick."""
    put(slow_noise_after(x, a, q, seed, n.stream, k * n.h, n.h), x)


LASTING = Element(
    "lasting_force",
    out=lasting_out,
    step=lasting_step,
    numbers=(Number("stream", kind="u8"), Number("h")),
    tables=(Array("bias"), Array("a"), Array("q")),
    state=(Array("x"),),
    allocates=True,
)


def lasting_force_box(noise: SlowNoise, h: float) -> Box:
    """Return what adds a force that lasts to the disturbance: none, unless it is drawn."""
    numbers = {"stream": stream_id("slow error/lasting_force"), "h": h}
    tables = {"bias": np.zeros(6), "a": noise.a, "q": noise.q}
    return Box("lasting_force", LASTING, 6, Given(numbers, start={"x": np.zeros(6)}, tables=tables))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("DisturbanceSource_", T_list=[float, AutoDiffXd], scope=sys.modules[__name__])
def DisturbanceSource_(T: type) -> type:
    """Return the source for a scalar type: float or AutoDiffXd, for which it is a constant."""

    class Impl(LeafSystem_[T], Seeded):
        """A source of white disturbance; a ZeroOrderHold of period h after it holds each draw over its tick.

        Read between ticks it gives the nearest tick's draw, so a continuous plant must not take it directly.

        Ports:
            disturbance (6, output): force in W [N], torque in B [N m].

        Args:
            settings: standard deviations per axis.
            seed: seed of all noise.
            h: tick [s].
        """

        def _construct(self, settings: Disturbance, seed: int, h: float, converter: Any = None) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("disturbance")
            self.declare_seed(seed)
            self._arguments = {"settings": settings, "seed": seed, "h": h}
            self._force_sd, self._torque_sd = settings.force_sd, settings.torque_sd
            self._stream, self._h = stream_id("disturbance"), h
            needs = {self.time_ticket(), self.all_parameters_ticket()}
            self.DeclareVectorOutputPort("disturbance", 6, self._calc_disturbance, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, **other._arguments, converter=converter)

        def _calc_disturbance(self, context: Any, output: Any) -> None:
            seed, time = self.seed_in(context), time_in(context)
            output.set_value(disturbance_at(self._force_sd, self._torque_sd, seed, self._stream, time, self._h))

    return Impl
