"""What of a world the theory at hover does not have is named."""

import pytest

from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.loop.error_moments import in_the_rms_alone, left_out


@pytest.mark.parametrize(
    ("setting", "named", "in_the_rms"),
    [
        ("imu.ahrs={time: 5.0}", ["imu.ahrs"], []),
        ("uwb.round=0.04", ["uwb.round"], []),
        ("uwb.noise={kind: constant, sd: 0.2}", ["uwb.noise"], []),
        ("uwb.walls={kind: bias, per_wall: 0.3}", ["uwb.walls"], []),
        ("uwb.walls={kind: block}", [], []),  # ranges that are not there tell nothing wrong
        ("truth.imu.level_sd=0.01", [], ["truth.imu"]),
        ("truth.imu.angles_factor=1.1", ["truth.imu.angles_factor"], []),
        ("truth.uwb={factor_sd: 0.01, slow_sd: 0.02}", ["truth.uwb.factor"], ["truth.uwb"]),
        ("truth.camera.angles_sd=0.01", [], []),  # it does not fly
        ("truth.clock.offset=0.01", ["truth.clock"], []),
        ("world.drag=[0.5, 0.5, 0.0]", [], []),
        ("world={plant: continuous, rotors: {kind: first_order}}", ["world.rotors"], []),
        ("faults=[{kind: gust, start: 1.0, end: 2.0, force: [0.0, 1.0, 0.0]}]", ["faults"], []),
    ],
)
def test_what_a_world_has_beside_the_loop_is_named(setting: str, named: list[str], in_the_rms: list[str]) -> None:
    assert left_out(load_scenario("nominal_imu_uwb")) == in_the_rms_alone(load_scenario("nominal_imu_uwb")) == []
    scenario = load_scenario("nominal_imu_uwb", (setting,))
    assert left_out(scenario) == named
    assert in_the_rms_alone(scenario) == in_the_rms


@pytest.mark.parametrize(
    ("setting", "named", "in_the_rms"),
    [
        ("{white: 0.1}", ["white"], []),
        ("{white: 0.1, constants_sd: 0.05, lasting: {time: 1.0, sd: 0.2}}", ["white"], ["lasting", "constants_sd"]),
        ("{white: 0.1, field: {length: 1.0, sd: 0.1}}", ["white"], ["field"]),
        ("{white: 0.1, outliers: {share: 0.1, sd: 1.0}, missing: 0.1}", ["white", "outliers", "missing"], []),
        ("{white: 0.1, near_floor: 0.1, constants_sd: 0.1}", ["white", "near_floor"], ["constants_sd"]),
        (f"{{white: 0.1, constants_sd: 0.1, constants: {[0.1] * 12}}}", ["white", "constants"], []),
    ],
)
def test_of_fitted_errors_what_lasts_is_in_the_rms(setting: str, named: list[str], in_the_rms: list[str]) -> None:
    scenario = load_scenario("nominal_imu_uwb", ("uwb.errors=fitted", f"uwb.fitted={setting}"))
    assert left_out(scenario) == [f"uwb.fitted.{name}" for name in named]
    assert in_the_rms_alone(scenario) == [f"uwb.fitted.{name}" for name in in_the_rms]
