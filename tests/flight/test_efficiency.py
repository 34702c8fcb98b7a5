"""Efficiency of flown flights against the Cramer-Rao floor."""

import json
from dataclasses import asdict
from functools import cache

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.efficiency import (
    Ratio,
    efficiency,
    floor_at_ticks,
    mean_floor,
    ratio_of_means,
    tick_efficiency,
)
from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.flight.metrics import estimation_mse, summary
from ortilo_drake.floor.cramer_rao import arrived
from ortilo_drake.scenario import load_scenario

HOVER = (
    "planner.kind=hover",
    "planner.point=[1.0, 0.0, 1.5]",
    "planner.duration=6.0",
    "settle=0.0",
)
OUTAGE = "uwb.link.blackouts=[{kind: time, start: 2.5, end: 3.5}]"


@cache
def hovering(seed: int, *settings: str) -> xr.Dataset:
    return fly(load_scenario("nominal_imu_uwb", (*HOVER, OUTAGE, *settings), seed=seed))


@cache
def over_the_floor(seed: int, *settings: str) -> tuple[list[float], list[float]]:
    """Return efficiency and tick_efficiency, x, y and z."""
    flight = hovering(seed, *settings)
    floor = floor_at_ticks(flight)
    both = efficiency(estimation_mse(flight), mean_floor(floor)), tick_efficiency(flight, floor)
    return tuple([value for value in found.values() if value is not None] for found in both)  # type: ignore[return-value]


@pytest.mark.long
@pytest.mark.parametrize("tick_by_tick", [False, True])
def test_no_ensemble_beats_the_floor_and_the_tuned_filter_sits_on_it(tick_by_tick: bool) -> None:
    """The filter of 'nominal_imu_uwb' knows the world's noise, and near hover all is linear, but for z from ranges."""
    ratios = np.array([over_the_floor(seed)[tick_by_tick] for seed in range(20)])
    assert ratios.shape == (20, 3)
    se = ratios.std(axis=0, ddof=1) / np.sqrt(20)
    assert np.all(se < 0.4)
    assert np.all(ratios.mean(axis=0) > 1.0 - 3.5 * se)
    assert np.all(ratios.mean(axis=0) < 1.2 + 3.5 * se)


@pytest.mark.long
def test_the_papers_filter_is_well_above_the_floor() -> None:
    papers = (
        "estimator.W={kind: diagonal, position: 1.0, angle: 1.0, velocity: 1.0, rate: 1.0}",
        "estimator.V={uwb: [0.05, 0.05, 0.05], imu: [0.01, 0.01, 0.01]}",
        "servo.velocities=truth",
    )
    found = np.array([over_the_floor(seed, *papers) for seed in range(5)])
    assert found.shape == (5, 2, 3)
    assert np.all(found.mean(axis=0) > 2.0)


def test_the_filters_own_covariance_meets_the_floor_where_it_knows_everything() -> None:
    small = ("uwb.noise.fraction=0.002", "multilateration.noise.fraction=0.002")
    flight = hovering(0, "estimator.initial_sd=[1.0e-6, 1.0e-6, 1.0e-6, 1.0e-6]", *small)
    floor, P = floor_at_ticks(flight), np.diagonal(flight["covariance"].values, axis1=1, axis2=2)[:, :3]
    assert floor is not None
    # It takes a fix's covariance from the measured place, not the true one, hence the small noise.
    np.testing.assert_allclose(P, floor, rtol=0.03, atol=1e-8)


@pytest.mark.family("{kind: bernoulli, probability: 0.4}")
@pytest.mark.parametrize(
    "loss", ["{kind: gilbert_elliott, good_to_bad: 0.2, bad_to_good: 0.2}", "{kind: bernoulli, probability: 0.4}"]
)
def test_arrivals_made_again_from_the_truth_are_those_of_the_flight(loss: str) -> None:
    flight = hovering(3, f"uwb.link.loss={loss}", f"imu.link.loss={loss}")
    truth = flight["truth"].values
    for sensor in ("uwb", "camera", "imu"):
        expected = flight["arrival"].sel(sensor=sensor).values
        np.testing.assert_array_equal(arrived(scenario_of(flight), sensor, truth), expected)
    assert 0.3 < flight["arrival"].sel(sensor="imu").values.mean() < 0.9


def test_arrivals_by_position_are_made_again_and_late_ones_count_where_they_were_true() -> None:
    blackout = "uwb.link.blackouts=[{kind: position, axis: x, start: 0.99, end: 1.01}]"
    flight = fly(load_scenario("nominal_imu_uwb", (*HOVER, blackout, "uwb.link.delay=2"), seed=1))
    used = flight["arrival"].sel(sensor="uwb").values
    seen = arrived(scenario_of(flight), "uwb", flight["truth"].values)
    assert 3 < used.sum() < 55
    np.testing.assert_array_equal(seen[:-2], used[2:])


def test_a_summary_holds_floor_and_efficiency_of_its_flight() -> None:
    flight = hovering(0)
    found = summary(flight)
    floor = floor_at_ticks(flight)
    assert floor is not None
    assert found.floor == mean_floor(floor) == pytest.approx(dict(zip("xyz", floor.mean(axis=0), strict=True)))
    e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
    for i, axis in enumerate("xyz"):
        assert found.efficiency[axis] == pytest.approx(found.mse[axis] / found.floor[axis])
        ratios = [e[k, i] ** 2 / floor[k, i] for k in range(60, len(e))]  # after 2 s
        assert found.tick_efficiency[axis] == pytest.approx(sum(ratios) / len(ratios))
    json.dumps(asdict(found), allow_nan=False)


def test_without_disturbance_nothing_is_uncertain_and_there_is_no_efficiency() -> None:
    flight = hovering(0, "world.disturbance.force_density=0.0", "world.disturbance.torque_density=0.0")
    found = summary(flight)
    assert found.floor == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert found.efficiency == found.tick_efficiency == {"x": None, "y": None, "z": None}


def test_an_unknown_floor_has_no_efficiency() -> None:
    assert mean_floor(None) is None
    assert tick_efficiency(hovering(0), None) == {"x": None, "y": None, "z": None}
    assert efficiency({"x": 1.0, "y": 2.0}, None) == {"x": None, "y": None}
    assert efficiency({"x": 1.0, "y": 2.0}, {"x": 0.5, "y": 0.0}) == {"x": 2.0, "y": None}


def test_the_ratio_of_means_draws_whole_flights() -> None:
    rng = np.random.default_rng(2)
    floors = rng.gamma(3.0, 0.01, 20)
    errors = floors * rng.gamma(3.0, 0.5, 20)
    found = ratio_of_means(errors.tolist(), floors.tolist())
    assert found.value == pytest.approx(errors.mean() / floors.mean())
    picks = rng.integers(0, 20, (4000, 20))
    drawn = errors[picks].sum(axis=1) / floors[picks].sum(axis=1)
    np.testing.assert_allclose(found.interval, np.quantile(drawn, [0.025, 0.975]), atol=4.0 * 0.042 * drawn.std())
    assert ratio_of_means([], []) == Ratio(None, None)
    assert ratio_of_means([1.0], [2.0]) == Ratio(0.5, None)
    assert ratio_of_means([1.0, 1.0], [0.0, 0.0]) == Ratio(None, None)
