"""Metrics of a flight."""

import json

import numpy as np
import xarray as xr
from scipy.spatial import cKDTree

from ortilo_drake.flight.efficiency import efficiency, floor_at_ticks, mean_floor, tick_efficiency
from ortilo_drake.flight.flight import AXES, scenario_of
from ortilo_drake.flight.lost import contacts
from ortilo_drake.flight.summary import FixError, Loss, Summary
from ortilo_drake.model.measurement import Measurement
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.white_noise import nees_of
from ortilo_drake.sensors.described import unwired


def estimation_mse(flight: xr.Dataset) -> dict[str, float]:
    """Return the mean squared error of xhat_{k|k-1} per axis [m^2] (paper, table I)."""
    error = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    return dict(zip(AXES, np.mean(error**2, axis=0).tolist(), strict=True))


def path_mse(flight: xr.Dataset) -> float:
    """Return the path-following error as the authors' code defines it [m^2] (paper, table II).

    The error is the mean square of the deviation in y from the planned path at the actual x. It is NaN where the
    planned path does not run forward in x: then an x may have several y.
    """
    planned = flight["reference"].values
    forward = np.concatenate(([True], np.diff(planned[:, 0]) > 0.0))
    if np.any(np.diff(planned[:, 0]) < -1e-9) or forward.sum() < 2:
        return float("nan")
    actual = flight["truth"].values
    y_planned = np.interp(actual[:, 0], planned[forward, 0], planned[forward, 1])
    return float(np.mean((actual[:, 1] - y_planned) ** 2))


def path_distance(flight: xr.Dataset) -> np.ndarray:
    """Return the distance [m] (n) of the true position from the planned path at every tick, in three dimensions."""
    distance, _ = cKDTree(flight["reference"].values).query(flight["truth"].values[:, :3])
    return np.asarray(distance)


def path_distance_mse(flight: xr.Dataset) -> float:
    """Return the mean squared distance [m^2] of the true position from the planned path."""
    return float(np.mean(path_distance(flight) ** 2))


def reference_distance(flight: xr.Dataset) -> np.ndarray:
    """Return the distance [m] (n) of the true position from the reference r_k at every tick."""
    return np.linalg.norm(flight["truth"].values[:, :3] - flight["reference"].values, axis=1)


def position_nees(flight: xr.Dataset) -> np.ndarray:
    """Return e^T P_pp^-1 e at every tick (n); chi-square with 3 degrees of freedom if the filter is consistent."""
    e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    return nees_of(e, flight["covariance"].values[:, :3, :3])


def nis(flight: xr.Dataset, sensor: str) -> np.ndarray:
    """Return the normalised innovations squared of one sensor at its arrivals; chi-square with m degrees of freedom.

    m is the number of the sensor's rows. Of a position fix only the position counts, m = 3, to compare methods.
    """
    there, measurement = flight["arrival"].sel(sensor=sensor).values, scenario_of(flight).measurement
    is_position = measurement.layout.is_position[measurement.sensors.index(sensor)]
    m = 3 if is_position else len(measurement.C_of(sensor))
    e, S = innovations(flight, sensor)
    e, S = e[there][:, :m], S[there][:, :m, :m]
    return np.einsum("ki,ki->k", e, np.linalg.solve(S, e[:, :, np.newaxis])[:, :, 0])


def innovations(flight: xr.Dataset, sensor: str) -> tuple[np.ndarray, np.ndarray]:
    """Return a sensor's innovations (n, m), NaN without arrival, and their covariance S = C P C^T + V (n, m, m)."""
    measurement = scenario_of(flight).measurement
    C, m = measurement.C_of(sensor), len(measurement.C_of(sensor))
    V = flight["measurement_covariance"].sel(sensor=sensor).values[:, :m, :m]
    S = C @ flight["covariance"].values[:, :N_X, :N_X] @ C.T + V
    return flight["innovation"].values[:, measurement.rows_of(sensor)], S


def arrival_rates(flight: xr.Dataset) -> dict[str, float | None]:
    """Return used values / due values of each sensor that sends by radio [1]; None for a sensor that is never due."""
    rates: dict[str, float | None] = {}
    for sensor in unwired(scenario_of(flight).measurement.sensors):
        due = int(flight["due"].sel(sensor=sensor).sum())
        rates[sensor] = int(flight["arrival"].sel(sensor=sensor).sum()) / due if due else None
    return rates


def fix_errors(flight: xr.Dataset) -> dict[str, FixError]:
    """Return the median and 95th percentile of the distance of a sensor's position fixes from the truth at use [m].

    A sensor without a fix is left out. The way flown since a late fix was measured is part of the error of that fix.
    """
    errors = {}
    measurement = scenario_of(flight).measurement
    for sensor, is_position in zip(measurement.sensors, measurement.layout.is_position, strict=True):
        there = _made_fixes(flight, sensor, measurement)
        if is_position and there.any():
            fix = flight["measurement"].values[there, measurement.rows_of(sensor)][:, :3]
            truth = flight["truth"].values[there, :3]
            error = np.linalg.norm(fix - truth, axis=1)
            errors[sensor] = FixError(float(np.median(error)), float(np.quantile(error, 0.95)))
    return errors


def _made_fixes(flight: xr.Dataset, sensor: str, measurement: Measurement) -> np.ndarray:
    """Return a mask (n) of ticks in which a sensor's message gave a value of y; a tight filter makes none of ranges."""
    values = flight["measurement"].values[:, measurement.rows_of(sensor)]
    return np.asarray(flight["arrival"].sel(sensor=sensor).values & np.isfinite(values).all(axis=1))


def loss_of(flight: xr.Dataset) -> Loss | None:
    """Return the time and reason of a flight's loss; None if the flight reached its end."""
    lost = json.loads(flight.attrs["lost"])
    return lost and Loss(lost["time"], lost["cause"])


def summary(flight: xr.Dataset) -> Summary:
    """Return the figures of a flight."""
    scenario = scenario_of(flight)
    whole = np.isfinite(flight["truth"].values).all(axis=1) & np.isfinite(flight["estimate"].values).all(axis=1)
    flight = flight.isel(tick=whole)  # leaves out the end of a flight that diverged
    used = [str(s) for s in flight["sensor"].values if _made_fixes(flight, str(s), scenario.measurement).any()]
    mse, floor = estimation_mse(flight), floor_at_ticks(flight)
    return Summary(
        scenario=scenario.name,
        seed=int(flight.attrs["seed"]),
        lost=loss_of(flight),
        contacts=contacts(flight["truth"].values, scenario.load_room(), scenario.vehicle),
        mse=mse,
        floor=mean_floor(floor),
        efficiency=efficiency(mse, mean_floor(floor)),
        tick_efficiency=tick_efficiency(flight, floor),
        path_mse=by_x if np.isfinite(by_x := path_mse(flight)) else None,
        path_distance_mse=path_distance_mse(flight),
        max_path_distance=float(np.max(path_distance(flight))),
        max_reference_distance=float(np.max(reference_distance(flight))),
        arrivals=arrival_rates(flight),
        fix_errors=fix_errors(flight),
        nees=float(np.mean(position_nees(flight))),
        nis={sensor: float(np.mean(nis(flight, sensor))) for sensor in used},
        player=flight.attrs.get("player"),
        real_time_factor=float(flight.attrs["real_time_factor"]),
    )
