"""The two halves, met at the ticks, against the closed loop that Drake simulates in one piece."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.reader import read_log
from ortilo_drake.interop.log.replay import replay_log
from ortilo_drake.scenario import Scenario, load_scenario

LATE = (
    "camera.link={rate: 10.0, delay: 1, random_delay: 2, loss: {kind: bernoulli, probability: 0.2}}",
    "command_link={delay: 1, loss: {kind: bernoulli, probability: 0.1}}",
)
HOVER = ("settle=0", "planner={kind: hover, duration: 1.0}", "camera.kind=projected")
LOST = ("command_link={delay: 2, loss: 0.2}", "report_link={delay: 1, loss: 0.2}")


def same_flight(scenario: Scenario) -> xr.Dataset:
    """Fly a scenario both ways, and return the flight if it is the same bit for bit."""
    whole, halves = fly(scenario), fly_lockstep(scenario, in_this_process(scenario))
    del whole.attrs["real_time_factor"]
    xr.testing.assert_identical(whole, halves)
    for name in whole.data_vars:
        np.testing.assert_array_equal(whole[name].values, halves[name].values)
    return halves


@pytest.mark.family("nominal_imu_uwb-settings0")
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("nominal_imu_uwb", ()),
        pytest.param("nominal_imu_uwb_yolo", ("camera.kind=projected",), marks=pytest.mark.long),
        ("nominal_imu_uwb_yolo", ("camera.kind=projected", *LATE)),
        ("paper_imu_uwb", ()),
        ("rotors", ("planner={kind: hover, duration: 4.0}",)),
    ],
)
def test_halves_fly_the_closed_loop_bit_for_bit(name: str, settings: tuple[str, ...]) -> None:
    same_flight(load_scenario(name, settings))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("nominal_imu_uwb", ("imu.link.rate=240",)),
        ("nominal_imu_uwb", ("estimator.force=measured",)),
        ("nominal_imu_uwb", ("estimator.force=measured", "estimator.delay=replay", "uwb.link.delay=3")),
        ("nominal_imu_uwb", ("estimator.force=measured", "imu.link.rate=240")),
        ("nominal_imu_uwb_yolo", ("estimator.delay=replay", "commands={filter: acted, servo: predicted}", *LOST)),
        ("flow", ("altimeter.link.rate=60", "flow.link={rate: 90, loss: 0.2}")),
        ("altimeter", ("imu.link={rate: 240, random_delay: 2}", "estimator.delay=replay", "altimeter.link.rate=60")),
        ("tight_imu_uwb_yolo", ()),
    ],
)
def test_a_log_of_the_halves_holds_the_flight_and_replays_bit_for_bit(
    name: str, settings: tuple[str, ...], tmp_path: Path
) -> None:
    scenario = load_scenario(name, (*HOVER, *settings))
    flight = same_flight(scenario)
    fly_logged(scenario, tmp_path / "log")
    xr.testing.assert_identical(read_log(tmp_path / "log").drop_attrs(), flight.drop_attrs())
    assert replay_log(tmp_path / "log").identical
    assert (flight["arrival"].sel(sensor=list(scenario.faster_sensors)).mean("tick").values > 0.4).all()


@pytest.mark.long
@pytest.mark.egl
@pytest.mark.parametrize("settings", [(), LATE[:1]])
def test_rendered_halves_fly_the_closed_loop_bit_for_bit(settings: tuple[str, ...]) -> None:
    flight = same_flight(
        load_scenario("nominal_imu_uwb_yolo", ("settle=0", "planner={kind: hover, duration: 4}", *settings))
    )
    assert flight["arrival"].sel(sensor="camera").sum() > 20


def test_a_lost_flight_ends_at_the_same_tick() -> None:
    flight = same_flight(load_scenario("nominal_imu_uwb", ("world.disturbance.torque_density=0.11",)))
    assert flight.attrs["lost"] != "null"


def test_another_path_is_flown_from_the_tick_at_which_it_was_given() -> None:
    onboard = OnboardHalf(load_scenario("nominal_imu_uwb", ("planner={kind: hover, duration: 9.0}",)))
    for _ in range(3):
        onboard.advance()
    t, before = onboard.context.get_time(), onboard.outputs()
    assert before["reference"].tolist() == [0.0, 0.0, 1.5] + [0.0] * 6
    line = PiecewisePolynomial.FirstOrderHold([t, t + 10.0], np.array([[0.0, 1.0], [0.0, 2.0], [1.5, 1.5]]))
    onboard.fly_path(line)
    after = onboard.outputs()
    assert onboard.path is line
    assert onboard.context.get_time() == t
    np.testing.assert_allclose(after["reference"], [0.0, 0.0, 1.5, 0.1, 0.2, 0.0, 0.0, 0.0, 0.0], atol=1e-15)
    assert not np.array_equal(after["control"], before["control"])
    np.testing.assert_array_equal(after["control"], onboard.answer())
    np.testing.assert_array_equal(after["estimate"], before["estimate"])
    onboard.advance()
    np.testing.assert_allclose(onboard.outputs()["reference"][:2], [0.1 / 30.0, 0.2 / 30.0], atol=1e-15)


@pytest.mark.long
def test_the_same_path_given_again_in_flight_changes_no_bit() -> None:
    scenario = load_scenario("nominal_imu_uwb", ("settle=0",))
    world, once, again = WorldHalf(scenario), OnboardHalf(scenario), OnboardHalf(scenario)
    for _ in range(90):
        messages = world.sample()
        again.fly_path(again.path)
        for onboard in (once, again):
            onboard.receive(messages)
        outputs = once.outputs()
        for name, value in again.outputs().items():
            np.testing.assert_array_equal(value, outputs[name])
        for onboard in (once, again):
            onboard.advance()
        np.testing.assert_array_equal(again.state(), once.state())
        world.advance(outputs["control"])
