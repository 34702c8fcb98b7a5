"""A flight as one flat table: a row for each tick, a column for each number, and the units of the columns."""

import numpy as np
import pandas as pd
import xarray as xr

from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.model.units import product_of_units, unit_of

_SIGNALS = (  # name in the Dataset, its dimension
    ("truth", "state"),
    ("estimate", "xbar"),
    ("control", "control_name"),
    ("reference", "axis"),
    ("reference_velocity", "axis"),
    ("reference_acceleration", "axis"),
    ("due", "sensor"),
    ("arrival", "sensor"),
    ("measurement", "output"),
    ("innovation", "output"),
)


def flight_table(data: xr.Dataset) -> pd.DataFrame:
    """Return a flight, a Dataset of flight.flight_dataset, as a table whose index is the time [s].

    A column's name joins the signal and the component: `truth.x`, `estimate.phi`, `innovation.x_uwb`, `arrival.uwb`,
    `control.f_T`. The symmetric covariance gives its upper triangle: `covariance.x.x`, `covariance.x.y`, ...
    The attribute `table.attrs["units"]` has the unit of every column, "1" for a column without one.
    """
    of_signals = _units(data)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for name, along in _SIGNALS:
        for k, part in enumerate(data[along].values):
            columns[f"{name}.{part}"] = data[name].values[:, k]
            units[f"{name}.{part}"] = of_signals[name][k]
    P, xbar, unit = data["covariance"].values, data["xbar"].values, of_signals["estimate"]
    for i, j in zip(*np.triu_indices(len(xbar)), strict=True):
        columns[f"covariance.{xbar[i]}.{xbar[j]}"] = P[:, i, j]
        units[f"covariance.{xbar[i]}.{xbar[j]}"] = product_of_units(unit[i], unit[j])
    table = pd.DataFrame(columns, index=pd.Index(data["time"].values, name="time"))
    table.attrs["units"] = {"time": "s"} | units
    return table


def _units(data: xr.Dataset) -> dict[str, list[str]]:
    """Return the units of each signal's components."""
    rows = scenario_of(data).measurement.rows
    measured = [unit_of(name, rows) for name in data["output"].values]
    flags = ["1"] * data.sizes["sensor"]
    return {
        "truth": [unit_of(name) for name in data["state"].values],
        "estimate": [unit_of(name) for name in data["xbar"].values],
        "control": [unit_of(name) for name in data["control_name"].values],
        "reference": ["m"] * 3,
        "reference_velocity": ["m/s"] * 3,
        "reference_acceleration": ["m/s^2"] * 3,
        "due": flags,
        "arrival": flags,
        "measurement": measured,
        "innovation": measured,
    }
