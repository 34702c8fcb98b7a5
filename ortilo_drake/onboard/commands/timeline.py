"""The timeline of the commands that act on the rotors, as the onboard half knows and expects it.

A command of tick j acts from t_j + tau on. The world reports (model/signals.py, 'acted') which commands acted and from
when. A report holds the newest such commands, so no other command acted before the report's stamp. Each command sent
later is expected to act tau after its tick, but not before that stamp. A command counts as lost if its delay would
exceed the delays seen lately. A command that a newer one overtook never acts.

A *timeline* has rows (since, u) in ascending order: u acts from `since` until the `since` of the next row.

The state at the time at which a command will act follows from the state at its tick and the commands on the way. For a
constant delay tau this is the predictor of Z. Artstein, "Linear systems with delayed controls: a reduction", IEEE
Trans. Automatic Control 27 (1982): with z_k = x(t_k + tau), z_{k+1} = Phi z_k + Gamma u_k has no delay, so the servo
that stabilises the plant without delay stabilises z, with the same eigenvalues.
"""

from typing import Any, Final

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.hover import hover_A, hover_B, hover_B_d
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.signals import ACT_SIZE, ACTED_SIZE, ACTS, ARRIVED, N_U, N_XBAR, PAYLOAD, REFERENCE_SIZE, STAMP
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario import Belief

SINCE, SENT, U = 0, 1, 2  # columns of `acts`: acts since [s], tick at which it was sent [s], control
ROW: Final = 1 + N_U  # size of a row of a timeline
EVER: Final = -1e9  # time since which the first row acts [s]
NONE: Final = -1.0  # stamp of an empty row, without a command


@cached_njit
def with_report(acts: np.ndarray, message: np.ndarray) -> np.ndarray:
    """Return the known acts (A, 6), ascending, with the newer ones of an 'acted' message in place of the oldest."""
    known = acts.copy()
    if message[ARRIVED] == 0.0:
        return known
    for i in range(ACTS - 1, -1, -1):
        row = message[PAYLOAD + i * ACT_SIZE : PAYLOAD + (i + 1) * ACT_SIZE]
        is_past = 0.0 <= row[SINCE] <= message[STAMP] and row[SENT] <= row[SINCE]
        if is_past and row[SINCE] > known[-1, SINCE]:
            known[:-1] = known[1:].copy()
            known[-1] = row
    return known


@cached_njit
def delays_of(acts: np.ndarray) -> np.ndarray:
    """Return the delays from tick to act of the commands that acted [s]."""
    found = np.empty(len(acts))
    n = 0
    for i in range(len(acts)):
        if acts[i, SENT] >= 0.0:
            found[n] = acts[i, SINCE] - acts[i, SENT]
            n += 1
    return found[:n]


@cached_njit
def expected_delay(acts: np.ndarray, given: float) -> float:
    """Return tau [s]: `given`, or if it is negative the mean delay of the commands that acted; 0 before the first."""
    if given >= 0.0:
        return given
    delays = delays_of(acts)
    return float(np.mean(delays)) if delays.size else 0.0


@cached_njit
def timeline_of(acts: np.ndarray, heard: float, sent: np.ndarray, tau: float, slack: float) -> np.ndarray:
    """Return the timeline (n, 5) of the commands that acted and of those expected to act, ascending.

    `acts` (A, 6), ascending, holds all commands that acted until the time `heard` [s], which is negative without any
    report. `sent` (S, 5), ascending, holds the commands sent, after empty rows with a negative time. A command is
    expected to act tau [s] after its tick. It counts as lost `slack` [s] after the largest delay seen lately.
    """
    rows = np.empty((len(acts) + len(sent), ROW))
    rows[: len(acts), 0] = acts[:, SINCE]
    rows[: len(acts), 1:] = acts[:, U:]
    n, newest = len(acts), np.max(acts[:, SENT])
    latest = tau
    for delay in delays_of(acts):
        latest = max(latest, delay)
    for i in range(len(sent)):
        stamp = sent[i, 0]
        if stamp >= 0.0 and stamp > newest and heard <= stamp + latest + slack:
            rows[n, 0] = max(stamp + tau, heard, rows[n - 1, 0])
            rows[n, 1:] = sent[i, 1:]
            n += 1
    return rows[:n]


@cached_njit
def mean_control(rows: np.ndarray, begin: float, end: float) -> np.ndarray:
    """Return the mean control (4) that acts from `begin` to `end` [s]; the timeline `rows` starts before `begin`."""
    total = np.zeros(N_U)
    for i in range(len(rows)):
        start = max(rows[i, 0], begin)
        stop = end if i + 1 == len(rows) else min(rows[i + 1, 0], end)
        if stop > start:
            total += (stop - start) * rows[i, 1:]
    return total / (end - begin)


@cached_njit
def with_command(rows: np.ndarray, since: float, u: np.ndarray) -> np.ndarray:
    """Return the timeline with one more command, which acts from `since` [s] on, but not before the last row."""
    after = np.empty((len(rows) + 1, ROW))
    after[:-1] = rows
    after[-1, 0] = max(since, rows[-1, 0])
    after[-1, 1:] = u
    return after


@cached_njit
def packed(tau: float, rows: np.ndarray, size: int) -> np.ndarray:
    """Return a timeline as a vector of a fixed size: [tau, number of rows, rows ..., zeros]."""
    vector = np.zeros(size)
    vector[0], vector[1] = tau, len(rows)
    vector[2 : 2 + rows.size] = rows.ravel()
    return vector


@cached_njit
def unpacked(vector: np.ndarray) -> np.ndarray:
    """Return the rows (n, 5) of a packed timeline."""
    return vector[2 : 2 + int(vector[1]) * ROW].copy().reshape(-1, ROW)


def first_acts(ticks: int, hover_thrust: float) -> np.ndarray:
    """Return the acts before the first report (ticks, 6): hover."""
    return np.tile([EVER, NONE, hover_thrust, 0.0, 0.0, 0.0], (ticks, 1))


def none_sent(ticks: int) -> np.ndarray:
    """Return an empty list of sent commands (ticks, 5)."""
    return np.tile([NONE, 0.0, 0.0, 0.0, 0.0], (ticks, 1))


SLACK = 0.25  # delay beyond the largest one seen lately, after which a command counts as lost [ticks]
MARGIN = 0.5  # time that the log keeps beyond the longest need [s]


def timeline_size(ticks: int) -> int:
    """Return the size of the packed timeline of a log that keeps `ticks` ticks."""
    return 2 + 2 * ticks * ROW


def log_ticks(scenario: Belief) -> int:
    """Return the number of ticks to keep: the longer of the filter's horizon and a command's delay, plus MARGIN."""
    longest = max(getattr(scenario.estimator, "horizon", 0.0), scenario.commands.delay or 0.0)
    return history_ticks(longest + MARGIN, scenario.h)


@register_jitable
def heard_until(heard: float, message: np.ndarray) -> float:
    """Return the time until which all acts are known [s], after a report `message`, if it arrived."""
    return max(heard, message[STAMP] if message[ARRIVED] != 0.0 else NONE)


def log_out(n: Any, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray, out: np.ndarray) -> None:
    """Output the packed timeline, given the report that arrived in this tick and those before."""
    known = with_report(acts, acted)
    tau = expected_delay(known, n.delay)
    rows = timeline_of(known, heard_until(heard[0], acted), sent, tau, n.slack)
    put(packed(tau, rows, out.size), out)


def log_step(
    n: Any, k: int, control: np.ndarray, acted: np.ndarray, sent: np.ndarray, acts: np.ndarray, heard: np.ndarray
) -> None:
    """Store the command of tick k in place of the oldest one, and update the known acts."""
    last = sent.shape[0] - 1
    for i in range(last):
        put(sent[i + 1], sent[i])
    sent[last, 0] = k * n.h
    put(control, sent[last], 1)
    after = with_report(acts, acted)
    for i in range(acts.shape[0]):
        put(after[i], acts[i])
    fill(heard, heard_until(heard[0], acted))


LOG = Element("command_log", out=log_out, step=log_step, allocates=True)


def command_log_box(scenario: Belief) -> Box:
    """Return the box of the commands' log; it reads the control (4) and, if reports exist, the report `acted` (50)."""
    commands, h, ticks = scenario.commands, scenario.h, log_ticks(scenario)
    numbers = {"delay": NONE if commands.delay is None else commands.delay, "slack": SLACK * h, "h": h}
    start = {"sent": none_sent(ticks), "acts": first_acts(ticks, scenario.vehicle.hover_thrust), "heard": [NONE]}
    tables = {} if commands.are_reported else {"acted": np.zeros(ACTED_SIZE)}  # a report that never arrives
    return Box("command_log", LOG, timeline_size(ticks), Values(numbers, start, tables))


@cached_njit
def predicted_state(x: np.ndarray, b: np.ndarray, A: np.ndarray, s: float) -> np.ndarray:
    """Return x after s [s] of x_dot = A x + b; exact for A^4 = 0.

    x(s) = x + sum_k A^(k-1) (A x + b) s^k / k!, k = 1..4.
    """
    after, term = x.copy(), A @ x + b
    for k in range(1, 5):
        term = term * (s / k)
        after += term
        term = A @ term
    return after


@cached_njit
def reference_after(reference: np.ndarray, s: float) -> np.ndarray:
    """Return r, r_dot, r_ddot (9) after s [s] with the present acceleration."""
    later = reference.copy()
    later[:3] += s * reference[3:6] + 0.5 * s * s * reference[6:9]
    later[3:6] += s * reference[6:9]
    return later


@cached_njit
def state_ahead(
    xbar: np.ndarray,
    reference: np.ndarray,
    rows: np.ndarray,
    t: float,
    tau: float,
    h: float,
    A: np.ndarray,
    B: np.ndarray,
    b: np.ndarray,
) -> np.ndarray:
    """Return [x; i] (15) at time t + tau [s], given [x; i] at the tick t and the timeline's rows (n, 5).

    The integral follows the servo's model, i_{k+1} = i_k + r_k - p_k; in a tick that tau ends, only the tick's share
    counts. The reference is r, r_dot, r_ddot at t (9). The hover model is x_dot = A x + B u + b; b is -B times the
    control at hover, plus known disturbances (12).
    """
    x, i = xbar[:12].copy(), xbar[12:].copy()
    done = 0.0
    while done < tau:
        step = min(h, tau - done)
        i += step / h * (reference_after(reference, done)[:3] - x[:3])
        for j in range(len(rows)):
            start = max(rows[j, 0], t + done)
            stop = t + done + step if j + 1 == len(rows) else min(rows[j + 1, 0], t + done + step)
            if stop > start:
                x = predicted_state(x, B @ rows[j, 1:] + b, A, stop - start)
        done += h
    return np.concatenate((x, i))


def ahead_out(
    n: Any,
    k: int,
    belief: np.ndarray,
    reference: np.ndarray,
    timeline: np.ndarray,
    force: np.ndarray,
    A: np.ndarray,
    B: np.ndarray,
    lift: np.ndarray,
    by_force: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [x; i] (15) and the reference (9) at t_k + tau."""
    tau, b = timeline[0], lift + by_force @ force
    put(state_ahead(belief[:N_XBAR], reference, unpacked(timeline), k * n.h, tau, n.h, A, B, b), out)
    put(reference_after(reference, tau), out, N_XBAR)


AHEAD = Element("state_ahead", out=ahead_out, allocates=True)


def state_ahead_box(vehicle: Vehicle, h: float, yaw: float) -> Box:
    """Return the box that predicts the servo's state; it reads belief (15 or more), reference, timeline, force (3).

    The box outputs `belief` (15) and `reference` (9), both at the time at which the servo's command will act.
    """
    B = hover_B(vehicle)
    tables = {"A": hover_A(yaw), "B": B, "lift": -B[:, 0] * vehicle.hover_thrust, "by_force": hover_B_d(vehicle)[:, :3]}
    parts = {"belief": (0, N_XBAR), "reference": (N_XBAR, REFERENCE_SIZE)}
    return Box("state_ahead", AHEAD, N_XBAR + REFERENCE_SIZE, Values({"h": h}, tables=tables), parts=parts)
