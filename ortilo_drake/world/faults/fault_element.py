"""Faults of a sensor's messages and of ranges, as elements of the loop between the sensor and its link."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.geometry.line_of_sight import crosses_cylinder
from ortilo_drake.model.parts import Part, find_part
from ortilo_drake.model.placing import fill, put, sample_of
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD, STAMP
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.faults import Stuck
from ortilo_drake.scenario.own_parts import box_of
from ortilo_drake.world.faults.table import (
    ANCHOR_MOVED,
    ANCHORS_DYING,
    CAMERA_BLINDED,
    CLOCK_JUMP,
    EARLY,
    GYRO_BIAS,
    NLOS_STORM,
    OUTLIER_BURSTS,
    PEOPLE,
    YAW_JUMP,
    FaultTable,
    Numbered,
    cylinders_at,
    is_active,
    is_ahead,
    settings_of,
    table_of,
)
from ortilo_drake.world.noise import normals, uniforms


class Moment(NamedTuple):
    """The data that a fault may use beside the message."""

    x: np.ndarray
    """state as the sensor sees it (12)."""
    t: float
    """time [s]."""
    anchors: np.ndarray
    """p_WA, where the anchors truly stand (n, 3)."""
    seed: int
    """seed of all noise."""
    h: float
    """time from one message to the next [s]."""


@register_jitable
def distance_to(p: np.ndarray, q: np.ndarray) -> float:
    """Return the distance of two points (3) [m]."""
    return np.sqrt((p[0] - q[0]) ** 2 + (p[1] - q[1]) ** 2 + (p[2] - q[2]) ** 2)


@register_jitable
def behind_people(faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a mask (n) of the anchors that are behind the people of fault i."""
    people = cylinders_at(settings_of(faults, i), moment.t - faults.starts[i])
    hidden = np.zeros(moment.anchors.shape[0], dtype=np.bool_)
    for j in range(hidden.size):
        for person in people:
            if crosses_cylinder(moment.x[:3], moment.anchors[j], person):
                hidden[j] = True
    return hidden


@register_jitable
def longer(faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return the excess that fault i adds to each range (n) [m]."""
    kind, values, stream = faults.kinds[i], settings_of(faults, i), faults.streams[i]
    n, tick = moment.anchors.shape[0], tick_of(moment.t, moment.h)
    added = np.zeros(n)
    if kind == CLOCK_JUMP:
        added[:] = values[0]
    elif kind == ANCHOR_MOVED:
        j, p_WB = int(values[0]), moment.x[:3]
        there = moment.anchors[j]
        added[j] = distance_to(p_WB, there + values[1:4]) - distance_to(p_WB, there)
    elif kind == NLOS_STORM:
        u = uniforms(moment.seed, stream, tick, 2 * n)
        for j in range(n):
            if u[j] < values[0]:
                added[j] = -values[1] * np.log1p(-u[n + j])
    elif kind == PEOPLE and values[3] > 0.0:
        hidden, u = behind_people(faults, i, moment), uniforms(moment.seed, stream, tick, n)
        for j in range(n):
            if hidden[j]:
                added[j] = -values[3] * np.log1p(-u[j])
    elif kind == OUTLIER_BURSTS and (moment.t - faults.starts[i] + EARLY) % values[0] < values[1]:
        added[:] = values[2] * normals(moment.seed, stream, tick, n)
    return added


@register_jitable
def silent(faults: FaultTable, i: int, moment: Moment) -> np.ndarray:
    """Return a mask (n) of the anchors that fault i silences."""
    kind, values = faults.kinds[i], settings_of(faults, i)
    gone = np.zeros(moment.anchors.shape[0], dtype=np.bool_)
    if kind == ANCHORS_DYING:
        dead = int((moment.t - faults.starts[i] + EARLY) // values[0]) + 1
        for anchor in values[1 : 1 + dead]:
            gone[int(anchor)] = True
    elif kind == PEOPLE and values[3] == 0.0:
        return behind_people(faults, i, moment)
    return gone


@register_jitable
def put_range_fault(message: np.ndarray, faults: FaultTable, i: int, moment: Moment) -> None:
    """Change a uwb message by fault i; a missing range stays missing, and no range falls below 0."""
    n, gone, added = moment.anchors.shape[0], silent(faults, i, moment), longer(faults, i, moment)
    for j in range(n):
        there = message[PAYLOAD + n + j] > 0.0 and not gone[j]
        message[PAYLOAD + j] = max(message[PAYLOAD + j] + added[j], 0.0) if there else 0.0
        if gone[j]:
            message[PAYLOAD + n + j] = 0.0


_YAW, _RATES = PAYLOAD + 2, PAYLOAD + 3  # in an imu message


@cached_njit
def put_fault(message: np.ndarray, faults: FaultTable, i: int, moment: Moment) -> None:
    """Change a sensor's message by fault i, which may be of any kind but `stuck`."""
    if message[ARRIVED] == 0.0 or not is_active(faults, i, moment.t):
        return
    kind, values = faults.kinds[i], settings_of(faults, i)
    if kind == YAW_JUMP:
        message[_YAW] += values[0]
    elif kind == GYRO_BIAS:
        message[_RATES : _RATES + 3] += values
    elif kind == CAMERA_BLINDED:
        message[PAYLOAD:] = 0.0
        message[PAYLOAD::DETECTION_SIZE] = -1.0
    else:
        put_range_fault(message, faults, i, moment)


def fault_out(
    n: Any, seed: int, message: np.ndarray, state: np.ndarray, anchors: np.ndarray, faults: FaultTable, out: np.ndarray
) -> None:
    """Output a message under a fault (put_fault), applied to each of its samples."""
    put(message, out)
    for i in range(n.samples):
        sample = sample_of(out, i, n.samples)
        put_fault(sample, faults, 0, Moment(state, sample[STAMP], anchors, seed, n.h))


def stuck_out(
    n: Any, message: np.ndarray, held: np.ndarray, holds: np.ndarray, faults: FaultTable, out: np.ndarray
) -> None:
    """Output the message of a sensor that may be stuck; while it is, each sample has the payload held since before."""
    put(message, out)
    put(held, holds)
    for i in range(n.samples):
        sample = sample_of(out, i, n.samples)
        if sample[ARRIVED] != 0.0:
            if is_active(faults, 0, sample[STAMP]):
                put(holds, sample, PAYLOAD)
            else:
                put(sample[PAYLOAD:], holds)


def stuck_step(n: Any, message: np.ndarray, held: np.ndarray, faults: FaultTable) -> None:
    """Hold the last payload that arrived while the sensor was not stuck."""
    for i in range(n.samples):
        sample = sample_of(message, i, n.samples)
        if sample[ARRIVED] != 0.0 and not is_active(faults, 0, sample[STAMP]):
            put(sample[PAYLOAD:], held)


def lasts_out(message: np.ndarray, changed: np.ndarray, faults: FaultTable, out: np.ndarray) -> None:
    """Output a message, changed by a registered fault while the fault lasts."""
    lasts = is_active(faults, 0, message[STAMP])
    put(changed if message[ARRIVED] != 0.0 and lasts else message, out)


def asked_out(n: Any, k: int, delay: np.ndarray, faults: FaultTable, out: np.ndarray) -> None:
    """Output a number (1) that is not negative in a tick in which a sensor must measure.

    It must measure where its message is sent, and in every tick before it is stuck, to have a message to repeat.
    """
    fill(out, delay[0])
    for i in range(faults.kinds.size):
        if is_ahead(faults, i, (k - n.before) * n.h):
            out[0] = max(out[0], 0.0)


FAULT = Element("fault", out=fault_out, allocates=True)
STUCK = Element("stuck", out=stuck_out, step=stuck_step, allocates=True)
LASTS = Element("lasts", out=lasts_out)
ASKED = Element("asked", out=asked_out)


def fault_boxes(
    sensor: str, message: Box, faults: list[Numbered], anchors: np.ndarray, samples: int, h: float
) -> list[Box]:
    """Return the boxes of a sensor's faults, the last of which outputs the messages; they read the state that it sees.

    `message` is the box that outputs the messages, of `samples` samples, h [s] apart. The faults are the sensor's, in
    the scenario's order. anchors (n, 3) holds p_WA of each anchor, unless a seed draws them. InputError if a registered
    fault does not fit.
    """
    boxes: list[Box] = []
    for its in faults:
        given, table = Values({"samples": samples}), table_of([its])
        name, reads = f"{sensor}_fault_{its.i}", {"message": message.name}
        if isinstance(its.fault, Stuck):
            size = message.size if samples == 1 else (message.size - PAYLOAD) // samples
            held = np.zeros(size - PAYLOAD)
            given = given.updated(Values(start={"held": held}))
            message = Box(name, STUCK, message.size, given, {"holds": held.shape}, reads).with_groups(faults=table)
        elif (own := find_part("fault", its.fault.kind)) is not None:
            changed = own_fault_box(own, its, message, samples, h)
            boxes.append(replace(changed, name=f"{name}_own"))
            reads |= {"changed": f"{name}_own"}
            message = Box(name, LASTS, message.size, reads=reads).with_groups(faults=table)
        else:
            given = given.updated(Values({"h": h}, tables={"anchors": anchors}))
            message = Box(name, FAULT, message.size, given, reads=reads).with_groups(faults=table)
        boxes.append(message)
    return boxes


def own_fault_box(part: Part, its: Numbered, message: Box, samples: int, h: float) -> Box:
    """Return the box by which a registered fault changes a message; arguments and errors as in fault_boxes."""
    where = f"faults.{its.i}: {part.kind}"
    if samples > 1:
        raise InputError(f"{where}: {message.name}: sends {samples} samples in a tick, must send one for such a fault")
    box: Box = box_of(part, where, its.fault, message.size, h)
    if box.size != message.size:
        raise InputError(f"{where}: says {box.size} numbers, must be {message.size}, the message's")
    for port in box.element.inputs:
        if port not in ("message", "state"):
            raise InputError(f"{where}: reads {port!r}, must be one of message, state")
    return box.with_inputs(message=message.name)


def asked_box(sensor: str, faults: list[Numbered], samples: int, h: float) -> Box | None:
    """Return the box that tells a sensor with `stuck` faults when to measure (asked_out); None without such a fault.

    It reads the delay of the sensor's link. Samples inside the tick before are held too, so a sensor with several
    samples per message measures for one tick longer.
    """
    stuck = [its for its in faults if isinstance(its.fault, Stuck)]
    if not stuck:
        return None
    given, reads = Values({"before": int(samples > 1), "h": h}), {"delay": f"{sensor}_link"}
    return Box(f"{sensor}_asked", ASKED, 1, given, reads=reads).with_groups(faults=table_of(stuck))
