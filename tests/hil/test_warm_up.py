"""A warmed process compiles nothing in flight, and loads nothing compiled."""

import pytest
from numba.core import event

from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.real_time.warm_up import warm_up
from ortilo_drake.scenario import load_scenario


@pytest.mark.parametrize("name", ["nominal_imu_uwb_yolo"])
def test_a_warmed_onboard_half_has_all_that_it_calls(name: str) -> None:
    scenario = load_scenario(name, ("camera.kind=projected",))
    warm_up(scenario)
    world, onboard = WorldHalf(scenario), OnboardHalf(scenario)
    with event.install_recorder("numba:compile") as compiled:
        for _ in range(5):
            onboard.receive(world.sample())
            control = onboard.answer()
            onboard.outputs()
            onboard.advance()
            world.advance(control)
    assert not [entry.data["dispatcher"] for _, entry in compiled.buffer]


@pytest.mark.egl
def test_a_half_that_takes_detections_is_warmed_too() -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo")
    warm_up(scenario)
    onboard = OnboardHalf(scenario, detects=False)
    with event.install_recorder("numba:compile") as compiled:
        onboard.receive({})
        onboard.answer()
        onboard.outputs()
        onboard.advance()
    assert not [entry.data["dispatcher"] for _, entry in compiled.buffer]
