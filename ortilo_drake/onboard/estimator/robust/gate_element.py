"""The gate between handler and filter, as an element of the loop: it refuses and weighs values, and opens P."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values, parts_of
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_I
from ortilo_drake.onboard.estimator.extra_states import C as GYROSCOPE
from ortilo_drake.onboard.estimator.robust.weights import Weighing, initial_gate_state, judge_sensors, weighed
from ortilo_drake.scenario.robust import Opening


def opening_variances(opening: Opening, extra: tuple[str, ...]) -> np.ndarray:
    """Return the variances added to P's diagonal of [x; e; i] when each part is opened (3, n); e has those names."""
    none = np.zeros(3)
    angle, gyroscope = np.full(3, opening.angle), [opening.gyroscope if name in GYROSCOPE else 0.0 for name in extra]
    others = np.repeat([opening.velocity, opening.rate], 3)
    rates = np.concatenate((none, angle, none, none, gyroscope, np.zeros(N_I)))
    whole = np.concatenate((np.full(3, opening.position), angle, others, gyroscope, np.zeros(N_I)))
    return np.square(np.array([np.zeros(whole.size), rates, whole]))


def gate_out(
    n: Any,
    k: int,
    y: np.ndarray,
    delta: np.ndarray,
    V2: np.ndarray,
    belief: np.ndarray,
    past: np.ndarray,
    late: np.ndarray,
    weighing: Weighing,
    opening: np.ndarray,
    refusals: np.ndarray,
    seen: np.ndarray,
    mean: np.ndarray,
    beliefs: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [y, delta, V2] as used, the addition to the diagonal of P, and the three states of the next tick."""
    for j in range(delta.size):
        if delta[j] != 0.0:
            put(belief if late[j] < 0 else past[late[j] * belief.size :][: belief.size], beliefs[j])
    factors, next_refusals, next_seen, next_mean, opens = judge_sensors(
        y, delta, V2, beliefs, refusals, seen, mean, k * n.h, weighing
    )
    used = weighed(y, delta, V2, factors, weighing.first, weighing.block)
    put(used, out)
    at = used.size
    for said in (opening[opens], next_refusals.reshape(next_refusals.size), next_seen, next_mean):
        put(said, out, at)
        at += said.size


def gate_step(refusals: np.ndarray, seen: np.ndarray, mean: np.ndarray, out: np.ndarray) -> None:
    """Keep the states that were said."""
    at = out.size - mean.size - seen.size - refusals.size
    for kept in (refusals.reshape(refusals.size), seen, mean):
        put(out[at : at + kept.size], kept)
        at += kept.size


GATE = Element("robust_gate", out=gate_out, step=gate_step, allocates=True)


def gate_box(weighing: Weighing, opening: np.ndarray, late: list[int], h: float) -> Box:
    """Return the gate: it reads y, delta, V2, the filter's whole `belief` and those of `past` ticks, one after another.

    The opening is what is added to the variances by what is opened of P (3, n); `late` has the number of the past
    belief by which each sensor is judged, -1 for the present one.
    """
    n, s, p, q = opening.shape[1], len(late), int(weighing.first[-1]), int(weighing.block[-1])
    refusals, seen, mean = initial_gate_state(s)
    parts = parts_of({"y": p, "delta": s, "V2": q, "opening": n})
    given = Values({"h": h}, {"refusals": refusals, "seen": seen, "mean": mean}, {"opening": opening, "late": late})
    size = p + s + q + n + refusals.size + seen.size + mean.size
    box = Box("robust_gate", GATE, size, given, {"beliefs": (s, n + n * n)}, parts=parts)
    return box.with_groups(weighing=weighing)
