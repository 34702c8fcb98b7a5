"""The servo that accounts for late commands, at hover: its gains on the loop's state and its own commands.

It is u_k = -L z_k - sum_j L_j u_{k-j}. The gains are those of the functions that fly: timeline, prediction and servo of
onboard/ are affine in estimate, force and commands, and are evaluated on unit vectors.
"""

from collections.abc import Callable

import numpy as np

from ortilo_drake.model.hover import hover_A, hover_B, hover_B_d
from ortilo_drake.model.signals import ACT_SIZE, N_I, N_U, N_XBAR, REFERENCE_SIZE
from ortilo_drake.onboard.commands.timeline import (
    NONE,
    SLACK,
    expected_delay,
    first_acts,
    mean_control,
    none_sent,
    state_ahead,
    timeline_of,
    with_command,
)
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, gain_of
from ortilo_drake.onboard.servo.lq_servo import delayed_gain, servo_control, split_delay
from ortilo_drake.scenario import LqServo, Scenario

Law = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]  # xbar (15), force (3), u_{k-1} ... (D, 4) -> u_k (4)
EARLY = 10  # tick at which the oldest command is sent


def known_timeline(us: np.ndarray, now: int, scenario: Scenario, delay: float) -> tuple[np.ndarray, float]:
    """Return the timeline at tick `now`, and tau [s], for commands us (D, 4), newest first, `delay` ticks late."""
    h, commands = scenario.h, scenario.commands
    given = NONE if commands.delay is None else commands.delay
    sent, acts = none_sent(len(us)), first_acts(len(us) + 1, scenario.vehicle.hover_thrust)
    for j, u in enumerate(us):  # the newest last
        sent[-1 - j] = [(now - 1 - j) * h, *u]
    if not commands.are_reported:
        tau = expected_delay(acts, given)
        return timeline_of(acts, NONE, sent, tau, SLACK * h), tau
    acted = _acts(sent, scenario, delay, before=now * h)
    acts[len(acts) - len(acted) :] = acted
    tau = given if given >= 0.0 else delay * h
    return timeline_of(acts, now * h, sent, tau, SLACK * h), tau


def _acts(sent: np.ndarray, scenario: Scenario, delay: float, before: float) -> np.ndarray:
    """Return the acts, before a time [s], of commands that were sent (n, 6)."""
    late = delay * scenario.h
    rows = [[row[0] + late, *row] for row in sent if row[0] + late < before - 1e-9 * scenario.h]
    return np.array(rows).reshape(-1, ACT_SIZE)


def control_misprediction(us: np.ndarray, scenario: Scenario, delay: float) -> np.ndarray:
    """Return the control that the last tick's prediction assumed, less the one that acted (4); us (D, 4), newest first.

    The filter knows what acted in earlier ticks. It learns of the last one in this tick and corrects the next estimate.
    """
    h, last = scenario.h, EARLY + len(us) - 1
    rows, tau = known_timeline(us[1:], last, scenario, delay)
    assumed = mean_control(with_command(rows, last * h + tau, us[0]), last * h, (last + 1) * h)
    sent = np.column_stack([(last - np.arange(len(us))) * h, us])[::-1]
    truth = _acts(sent, scenario, delay, before=(last + 1) * h)
    hovering = first_acts(1, scenario.vehicle.hover_thrust)
    acted = np.delete(np.vstack([hovering, truth]), 1, axis=1)
    return np.asarray(assumed - mean_control(acted, last * h, (last + 1) * h))


def flown_law(scenario: Scenario, delay: float) -> Law:
    """Return the scenario's servo as a function that gives u_k, if every command acts `delay` ticks late."""
    vehicle, h, kind = scenario.vehicle, scenario.h, scenario.commands.servo
    nothing, tail = np.zeros(REFERENCE_SIZE), (vehicle.mass, 0.0, True)
    A, B, B_d = hover_A(scenario.yaw), hover_B(vehicle), hover_B_d(vehicle)
    Gammabar = augmented_pair(vehicle, h, scenario.yaw)[1]
    if kind == "augmented":
        L = delayed_gain(vehicle, scenario.servo.weights, h, scenario.commands.delay or 0.0, scenario.yaw)
    else:
        L = gain_of(scenario)
    L_x, L_u = np.ascontiguousarray(L[:, :N_XBAR]), L[:, N_XBAR:]

    counters = isinstance(scenario.servo, LqServo)

    def law(xbar: np.ndarray, force: np.ndarray, us: np.ndarray) -> np.ndarray:
        if scenario.commands.filter == "acted":
            xbar = xbar + Gammabar @ control_misprediction(us, scenario, delay)
        if kind == "predicted":
            rows, tau = known_timeline(us, EARLY + len(us), scenario, delay)
            b = B_d[:, :3] @ force - B[:, 0] * vehicle.hover_thrust
            xbar = state_ahead(xbar, nothing, rows, (EARLY + len(us)) * h, tau, h, A, B, b)
        against = force if counters else np.zeros(3)
        resting = servo_control(np.zeros(N_XBAR), nothing, np.zeros_like(L_x), *tail, against)
        on_the_way = us[: L_u.shape[1] // N_U] - resting
        return np.asarray(servo_control(xbar, nothing, L_x, *tail, against) - L_u @ on_the_way.ravel())

    return law


def late_gains(scenario: Scenario, delay: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the servo's gains on [x; i] (4 x 15), on the force (4 x 3) and on its commands (D, 4, 4), at yaw 0.

    `delay` is the true one [ticks]; it matters where the onboard half is told which commands acted.
    """
    believed = delay if scenario.commands.delay is None else scenario.commands.delay / scenario.h
    D = max(split_delay(believed, 1.0)[0], split_delay(delay, 1.0)[0]) + 2
    law = flown_law(scenario, delay)
    hover = np.tile([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0], (D, 1))
    none, calm = np.zeros(N_XBAR), np.zeros(N_I)
    rest = law(none, calm, hover)
    L = np.column_stack([rest - law(e, calm, hover) for e in np.eye(N_XBAR)])
    L_d = np.column_stack([rest - law(none, e, hover) for e in np.eye(N_I)])
    units = np.eye(D * N_U).reshape(-1, D, N_U)
    columns = np.column_stack([rest - law(none, calm, hover + e) for e in units])
    return L, L_d, columns.reshape(N_U, D, N_U).transpose(1, 0, 2)
