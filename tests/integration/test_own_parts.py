"""The contracts: parts given by hand, registered and named in a scenario, and refused where they do not fit."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import xarray as xr
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LinearSystem
from pydrake.trajectories import PiecewisePolynomial

import ortilo_drake as od
from ortilo_drake.diagrams.estimator import Estimator
from ortilo_drake.diagrams.single_parts import make_lq_servo
from ortilo_drake.flight.flight import fly, scenario_of
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.hil.goals.goals import goal_settings
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.mcap_records import read_logged
from ortilo_drake.interop.log.reader import log_file, read_log
from ortilo_drake.interop.log.replay import replay_log
from ortilo_drake.interop.ros.ros_types import from_cdr
from ortilo_drake.model import parts
from ortilo_drake.scenario import GcsPlanner, LqServo
from ortilo_drake.scenario.scenario import FORMAT
from ortilo_drake.studies.tube.tube import nominal_flight, planned_reference
from ortilo_drake.views.page.flight_page import flight_page

pytestmark = pytest.mark.usefixtures("own_register")
HOVER = {"planner": {"kind": "hover", "duration": 0.5}, "settle": 0.0}


@pytest.mark.long
def test_the_scenarios_own_parts_given_by_hand_fly_the_same_flight() -> None:
    plain = od.fly("nominal_imu_uwb", seed=4, **HOVER)
    given = od.fly(
        "nominal_imu_uwb",
        seed=4,
        settle=0.0,
        estimator=Estimator,
        servo=make_lq_servo,
        planner=lambda scenario: PiecewisePolynomial.ZeroOrderHold([0.0, 0.5], np.tile([[0.0], [0.0], [1.5]], 2)),
    )
    for name in ("truth", "estimate", "covariance", "measurement", "control", "reference"):
        np.testing.assert_array_equal(given.data[name].values, plain.data[name].values)


@pytest.mark.long
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

    def estimator(scenario: od.Belief, xbar_0: np.ndarray) -> Estimator:
        made.append(scenario.estimator.gain)
        settings = od.load_scenario("nominal_imu_uwb").estimator
        return Estimator(scenario.model_copy(update={"estimator": settings}), xbar_0)

    def planner(scenario: od.Belief) -> PiecewisePolynomial:
        ends = np.array([[0.0, scenario.planner.speed], [0.0, 0.0], [1.5, 1.5]])
        return PiecewisePolynomial.FirstOrderHold([0.0, 1.0], ends)

    od.register_estimator("mine", Mine, estimator)
    od.register_planner("line", Line, planner)
    od.register_servo("soft", Soft, make_lq_servo)
    file = tmp_path / "own.yaml"
    file.write_text(
        "base: nominal_imu_uwb\nsettle: 0.0\nestimator: {kind: mine, gain: 0.25}\nplanner: {kind: line, speed: 0.4}\n"
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
        od.load_scenario("nominal_imu_uwb", estimator={"kind": "your"})


class Circle(LeafSystem):
    """A planner: circles at one radian a second about where it started, and drifts to where the vehicle believes it is.

    State (discrete): the centre (2).
    """

    def __init__(self, scenario: od.Scenario, size: int = 9, takes: int = 15):
        super().__init__()
        self.set_name("planner")
        self._estimate = self.DeclareVectorInputPort("estimate", takes)
        self._uwb = self.DeclareVectorInputPort("uwb", 2 + 2 * len(scenario.load_room().anchor_positions))
        self._centre = self.DeclareDiscreteState([-0.2, 0.0])
        self.DeclareVectorOutputPort("reference", size, self._calc, {self.time_ticket(), self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(scenario.h, 0.0, self._update)

    def _calc(self, context: Context, output: BasicVector) -> None:
        e = 0.2 * np.exp(1j * context.get_time())
        x, y = context.get_discrete_state_vector().value()
        output.SetFromVector(
            [x + e.real, y + e.imag, 1.5, -e.imag, e.real, 0.0, -e.real, -e.imag, 0.0][: output.size()]
        )

    def _update(self, context: Context, values: DiscreteValues) -> None:
        c, p = context.get_discrete_state_vector().value(), self._estimate.Eval(context)[:2]
        values.set_value(self._centre, c + 0.01 * (p - c) * self._uwb.Eval(context)[0])


class CirclePlanner(od.Frozen):
    """A planner's settings."""

    kind: Literal["circle"]
    duration: float = 1.0


def test_a_planner_may_be_a_system_that_sees_the_estimate_and_messages() -> None:
    data = od.fly(od.load_scenario("nominal_imu_uwb", **HOVER), planner=Circle, seed=2).data
    assert data.sizes["tick"] == 16  # as long as the scenario's own path
    p, t = data["estimate"].values[:, :2], data["time"].values
    centre = np.zeros((16, 2))
    centre[0] = -0.2, 0.0
    for k in range(15):  # of 10 Hz: a message in every third tick
        centre[k + 1] = centre[k] + 0.01 * (p[k] - centre[k]) * (k % 3 == 0)
    around = 0.2 * np.column_stack((np.cos(t), np.sin(t)))
    np.testing.assert_allclose(data["reference"].values[:, :2], centre + around, atol=1e-15)
    np.testing.assert_array_equal(data["truth"].values[0, :3], [0.0, 0.0, 1.5])
    np.testing.assert_allclose(data["reference_acceleration"].values[:, :2], -around, atol=1e-15)


@pytest.mark.long
def test_a_registered_planner_that_is_a_system_flies_in_halves_logs_and_replays(tmp_path: Path) -> None:
    od.register_planner("circle", CirclePlanner, Circle)
    scenario = od.load_scenario("nominal_imu_uwb", planner={"kind": "circle"}, settle=0.0)
    alone = fly(scenario)
    del alone.attrs["real_time_factor"]
    assert alone.sizes["tick"] == 31
    assert xr.Dataset.identical(fly_lockstep(scenario, in_this_process(scenario)), alone)
    fly_logged(scenario, tmp_path / "log")
    assert xr.Dataset.identical(read_log(tmp_path / "log").drop_attrs(), alone.drop_attrs())
    assert replay_log(tmp_path / "log").identical
    assert "<canvas" in flight_page(alone) or "meshcat" in flight_page(alone)
    with pytest.raises(od.InputError, match=r"planner\.kind: circle: is a System: this needs a path planned"):
        nominal_flight(scenario)
    with pytest.raises(od.InputError, match="planner: is a System: cannot take a new path in flight"):
        OnboardHalf(scenario).fly_path(PiecewisePolynomial.ZeroOrderHold([0.0, 1.0], np.zeros((3, 2))))


def test_a_registered_planner_that_is_a_system_must_say_how_long_it_flies() -> None:
    class Endless(od.Frozen):
        """A planner's settings."""

        kind: Literal["endless"]

    od.register_planner("endless", Endless, Circle)
    with pytest.raises(od.InputError, match=r"its settings need a field 'duration' \[s\], greater than 0"):
        od.fly("nominal_imu_uwb", planner={"kind": "endless"})
    od.register_planner("circle", CirclePlanner, Circle)
    with pytest.raises(od.InputError, match=r"its settings need a field 'duration' \[s\], greater than 0"):
        od.fly("nominal_imu_uwb", planner={"kind": "circle", "duration": 0.0})


def test_a_registered_path_is_drawn_logged_and_bounded_by_the_tube(tmp_path: Path) -> None:
    class Line(od.Frozen):
        """A planner's settings."""

        kind: Literal["line"]

    def line(scenario: od.Scenario) -> PiecewisePolynomial:
        return PiecewisePolynomial.FirstOrderHold([0.0, 1.0], [[0.0, 0.3], [0.0, 0.1], [1.5, 1.5]])

    od.register_planner("line", Line, line)
    scenario = od.load_scenario("nominal_imu_uwb", planner={"kind": "line"}, settle=0.0)
    flight = fly_logged(scenario, tmp_path / "log")
    path = list(read_logged(log_file(tmp_path / "log"), lambda topic: topic == "/reference/path"))
    assert len(path) == 1
    poses = from_cdr("nav_msgs/msg/Path", path[0].data).poses
    end = poses[-1].pose.position
    np.testing.assert_allclose([end.x, end.y, end.z], [0.3, 0.1, 1.5], atol=1e-12)
    _, reference = planned_reference(scenario)
    np.testing.assert_allclose(reference[:, :3], flight["reference"].values, atol=1e-12)
    assert goal_settings(scenario) == GcsPlanner()


def test_a_flights_scenario_is_read_by_the_parts_of_now() -> None:
    class Line(od.Frozen):
        """A planner's settings."""

        kind: Literal["line"]
        speed: float

    class Curve(od.Frozen):
        """Another's, of the same name."""

        kind: Literal["line"]
        speed: float

    still = PiecewisePolynomial.ZeroOrderHold([0.0, 1.0], np.tile([[0.0], [0.0], [1.5]], 2))
    od.register_planner("line", Line, lambda scenario: still)
    text = od.load_scenario("nominal_imu_uwb", planner={"kind": "line", "speed": 1.0}).model_dump_json()
    flight = xr.Dataset(attrs={"scenario": text, "format": FORMAT})
    assert scenario_of(flight) is scenario_of(flight)  # parsed once
    assert type(scenario_of(flight).planner) is Line
    od.register_planner("line", Curve, lambda scenario: still)
    assert type(scenario_of(flight).planner) is Curve
    del parts._PARTS["planner", "line"]
    with pytest.raises(od.InputError, match="line"):
        scenario_of(flight)


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
            od.fly("nominal_imu_uwb", servo=without(missing), **HOVER)
    with pytest.raises(od.InputError, match=r"estimator: .*: has no output 'estimate', only y0"):
        od.fly("nominal_imu_uwb", estimator=lambda scenario, xbar_0: ConstantVectorSource(np.zeros(12)), **HOVER)
    for planner in (
        lambda scenario: LinearSystem(np.eye(1), np.eye(1), np.eye(1), np.eye(1)),
        lambda scenario: PiecewisePolynomial.ZeroOrderHold([0.0, 0.5], np.zeros((2, 2))),
        lambda scenario: Circle(scenario, size=6),
    ):
        with pytest.raises(od.InputError, match=r"planner: returns \w+: must be a Trajectory of 3 rows, or a System"):
            od.fly("nominal_imu_uwb", planner=planner)
    with pytest.raises(od.InputError, match="planner: planner: takes 'estimate' of 12 numbers, must be 15"):
        od.fly("nominal_imu_uwb", planner=lambda scenario: Circle(scenario, takes=12))

    class Wide(LeafSystem):
        def __init__(self, *_: object):
            super().__init__()
            self.set_name("wide")
            self.DeclareVectorOutputPort("estimate", 13, lambda _, out: out.SetZero())
            self.DeclareVectorOutputPort("covariance", 169, lambda _, out: out.SetZero())

    with pytest.raises(od.InputError, match=r"wide: estimate \(13\) and covariance \(169\): must be 12 or 15"):
        od.fly("nominal_imu_uwb", estimator=Wide, **HOVER)

    class Sees(LeafSystem):
        def __init__(self, message: str, size: int):
            super().__init__()
            self.DeclareVectorInputPort(message, size)
            self.DeclareVectorOutputPort("estimate", 12, lambda _, out: out.SetZero())
            self.DeclareVectorOutputPort("covariance", 144, lambda _, out: out.SetZero())

    with pytest.raises(od.InputError, match="onboard: wants 'lidar', the world sends only uwb, imu"):
        od.fly("nominal_imu_uwb", estimator=lambda scenario, xbar_0: Sees("lidar", 5), **HOVER)
    with pytest.raises(od.InputError, match="onboard: wants 'state', the world sends only uwb, imu"):  # the truth
        od.fly("nominal_imu_uwb", estimator=lambda scenario, xbar_0: Sees("state", 12), **HOVER)
    with pytest.raises(od.InputError, match="takes 'imu' of 11 numbers, must be 90"):
        od.fly("nominal_imu_uwb", estimator=lambda scenario, xbar_0: Sees("imu", 11), imu__link__rate=240, **HOVER)


def test_a_sensor_is_refused_where_its_name_or_its_settings_do_not_fit() -> None:
    def sensor(name: str, settings: type[od.Frozen]) -> od.Sensor:
        return od.Sensor(name, settings, (od.row("z_own", z=1.0),), make_world=lambda s, r: None, sd=lambda s, r, x: x)

    for name in ("uwb", "detections", "two words", ""):
        with pytest.raises(od.InputError, match="must be a plain word, and no name of a built-in signal"):
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
