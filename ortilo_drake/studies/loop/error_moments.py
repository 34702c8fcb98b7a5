"""The errors at hover that follow from the errors of a scenario's world, and those that the theory leaves out.

Errors e of the world drive the loop z = [x; f; xhat; ehat; i] of command_loop.py, with a perfect link:

    z_{k+1} = A_k z_k + B_k e_k,   e_{k+1} = a e_k + w_k,   B_k = [G; K_k Delta_k C_e; -E_k C_e]

G is their effect on the vehicle, C_e their effect on the rows of y. E[z z^T] is followed tick by tick from a flight's
start, z = 0, since lasting errors have no steady state to start from. The integral takes the fix of the first sensor
that gives the position: in the long run the vehicle stands where that fix says r, whatever other sensors say.

If the data of a fix, ranges or the boxes' centres in the image, have errors e, the fix has the error D e. Its sensor
gives D, the derivative of the very solver that flies, by differences (`made` of model/parts.py).

Margins, arrival rates and lost commands are for the world that the filter assumes once its banks have learned the
survey (sensors/learned_survey.py), with the rotors' drag. The predicted rms at hover includes the world's further
errors, as here.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.floor.unknown_errors import force_errors, unknown_of
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, SENSORS
from ortilo_drake.onboard.estimator.extra_states import F
from ortilo_drake.scenario import Scenario, Truth
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.information_rows import rows_of
from ortilo_drake.sensors.unknown_error import Error
from ortilo_drake.studies.command_link.command_loop import behind_a_link, commanded_loop
from ortilo_drake.studies.loop.hover_loop import HoverLoop, hover_loop, message_of


def errors_of_rows(scenario: Scenario, measurement: Measurement, x: np.ndarray) -> list[tuple[Error, np.ndarray]]:
    """Return the unknown errors of a scenario's world, and their coefficients in the rows of y at state x (p, e).

    They are those of floor/unknown_errors.py, of mean zero and a variance that is the square of the value plus the
    square of the spread. An attitude filter's error is not among them. The rows are those that the scenario's filter
    gets (hover_loop.filter_measurement); x is the true state, hovering (12).
    """
    room, p = scenario.load_room(), measurement.sizes["y"]
    found = [(error, np.zeros((p, len(error.sd)))) for error in force_errors(scenario, 0.0)]
    for error, C in found:  # an error that drives the vehicle is in the force f already; the others are the imu's
        if "accelerometer" in measurement.sensors and "force" in error.sees and not error.G.any():
            C[measurement.rows_of("accelerometer")] = error.sees["force"](numbered(3)) / scenario.vehicle.mass
    for name in scenario.sensors:
        made = _rows_and_what_makes_them(scenario, room, measurement, name, x)
        for error in unknown_of(scenario, room, name):
            if error.by_x.any():
                continue
            C = np.zeros((p, len(error.sd)))
            for kind, (sensor, D, rows) in made.items():
                if kind in error.sees:
                    C[measurement.rows_of(sensor)] += D @ error.sees[kind](rows)
            found.append((error, C))
    return found


def numbered(number: int) -> np.ndarray:
    """Return rows whose sources are 0, 1, ... (number, 17)."""
    return rows_of(np.zeros(number), np.zeros((number, N_X)), np.ones(number), np.arange(number))


def _rows_and_what_makes_them(
    scenario: Scenario, room: Room, measurement: Measurement, name: str, x: np.ndarray
) -> dict[str, tuple[str, np.ndarray, np.ndarray]]:
    """Return, by the kind of rows that see a sensor's errors: the sensor whose rows of y they make, D, the rows."""
    sensor = described(name)
    if sensor.made is not None:
        made = sensor.made(scenario, room, x)
        return {} if made is None else {name: (name, *made)}
    rows = numbered(len(sensor.rows))
    found = {name: (name, np.eye(len(rows)), rows)}
    if "gyroscope" in measurement.sensors and message_of("gyroscope", measurement) == name:
        found["rates"] = ("gyroscope", np.eye(3), numbered(3))
    return found


SMALL = 1e-12  # variance, relative to the largest, below which a combination of errors counts as none


class Drive(NamedTuple):
    """Independent errors (e) that drive the loop.

    sd are their standard deviations at first, step_sd those of what a tick adds, and keeps the share of the value that
    lasts from one tick to the next. G (M, e) is their effect on the world's states, C (p, e) that on the rows of y.
    """

    sd: np.ndarray
    step_sd: np.ndarray
    keeps: np.ndarray
    G: np.ndarray
    C: np.ndarray


def drive_of(error: Error, C: np.ndarray, loop: HoverLoop) -> Drive:
    """Return an error with its coefficients in the rows of y (p, e), merged into as few components as possible."""
    G = np.zeros((len(loop.world), len(error.sd)))
    G[:N_X] = error.G
    names = [loop.names[k] for k in loop.world]
    if set(F) <= set(names) and "force" in error.sees and error.G.any():
        G[[names.index(name) for name in F]] = error.sees["force"](numbered(3))
    drive = Drive(error.sd, error.step_sd, error.keeps, G, C)
    alike = error.keeps == error.keeps[0]
    steps = error.step_sd * error.sd[0] == error.step_sd[0] * error.sd
    return merged_components(drive) if len(error.sd) > 3 and error.sd.any() and alike.all() and steps.all() else drive


def merged_components(drive: Drive) -> Drive:
    """Return errors that vary alike, merged into as few components as act differently, by the covariance of their sum.

    At least one sd must not be 0.
    """
    first = int(np.argmax(drive.sd))
    U, s, _ = np.linalg.svd(np.vstack([drive.G, drive.C]) * drive.sd, full_matrices=False)
    there = s**2 > SMALL * max(s[0] ** 2, np.finfo(float).tiny)
    acts, n, split = (U * s)[:, there], int(there.sum()), len(drive.G)
    step = drive.step_sd[first] / drive.sd[first]
    return Drive(np.ones(n), np.full(n, step), np.full(n, drive.keeps[first]), acts[:split], acts[split:])


def error_inputs(scenario: Scenario, x: np.ndarray) -> list[Drive]:
    """Return the error inputs that drive a scenario's loop at state x (12), hovering, beside the white noise."""
    loop = hover_loop(scenario)
    found = [drive_of(error, C, loop) for error, C in errors_of_rows(scenario, loop.measurement, x)]
    return [drive for drive in found if (drive.sd.any() or drive.step_sd.any()) and (drive.G.any() or drive.C.any())]


def position_moments(scenario: Scenario, V: np.ndarray, some: list[Drive], ticks: int) -> np.ndarray:
    """Return E[(p - r) (p - r)^T] caused by `some` errors, in each tick from the start of a flight (ticks, 3, 3).

    V is the covariance of the measurements (p x p). The sensors' losses, delays and blackouts are left out.
    """
    if not some:
        return np.zeros((ticks, 3, 3))
    loop = commanded_loop(scenario, V)
    A, _ = behind_a_link(loop, "hold")
    n, e = A.shape[-1], sum(len(drive.sd) for drive in some)
    whole = np.zeros((len(A), n + e, n + e))
    whole[:, :n, :n] = A[:, 0]
    G, C = np.hstack([drive.G for drive in some]), np.hstack([drive.C for drive in some])
    whole[:, : loop.by_v.shape[1], n:] = loop.by_v @ C
    whole[:, : len(G), n:] += G
    whole[:, n:, n:] = np.diag(np.concatenate([drive.keeps for drive in some]))
    S, N = np.zeros((n + e, n + e)), np.zeros((n + e, n + e))
    S[n:, n:] = np.diag(np.concatenate([drive.sd for drive in some]) ** 2)
    N[n:, n:] = np.diag(np.concatenate([drive.step_sd for drive in some]) ** 2)
    found = np.empty((ticks, 3, 3))
    for k in range(ticks):
        found[k], A_k = S[:3, :3], whole[k % len(whole)]
        S = A_k @ S @ A_k.T + N
    return found


# Entries of truth without a linear error: they scale what changes little at hover, or pass before it counts.
FACTORS: dict[str, tuple[str, ...]] = {
    "truth.vehicle": ("inertia_factor",),
    "truth.imu": ("angles_factor", "rates_factor", "specific_force_factor"),
    "truth.uwb": ("factor",),
    "truth.camera": ("focal_factor",),
}
OTHERS = ("clock", "start")


def left_out(scenario: Scenario) -> list[str]:
    """Return the settings by which a scenario's world differs at hover from the model of the predicted rms."""
    found = _of_sensors(scenario, 0) | {
        "world.rotors": scenario.world.rotors.kind == "first_order",
        "faults": bool(scenario.faults),
    }
    for group, factors in FACTORS.items():
        changed = {name.removesuffix("_sd") for name in _changed(scenario, group)}
        found |= {f"{group}.{name}": name in changed for name in factors}
    found |= {f"truth.{name}": getattr(scenario.truth, name) != getattr(Truth(), name) for name in OTHERS}
    return [name for name, there in found.items() if there]


def in_the_rms_alone(scenario: Scenario) -> list[str]:
    """Return the settings that enter the predicted rms but not the other figures."""
    found = _of_sensors(scenario, 1)
    for group in (f"truth.{name}" for name in Truth.model_fields if name not in OTHERS):
        changed = {name.removesuffix("_sd") for name in _changed(scenario, group) if not name.endswith("_time")}
        found[group] = not changed.issubset(FACTORS.get(group, ()))
    return [name for name, there in found.items() if there]


def _of_sensors(scenario: Scenario, which: int) -> dict[str, bool]:
    """Return the first (0) or second (1) group of settings in `left_out` (model/parts.py) of the sensors that fly."""
    return {
        name: there
        for sensor in scenario.sensors
        for name, there in described(sensor).left_out(scenario)[which].items()
    }


def _changed(scenario: Scenario, group: str) -> set[str]:
    """Return the fields of a group, truth.<name>, that are not as usual; none of a sensor that does not fly."""
    name_of = group.removeprefix("truth.")
    its, usual = dict(getattr(scenario.truth, name_of)), dict(getattr(Truth(), name_of))
    flies = name_of not in SENSORS or name_of in scenario.sensors
    return {name for name in its | usual if its.get(name) != usual.get(name)} if flies else set()
