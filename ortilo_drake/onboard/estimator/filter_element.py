"""The intermittent Kalman filter as an element of the loop."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.measurement import Layout, Measurement
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR
from ortilo_drake.onboard.estimator.belief import put_vehicle_part
from ortilo_drake.onboard.estimator.intermittent_filter import FilterModel, step_in_place

KNOWN = N_XBAR + N_XBAR * N_XBAR  # size of the belief of [x; i]


@register_jitable
def filter_step(
    n: Any,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    control: np.ndarray,
    reference: np.ndarray,
    opening: np.ndarray,
    belief: np.ndarray,
    rows: np.ndarray,
    S: np.ndarray,
    deviation: np.ndarray,
    model: FilterModel,
    layout: Layout,
) -> None:
    """Update the belief with the measurements of tick k and predict tick k + 1, see step_in_place."""
    put(control, deviation)
    deviation[0] -= n.hover_thrust
    open_belief(belief, opening)
    step_in_place(rows, S, belief, y, delta, V2, deviation, reference, model, layout)


@register_jitable
def open_belief(belief: np.ndarray, opening: np.ndarray) -> None:
    """Add the variances `opening` (n) to the diagonal of P."""
    size = opening.size
    for i in range(size):
        if opening[i] != 0.0:
            belief[size + (size + 1) * i] += opening[i]


def vehicle_belief_out(belief: np.ndarray, out: np.ndarray) -> None:
    """Output the belief of [x; i] (240) and the estimated disturbance force (3) [N], from a belief of [x; e; i]."""
    size = int(np.sqrt(belief.size + 0.25))  # the belief has n + n^2 numbers
    put_vehicle_part(out, belief, size)
    put(belief[N_X : N_X + 3], out, KNOWN)


def parts_out(belief: np.ndarray, out: np.ndarray) -> None:
    """Output the belief of [x; i] (240) unchanged, so that the box can name its parts."""
    put(belief[:KNOWN], out)


def extra_out(belief: np.ndarray, out: np.ndarray) -> None:
    """Output the extra states e and their standard deviations (2 e numbers), from a belief of [x; e; i]."""
    e = out.size // 2
    size = e + N_XBAR
    for i in range(e):
        out[i] = belief[N_X + i]
        out[e + i] = np.sqrt(belief[size + (size + 1) * (N_X + i)])


FILTER = Element("filter", step=filter_step, shows="belief")
VEHICLE_BELIEF = Element("vehicle_belief", out=vehicle_belief_out)
EXTRA = Element("extra_part", out=extra_out)
PARTS = Element("belief_parts", out=parts_out)


def work_of(n: int, p: int) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a step's work arrays, for n states (with the integral) and p measured values."""
    return {"rows": (max(n - N_I, p), n - N_I + 1), "S": (p, p), "deviation": (N_U,)}


def filter_box(model: FilterModel, measurement: Measurement, hover_thrust: float, belief_0: np.ndarray) -> Box:
    """Return the filter's box; it reads y, delta, V2, the control, the reference and the variances added to P.

    The box outputs the belief [xhat, P row by row] of all n states, at first belief_0 (n + n^2). `measurement` has rows
    over all states of the filter; hover_thrust is m g [N].
    """
    n, p = len(model.Phi) + N_I, measurement.sizes["y"]
    given = Values({"hover_thrust": hover_thrust}, {"belief": belief_0})
    box = Box("filter", FILTER, n + n * n, given, work_of(n, p))
    return box.with_groups(model=model, layout=measurement.layout)


def vehicle_belief_box(name: str) -> Box:
    """Return the box that takes the parts `belief` of [x; i] and `force` from a belief of [x; e; i]."""
    return Box(name, VEHICLE_BELIEF, KNOWN + 3, parts={"belief": (0, KNOWN), "force": (KNOWN, 3)})


def parts_box(name: str) -> Box:
    """Return the box that splits the belief of [x; i], the first 240 numbers read, in `estimate` and `covariance`."""
    return Box(name, PARTS, KNOWN, parts={"estimate": (0, N_XBAR), "covariance": (N_XBAR, N_XBAR * N_XBAR)})


def extra_box(name: str, n: int) -> Box:
    """Return the box that reads a belief of [x; e; i] (n states) and outputs e and its standard deviations."""
    return Box(name, EXTRA, 2 * (n - N_XBAR))
