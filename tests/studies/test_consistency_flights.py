"""The report over flights: regions, and numbers made up so that the answer is known."""

import json
from typing import Any

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.metrics import position_nees
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.consistency.consistency_flights import consistency_report, region_masks

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}"


@pytest.fixture(scope="module")
def flight(flown: Any) -> xr.Dataset:
    return flown("nominal_imu_uwb", (SHORT,), 1)


@pytest.mark.long
def test_regions_divide_the_flight(flight: xr.Dataset) -> None:
    masks = region_masks(flight)
    parts = np.array([masks[name] for name in ("start", "blackout", "after", "clear")])
    assert (parts.sum(axis=0) == 1).all()
    assert masks["blackout"].any()
    assert not flight["arrival"].sel(sensor="uwb").values[masks["blackout"]].any()


def test_the_report_is_plain_data_and_agrees_with_the_metrics(flight: xr.Dataset) -> None:
    report = consistency_report([flight])
    json.dumps(as_data(report), allow_nan=False)
    assert report.flights == 1
    assert report.nees["position"]["all"].mean == pytest.approx(np.mean(position_nees(flight)))
    assert report.nees["position"]["all"].consistent is None
    assert set(report.nis) == {"uwb", "imu"}
    assert report.whiteness["imu"].samples == int(flight["arrival"].sel(sensor="imu").sum())


def test_flights_made_up_to_be_consistent_are_found_so(flight: xr.Dataset) -> None:
    rng, made = np.random.default_rng(1), []
    L = np.linalg.cholesky(flight["covariance"].values[:, :12, :12])
    for _ in range(12):
        copy = flight.copy(deep=True)
        error = (L @ rng.normal(size=(len(L), 12, 1)))[:, :, 0]
        copy["estimate"].values[:, :12] = copy["truth"].values + error
        made.append(copy)
    nees = consistency_report(made).nees
    assert nees["position"]["all"].mean == pytest.approx(3.0, abs=0.15)
    assert nees["state"]["all"].mean == pytest.approx(12.0, abs=0.3)
    assert nees["position"]["all"].in_band == pytest.approx(0.95, abs=0.05)


def test_flights_of_different_scenarios_are_refused(flight: xr.Dataset) -> None:
    other = flight.copy()
    other.attrs["scenario"] = load_scenario("nominal_imu_uwb", (), 2).model_dump_json()
    with pytest.raises(InputError, match="seeds 1 and 2: fly different scenarios"):
        consistency_report([flight, other])
    with pytest.raises(InputError, match="none given"):
        consistency_report([])
