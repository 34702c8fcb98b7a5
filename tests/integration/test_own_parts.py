"""The contracts: parts given by hand, registered and named in a scenario, and refused where they do not fit."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem
from pydrake.trajectories import PiecewisePolynomial

import ortilo_drake as od
from ortilo_drake.diagrams.estimator import IntermittentEstimator
from ortilo_drake.model import parts
from ortilo_drake.onboard.servo.lq_servo import make_lq_servo
from ortilo_drake.scenario import LqServo

HOVER = {"planner": {"kind": "hover", "duration": 0.5}, "settle": 0.0}


@pytest.fixture(autouse=True)
def own_register(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give each test a register of its own."""
    parts.known_sensors()  # loads what is installed
    monkeypatch.setattr(parts, "_SENSORS", dict(parts._SENSORS))
    monkeypatch.setattr(parts, "_PARTS", dict(parts._PARTS))
    monkeypatch.setattr(parts, "_FILES", list(parts._FILES))


def test_the_scenarios_own_parts_given_by_hand_fly_the_same_flight() -> None:
    plain = od.fly("imu_uwb", seed=4, **HOVER)
    given = od.fly(
        "imu_uwb",
        seed=4,
        settle=0.0,
        estimator=IntermittentEstimator,
        servo=lambda scenario: make_lq_servo(scenario.servo, scenario.vehicle, scenario.h),
        planner=lambda scenario: PiecewisePolynomial.ZeroOrderHold([0.0, 0.5], np.tile([[0.0], [0.0], [1.5]], 2)),
    )
    for name in ("truth", "estimate", "covariance", "measurement", "control", "reference"):
        np.testing.assert_array_equal(given.data[name].values, plain.data[name].values)


def test_registered_parts_are_named_in_a_scenario_file_and_travel_with_the_flight(tmp_path: Path) -> None:
    class Mine(od.Frozen):
        """An estimator's settings."""

        kind: Literal["mine"]
        gain: float = 0.5

    class Line(od.Frozen):
        """A planner's settings."""

        kind: Literal["line"]
        speed: float

    class Soft(LqServo):
        """A servo's settings."""

        kind: Literal["soft"]  # type: ignore[assignment]

    made = []

    def estimator(scenario: od.Belief, xbar_0: np.ndarray) -> IntermittentEstimator:
        made.append(scenario.estimator.gain)
        settings = od.load_scenario("imu_uwb").estimator
        return IntermittentEstimator(scenario.model_copy(update={"estimator": settings}), xbar_0)

    def planner(scenario: od.Belief) -> PiecewisePolynomial:
        ends = np.array([[0.0, scenario.planner.speed], [0.0, 0.0], [1.5, 1.5]])
        return PiecewisePolynomial.FirstOrderHold([0.0, 1.0], ends)

    od.register_estimator("mine", Mine, estimator)
    od.register_planner("line", Line, planner)
    od.register_servo("soft", Soft, lambda scenario: make_lq_servo(scenario.servo, scenario.vehicle, scenario.h))
    file = tmp_path / "own.yaml"
    file.write_text(
        "base: imu_uwb\nsettle: 0.0\nestimator: {kind: mine, gain: 0.25}\nplanner: {kind: line, speed: 0.4}\n"
        "servo: {kind: soft}\n"
    )
    flight = od.fly(file, seed=1)
    assert made == [0.25]
    np.testing.assert_allclose(flight.data["reference"].values[-1], [0.4, 0.0, 1.5], atol=1e-12)
    again = od.Flight.load(flight.to_netcdf(tmp_path / "own.nc"))
    assert again.scenario.estimator.gain == 0.25
    with pytest.raises(od.InputError, match=r"estimator\.gain: 'x'"):
        od.load_scenario(file, estimator__gain="x")
    with pytest.raises(od.InputError, match=r"estimator\.kind: 'your' is not one of 'intermittent', 'mine'"):
        od.load_scenario("imu_uwb", estimator={"kind": "your"})


def test_a_part_that_does_not_fit_is_refused_with_what_is_wrong() -> None:
    def without(name: str) -> type[LeafSystem]:
        class Part(LeafSystem):
            def __init__(self, *_: object):
                super().__init__()
                self.set_name("part")
                for port, size in (("estimate", 15), ("reference", 9)):
                    if port != name:
                        self.DeclareVectorInputPort(port, size)
                self.DeclareVectorOutputPort("out" if name == "control" else "control", 4, lambda _, out: out.SetZero())

        return Part

    for missing, kind in (("estimate", "input"), ("reference", "input"), ("control", "output")):
        with pytest.raises(od.InputError, match=f"servo: part: has no {kind} '{missing}', only "):
            od.fly("imu_uwb", servo=without(missing), **HOVER)
    with pytest.raises(od.InputError, match=r"estimator: .*: has no output 'estimate', only y0"):
        od.fly("imu_uwb", estimator=lambda scenario, xbar_0: ConstantVectorSource(np.zeros(12)), **HOVER)
    with pytest.raises(od.InputError, match="planner: returns LinearSystem: must be a Trajectory of 3 rows"):
        od.fly("imu_uwb", planner=lambda scenario: LinearSystem(np.eye(1), np.eye(1), np.eye(1), np.eye(1)))

    class Wide(LeafSystem):
        def __init__(self, *_: object):
            super().__init__()
            self.set_name("wide")
            self.DeclareVectorOutputPort("estimate", 13, lambda _, out: out.SetZero())
            self.DeclareVectorOutputPort("covariance", 169, lambda _, out: out.SetZero())

    with pytest.raises(od.InputError, match=r"wide: estimate \(13\) and covariance \(169\): must be 12 or 15"):
        od.fly("imu_uwb", estimator=Wide, **HOVER)

    class Sees(LeafSystem):
        def __init__(self, *_: object):
            super().__init__()
            self.DeclareVectorInputPort("lidar", 5)
            self.DeclareVectorOutputPort("estimate", 12, lambda _, out: out.SetZero())
            self.DeclareVectorOutputPort("covariance", 144, lambda _, out: out.SetZero())

    with pytest.raises(od.InputError, match="onboard: wants 'lidar', the world sends only state, uwb, imu"):
        od.fly("imu_uwb", estimator=Sees, **HOVER)


def test_a_sensor_is_refused_where_its_name_or_its_settings_do_not_fit() -> None:
    def sensor(name: str, settings: type[od.Frozen]) -> od.Sensor:
        return od.Sensor(name, settings, (od.row("z_own", z=1.0),), make_world=lambda s, r: None, sd=lambda s, r, x: x)

    for name in ("uwb", "detections", "two words", ""):
        with pytest.raises(od.InputError, match="must be a plain word that is no built-in signal's"):
            od.register_sensor(sensor(name, od.SensorSettings))
    with pytest.raises(od.InputError, match="own: its settings need a field 'link: Link'"):
        od.register_sensor(sensor("own", od.Frozen))
    with pytest.raises(od.InputError, match="mine: its settings need a field 'kind'"):
        od.register_servo("mine", od.Frozen, lambda scenario: None)
    with pytest.raises(ValueError, match=r"z_own: sees \['height'\]: must be among x, y, z"):
        od.row("z_own", height=1.0)


@pytest.mark.parametrize(
    ("text", "says"), [("1 / 0\n", "ZeroDivisionError"), ("import nothing_like_it\n", "ModuleNot")]
)
def test_a_plugin_that_fails_is_named_with_its_error(text: str, says: str, tmp_path: Path) -> None:
    file = tmp_path / "plugin.py"
    file.write_text(text)
    with pytest.raises(od.InputError, match=rf"--plugin .*plugin\.py: {says}"):
        parts.load_plugin(file)
    with pytest.raises(od.InputError, match=r"must be a Python file"):
        parts.load_plugin(tmp_path / "none.py")
