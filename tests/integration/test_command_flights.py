"""Hovering behind lossy and late command links: predicted and flown."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.room import ORTILO_ROOM, load_room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import CommandLink, load_scenario
from ortilo_drake.studies.command_link.command_flights import (
    POINT,
    command_cases,
    command_flights,
    hover_point,
    hover_V,
)
from ortilo_drake.studies.command_link.command_loop import commanded_loop
from ortilo_drake.studies.command_link.command_report import lossy_loop
from ortilo_drake.theory.jump_linear.jump_linear import steady_second_moment

SHORT = "planner={kind: hover, point: [8, 1, 1.5], duration: 2}"
NOTHING_LOST = "command_link.loss={kind: bernoulli, probability: 0.0}"


@pytest.mark.family("nominal_imu_uwb")
@pytest.mark.parametrize("name", ["nominal_imu_uwb", "rotors"])
def test_a_link_that_loses_nothing_flies_the_same_bits(name: str) -> None:
    def bits(*settings: str) -> xr.Dataset:
        return fly(load_scenario(name, ("camera.kind=projected", SHORT, *settings), 3))

    without, through = bits(), bits(NOTHING_LOST)
    for variable in without.data_vars:
        assert np.array_equal(without[variable].values, through[variable].values, equal_nan=True), variable


def test_the_log_holds_the_commands_whatever_the_link_makes_of_them() -> None:
    calm = ("world.disturbance={force_density: 0, torque_density: 0}", SHORT)
    flight = fly(load_scenario("nominal_imu_uwb", (*calm, "command_link.loss={kind: bernoulli, probability: 1.0}",
                                           "command_link.when_lost=zero")))  # fmt: skip
    start = flight["truth"].values[0]
    np.testing.assert_allclose(
        flight["truth"].values, np.tile(start, (len(flight["truth"]), 1)), atol=1e-9
    )  # it hovers
    assert np.max(np.abs(flight["control"].values[:, 1:])) > 1e-3  # though commanded otherwise, for the sensors' noise


def test_the_covariance_at_hover_is_that_of_the_geometry() -> None:
    anchors = load_room(ORTILO_ROOM).anchor_positions
    away = np.array(POINT) - anchors
    d = np.linalg.norm(away, axis=1)
    J = away / d[:, np.newaxis]
    V = hover_V(load_scenario("nominal_imu_uwb"))
    np.testing.assert_allclose(V[:3, :3], np.linalg.inv(J.T @ np.diag((0.0075 * d) ** -2.0) @ J), rtol=1e-9)
    np.testing.assert_allclose(V[6:, 6:], 1e-4 * np.eye(3))
    with pytest.raises(InputError, match="no measurement of camera there"):
        hover_V(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",)), (20.5, -3.2, 1.5))


def test_in_a_room_of_one_s_own_it_hovers_where_the_vehicle_can_be(tmp_path: Path) -> None:
    """`ortilo analyze` hovered at the authors' place, on the wall of a room of 8 x 6 m, and ended after minutes."""
    (tmp_path / "lab.yaml").write_text(
        "name: lab\ninterior: {min: [0, 0, 0], max: [8, 6, 3]}\nstart: [1.2, 2]\ngoal: [5.5, 4]\nlandmarks: []\n"
        "anchors: [[0.2, 0.2, 2.8], [4, 0.2, 0.2], [7.8, 0.2, 2.8], [7.8, 5.8, 0.2], [4, 5.8, 2.8], [0.2, 5.8, 0.2]]\n"
    )
    (tmp_path / "mine.yaml").write_text("base: imu_uwb\nroom: lab.yaml\nuwb: {link: {blackouts: []}}\n")
    x, y, _ = hover_point(load_scenario(tmp_path / "mine.yaml"))
    assert np.hypot(x - (1.2 + 5.5) / 2, y - (2.0 + 4.0) / 2) < 0.5  # half-way from start to goal
    assert hover_point(load_scenario("nominal_imu_uwb")) == POINT


def test_a_place_without_a_measurement_is_refused_before_anything_is_learned_there(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", ("camera.kind=projected",))
    with pytest.raises(InputError, match="no measurement of camera there"):
        command_flights(scenario, command_cases((0.0,), ("hold",), ()), range(1), tmp_path, point=(20.5, -3.2, 1.5))


@pytest.mark.long
def test_a_filter_that_allows_for_what_is_not_there_hovers_as_predicted(tmp_path: Path) -> None:
    """Force and biases are estimated and are zero: the distance from r is that of the whole loop, not of P."""
    scenario = load_scenario("imu_uwb")
    (case,) = command_flights(scenario, command_cases((0.0,), ("hold",), ()), range(4), tmp_path, duration=40.0).cases
    assert case.lost == 0
    # 160 s of an error that takes about 4 s to renew itself: some 40 values an axis.
    assert case.flown_rms == pytest.approx(case.predicted_rms, rel=0.25)


@pytest.mark.long
def test_flights_do_what_was_predicted_of_them(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", ("camera.kind=projected",))
    links = command_cases((0.4,), ("hold",), (6,))
    found = command_flights(scenario, links, range(3), tmp_path, duration=20.0)
    assert json.loads(json.dumps(as_data(found), allow_nan=False))["cases"][0]["link"] == links[0].model_dump(
        mode="json"
    )
    lossy, late = found.cases
    assert found.agree == 2
    assert lossy.stable
    assert lossy.lost == 0
    # 60 s of an error that takes about 2 s to renew itself: some 30 values an axis, so the rms is good to a tenth.
    assert lossy.flown_rms == pytest.approx(lossy.predicted_rms, rel=0.3)
    V = hover_V(scenario)
    flown = scenario.model_copy(update={"command_link": links[0]})
    moments = [steady_second_moment(lossy_loop(commanded_loop(s, V), s.command_link, s.h)) for s in (scenario, flown)]
    perfect, predicted = (float(np.sqrt(np.trace(S.mean(axis=0)[:3, :3]))) for S in moments)
    assert predicted == pytest.approx(lossy.predicted_rms, rel=1e-6)
    assert lossy.flown_rms > 1.3 * perfect  # it tells a lossy link from a perfect one
    assert not late.stable
    assert late.predicted_rms is late.flown_rms is None
    assert late.lost == late.flights == 3
    assert late.lost_after < 30.0
    assert late.causes


@pytest.mark.parametrize(
    ("losses", "strategies", "delays", "named"),
    [((1.2,), ("hold",), (), "loss: 1.2"), ((0.2,), ("fall",), (), "'fall'"), ((), (), (-1,), "delay: -1")],
)
def test_links_that_cannot_be_are_refused(losses, strategies, delays, named: str) -> None:
    with pytest.raises(InputError, match=named):
        command_cases(losses, strategies, delays)


def test_cases_are_every_loss_with_every_strategy_then_the_delays() -> None:
    links = command_cases((0.1, 0.2), ("hold", "zero"), (1, 2))
    assert [(link.when_lost, link.loss.kind, link.delay) for link in links] == [
        ("hold", "bernoulli", 0), ("hold", "bernoulli", 0), ("zero", "bernoulli", 0), ("zero", "bernoulli", 0),
        ("hold", "none", 1), ("hold", "none", 2),
    ]  # fmt: skip
    assert all(isinstance(link, CommandLink) for link in links)
