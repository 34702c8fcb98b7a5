"""The signals of a flight as named time series: plain numbers, by their path in a recording."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.interop.rerun.sightings import Sightings
from ortilo_drake.model.signals import INTEGRAL_NAMES, STATE_NAMES
from ortilo_drake.model.vehicle import mixing_inverse

PARTS = {
    "position": STATE_NAMES[0:3],
    "attitude": STATE_NAMES[3:6],
    "velocity": STATE_NAMES[6:9],
    "attitude_rate": STATE_NAMES[9:12],
}  # parts of the state [m, rad, m/s, rad/s]


ERROR_RED, BAND_GREY = (200, 60, 40), (150, 150, 150)


class Series(NamedTuple):
    """k named lines over the same times (n) [simulated s], with a column of values for each line (n, k).

    A sparse series has values only at arrivals and is drawn as points. In a step series each value holds until the
    next. Each line has a colour (red, green, blue); without colours the viewer chooses.
    """

    times: np.ndarray
    values: np.ndarray
    names: tuple[str, ...]
    is_sparse: bool = False
    is_step: bool = False
    colors: tuple[tuple[int, int, int], ...] = ()


def all_series(flight: xr.Dataset, seen: Sightings) -> dict[str, Series]:
    """Return every signal of a flight by its path.

    Covariances are left out, but for their standard deviations.
    """
    return {**_states(flight), **_errors(flight), **_commands(flight), **_sensors(flight), **_ranges(seen)}


def _states(flight: xr.Dataset) -> dict[str, Series]:
    time, found = flight["time"].values, dict[str, Series]()
    sd = np.sqrt(np.diagonal(flight["covariance"].values, axis1=1, axis2=2))
    for part, names in PARTS.items():
        columns = [STATE_NAMES.index(name) for name in names]
        found[f"truth/{part}"] = Series(time, flight["truth"].values[:, columns], names)
        found[f"estimate/{part}"] = Series(time, flight["estimate"].values[:, columns], names)
        found[f"estimate_sd/{part}"] = Series(time, sd[:, columns], names)
    integral = slice(len(STATE_NAMES), None)
    found["estimate/integral"] = Series(time, flight["estimate"].values[:, integral], INTEGRAL_NAMES)
    found["estimate_sd/integral"] = Series(time, sd[:, integral], INTEGRAL_NAMES)
    for path, name in (("position", ""), ("velocity", "_velocity"), ("acceleration", "_acceleration")):
        found[f"reference/{path}"] = Series(time, flight[f"reference{name}"].values, AXES)
    return found


def _errors(flight: xr.Dataset) -> dict[str, Series]:
    """Return the error of the estimated position on each axis, with lines at plus and minus 3 sigma [m]."""
    found, lines, colors = {}, ("error", "3 sigma", "-3 sigma"), (ERROR_RED, BAND_GREY, BAND_GREY)
    for i, axis in enumerate(AXES):
        error = flight["estimate"].values[:, i] - flight["truth"].values[:, i]
        band = 3.0 * np.sqrt(flight["covariance"].values[:, i, i])
        values = np.column_stack([error, band, -band])
        found[f"errors/{axis}"] = Series(flight["time"].values, values, lines, colors=colors)
    return found


def _commands(flight: xr.Dataset) -> dict[str, Series]:
    """Return the commanded thrust [N], torques [N m], and the thrust of each rotor that they require [N]."""
    time, u, vehicle = flight["time"].values, flight["control"].values, scenario_of(flight).vehicle
    rotors = vehicle.rotor_lift * u @ mixing_inverse(vehicle).T
    names = tuple(f"rotor {i}" for i in range(vehicle.rotor_count))
    return {
        "control/thrust": Series(time, u[:, :1], ("f_T",), is_step=True),
        "control/torque": Series(time, u[:, 1:], ("tau_x", "tau_y", "tau_z"), is_step=True),
        "control/rotor_thrust": Series(time, rotors, names, is_step=True),
    }


def _sensors(flight: xr.Dataset) -> dict[str, Series]:
    """Return for each sensor the flags due and used, its values, their standard deviations and innovations."""
    measurement, time, found = scenario_of(flight).measurement, flight["time"].values, dict[str, Series]()
    for j, sensor in enumerate(measurement.sensors):
        due, used = flight["due"].values[:, j], flight["arrival"].values[:, j]
        if not (due | used).any():
            continue
        rows = measurement.rows_of(sensor)
        names = tuple(measurement.outputs[rows])
        V2 = flight["measurement_covariance"].values[used, j, : len(names), : len(names)]
        sd = np.sqrt(np.diagonal(V2, axis1=1, axis2=2))
        there = np.column_stack([due, used]).astype(float)
        found[f"arrivals/{sensor}"] = Series(time, there, (f"{sensor} due", f"{sensor} used"), is_step=True)
        for path, values in (
            ("measurement", flight["measurement"].values[used, rows]),
            ("measurement_sd", sd),
            ("innovation", flight["innovation"].values[used, rows]),
        ):
            found[f"{path}/{sensor}"] = Series(time[used], values, names, is_sparse=True)
    return found


def _ranges(seen: Sightings) -> dict[str, Series]:
    """Return the received ranges and differences of ranges [m]."""
    rows = {path: np.array(its) for path, its in seen.ranges.items()}
    return {path: Series(its[:, 0], its[:, 1:], (path.split("/")[1],), is_sparse=True) for path, its in rows.items()}
