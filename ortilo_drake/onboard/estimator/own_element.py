"""An estimator of one's own by its compiled share (model/parts.py, CompiledEstimator), as an element of the loop.

It is one of the vehicle's twelve states; the integral of the position error, which is known, is added.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Given
from ortilo_drake.loop.shares import Fields, fields_of, function_of
from ortilo_drake.model.parts import CompiledEstimator
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import N_I, N_X, N_XBAR


def saying(known: Callable[..., np.ndarray]) -> Callable[..., None]:
    """Return a function that says what a share knows."""

    @register_jitable
    def say(numbers: Any, state: np.ndarray, i: np.ndarray, out: np.ndarray) -> None:
        """Say the belief of [x; i] (240) that was predicted for this tick."""
        said = known(numbers, state)
        fill(out, 0.0)
        put(said[:N_X], out)
        put(i, out, N_X)
        for row in range(N_X):
            put(said[N_X * (row + 1) : N_X * (row + 2)], out, N_XBAR * (row + 1))

    return say


def taking(step: Callable[..., np.ndarray]) -> Callable[..., None]:
    """Return a function that goes on as a share does."""

    @register_jitable
    def take(
        numbers: Any,
        state: np.ndarray,
        i: np.ndarray,
        uwb: np.ndarray,
        camera: np.ndarray,
        imu: np.ndarray,
        control: np.ndarray,
        reference: np.ndarray,
        out: np.ndarray,
    ) -> None:
        """Go on to the next tick: i_{k+1} = i_k + r_k - p_hat_k."""
        for axis in range(N_I):
            i[axis] += reference[axis] - out[axis]
        # Copies: a user's function may change what it is given.
        messages = uwb.copy(), camera.copy(), imu.copy()
        put(step(numbers, state.copy(), messages[0], messages[1], messages[2], control.copy(), reference.copy()), state)

    return take


@lru_cache(maxsize=64)
def element_of(share: CompiledEstimator, fields: Fields) -> Element:
    """Return the element of a share, whose numbers have these fields."""
    messages = "uwb", "camera", "imu"
    return Element(
        "own_estimator",
        out=function_of(fields, saying(share.known), "state", "i", "out"),
        step=function_of(fields, taking(share.step), "state", "i", *messages, "control", "reference", "out"),
        numbers=fields.numbers,
        tables=fields.tables,
        state=(Array("state"), Array("i")),
        allocates=True,
    )


def own_estimator_box(name: str, share: CompiledEstimator, belief: Any, xbar_0: np.ndarray) -> Box:
    """Return an estimator by its share: it reads the messages of uwb, camera and imu, control and reference.

    It says the belief of [x; i] (240) that was predicted for this tick.
    """
    numbers = share.numbers(belief, xbar_0)
    fields = fields_of(numbers)
    start = {"state": share.first(numbers), "i": np.zeros(N_I)}
    given = fields.given(numbers).with_(Given(start=start))
    return Box(name, element_of(share, fields), N_XBAR + N_XBAR * N_XBAR, given)
