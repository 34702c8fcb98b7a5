"""Ultra-wideband ranging to the room's anchors (paper, section III-A)."""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.placing import fill
from ortilo_drake.model.room import Room
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import uwb_size
from ortilo_drake.scenario import Uwb
from ortilo_drake.world.noise import normals, put_normals, stream_id


class Receiver(NamedTuple):
    """A receiver among n anchors."""

    anchors: np.ndarray
    """p_WA of each anchor [m] (n, 3)."""
    bias: np.ndarray
    """b_i, length added to the ranges to each anchor [m] (n)."""
    walls: np.ndarray
    """walls that act on a range (m, 7), see line_of_sight.py."""
    s_0: float
    """constant part of the white noise's sd [m]."""
    s_1: float
    """growth of this sd with the distance [1]."""
    per_wall: float
    """b, length that each wall adds [m]."""
    most_walls: float
    """greatest number of walls between."""
    max_distance: float
    """greatest distance [m]."""


def receiver_of(settings: Uwb, room: Room) -> Receiver:
    """Return the receiver in a room, without biases."""
    walls, anchors = settings.walls, room.anchor_positions
    per_wall = walls.per_wall if walls.kind == "bias" else 0.0
    most_walls = 0.0 if walls.kind == "block" else np.inf
    acting = room.wall_boxes if walls.kind in ("bias", "block") else np.empty((0, 7))
    return Receiver(anchors, np.zeros(len(anchors)), acting, *settings.sds, per_wall, most_walls, settings.max_distance)


@register_jitable
def put_uwb_message(message: np.ndarray, v: np.ndarray, x: np.ndarray, receiver: Receiver, time: float) -> None:
    """Write the uwb message (2 + 2 n): ranges d_i + b_i + b w_i + (s_0 + s_1 d_i) v_i, then their presence flags.

    d_i = |p_WB - p_WA_i|, w_i is the number of walls between, and v_i (n) are standard normal, drawn for absent ranges
    too. A range is present if d_i is within the greatest distance and w_i within the greatest number of walls; else it
    is 0. No range is below 0.

    `message` must hold zeros; the antenna is the origin of B in the state x (12). The time is t_k [s].
    """
    n = receiver.anchors.shape[0]
    message[0] = 1.0
    message[1] = time
    p_WB = x[:3]
    for i in range(n):
        a = receiver.anchors[i]
        d = np.sqrt((p_WB[0] - a[0]) ** 2 + (p_WB[1] - a[1]) ** 2 + (p_WB[2] - a[2]) ** 2)
        if d > receiver.max_distance:
            continue
        w = walls_crossed(values_of(p_WB), values_of(a), receiver.walls)
        if w > receiver.most_walls:
            continue
        r = d + receiver.bias[i] + receiver.per_wall * w + (receiver.s_0 + receiver.s_1 * d) * v[i]
        message[2 + i] = max(r, 0.0)
        message[2 + n + i] = 1.0


@cached_njit
def uwb_message(x: np.ndarray, receiver: Receiver, seed: int, stream: np.uint64, time: float, h: float) -> np.ndarray:
    """Return the uwb message (2 + 2 n) of put_uwb_message, with seed, stream and tick h [s] of the noise."""
    n = receiver.anchors.shape[0]
    message = np.zeros(2 + 2 * n, x.dtype)
    put_uwb_message(message, normals(seed, stream, tick_of(time, h), n), x, receiver, time)
    return message


def uwb_out(
    n: Any, k: int, seed: int, sent: np.ndarray, state: np.ndarray, receiver: Receiver, v: np.ndarray, out: np.ndarray
) -> None:
    """Output the uwb message of put_uwb_message in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] >= 0.0:
        put_normals(v, seed, n.stream, k)
        put_uwb_message(out, v, state, receiver, k * n.h)


def uwb_box(settings: Uwb, room: Room, h: float) -> Box:
    """Return the receiver: it reads `sent` (1), not negative where its message is sent, and the true state (12)."""
    count, given = len(room.anchors), Values({"stream": stream_id("uwb"), "h": h})
    box = Box("uwb", Element("uwb", out=uwb_out), uwb_size(count), given, {"v": (count,)})
    return box.with_groups(receiver=receiver_of(settings, room))
