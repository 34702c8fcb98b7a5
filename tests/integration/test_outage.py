"""Two seconds without any position fix in flight: the three integrators (THEORY, measurement handler)."""

from functools import cache

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.scenario import load_scenario

START, END = 5.0, 7.0
SETTINGS = (
    "uwb.link={rate: null, blackouts: [{kind: time, start: 5, end: 7}]}",  # 30 Hz otherwise
    "planner={kind: waypoints, points: [[5.0, 1.8, 1.5], [9.0, 1.8, 1.5]], speed: 0.35}",
)


@cache
def flight_of(integrator: str, seed: int) -> xr.Dataset:
    return fly(load_scenario("nominal_imu_uwb", (*SETTINGS, f"estimator.integrator={integrator}"), seed))


def distances_from_path(flight: xr.Dataset) -> np.ndarray:
    """Distance of the true position from the straight line y = 1.8, z = 1.5."""
    return np.linalg.norm(flight["truth"].values[:, 1:3] - [1.8, 1.5], axis=1)


@pytest.mark.family
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_outage_happens_in_flight(seed: int) -> None:
    flight = flight_of("hold", seed)
    t = flight["time"].values
    uwb = flight["arrival"].sel(sensor="uwb").values
    out = (t > START - 1e-6) & (t < END - 1e-6)
    assert out.sum() == 60
    assert not np.any(uwb[out])
    assert np.all(uwb[~out])
    speed = np.linalg.norm(flight["reference_velocity"].values[out], axis=1)
    np.testing.assert_allclose(speed, 0.35, rtol=0.02)


@pytest.mark.family
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("integrator", ["hold", "estimate"])
def test_hold_and_estimate_stay_on_the_path(integrator: str, seed: int) -> None:
    flight = flight_of(integrator, seed)
    assert flight.attrs["lost"] == "null"
    assert np.max(distances_from_path(flight)) < 0.3
    behind = np.linalg.norm(flight["truth"].values[:, :3] - flight["reference"].values, axis=1)
    assert np.max(behind) < 0.3  # in time as well as in space
    assert np.linalg.norm(flight["truth"].values[-1, :3] - [9.0, 1.8, 1.5]) < 0.3


@pytest.mark.family
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_literal_integrates_the_reference_itself_and_throws_the_vehicle(seed: int) -> None:
    flight = flight_of("literal", seed)
    before = flight["time"].values < START
    assert np.max(distances_from_path(flight)[before]) < 0.3
    thrown = np.max(np.linalg.norm(flight["truth"].values[:, :3] - flight["reference"].values, axis=1)) > 1.0
    assert flight.attrs["lost"] != "null" or thrown


@pytest.mark.family
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_in_the_outage_the_integral_does_what_theory_says(seed: int) -> None:
    for integrator in ("literal", "hold", "estimate"):
        flight = flight_of(integrator, seed)
        i = flight["estimate"].values[:, 12:]
        r, xhat = flight["reference"].values, flight["estimate"].values[:, :3]
        # Within the outage and, for a lost flight, before its end.
        t = flight["time"].values[:-1]
        out = np.flatnonzero((t > START - 1e-6) & (t < END - 1e-6))
        change = i[out + 1] - i[out]
        expected = {"literal": r, "hold": 0.0 * r, "estimate": r - xhat}[integrator][out]
        assert len(out) > 10
        np.testing.assert_allclose(change, expected, atol=1e-11)
