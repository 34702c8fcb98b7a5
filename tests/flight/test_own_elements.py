"""Estimators, servos, planners and faults of one's own that are elements, flown by the engine."""

from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
import pytest
from module_of import module_of
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from sameness import assert_same_bits

import ortilo_drake as od
from ortilo_drake.diagrams.wiring.whole import boxes_of, why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import summary
from ortilo_drake.loop.wiring import Wire, Wiring
from ortilo_drake.model.equations import euler_rates, rotation_matrix
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import LqServo, with_seed

pytestmark = pytest.mark.usefixtures("own_register")
EXAMPLES = Path(__file__).parents[2] / "examples"
SHORT = {"planner": {"kind": "waypoints", "points": [[0.0, 0.0, 1.5], [1.2, 0.6, 1.5]]}}


def example(name: str) -> ModuleType:
    return module_of(EXAMPLES / f"{name}.py", "example_")


class Own(od.Frozen):
    """Settings of a servo, a planner or an estimator."""

    kind: Literal["own"]
    duration: float = 2.0


def lq_out(
    n: Any, estimate: np.ndarray, reference: np.ndarray, force: np.ndarray, L: np.ndarray, out: np.ndarray
) -> None:
    """Say u = [m g, 0, 0, 0] + u_ff - L [xhat - x_ref; i] at yaw 0, the paper's servo in its error form."""
    a = np.zeros(3)
    for i in range(3):
        a[i] = reference[6 + i] - force[i] / n.mass
    wanted = np.zeros(15)
    wanted[:3], wanted[6:9] = reference[:3], reference[3:6]
    wanted[3], wanted[4] = -a[1] / 9.81, a[0] / 9.81
    for i in range(4):
        out[i] = n.mass * 9.81 + n.mass * a[2] if i == 0 else 0.0
        for j in range(15):
            out[i] -= L[i, j] * (estimate[j] - wanted[j])


def lq_servo(belief: od.Belief) -> od.Box:
    L = servo_gain(belief.vehicle, LqServo().weights, belief.h, 0.0)
    return od.box(4, lq_out, numbers={"mass": belief.vehicle.mass}, tables={"L": L})


@pytest.mark.long
@pytest.mark.parametrize("name", ["nominal_imu_uwb", pytest.param("imu_uwb", marks=pytest.mark.long)])
def test_an_lq_servo_of_ones_own_flies_the_built_in_ones_flight_bit_for_bit(name: str) -> None:
    """Its integral starts at 0, as the built-in servo's does in the error form; in imu_uwb a force is estimated."""
    od.register_servo("own", Own, box=lq_servo)
    own, built_in = (Engine(od.load_scenario(name, **SHORT, **its)) for its in ({"servo": {"kind": "own"}}, {}))
    for seed in (1, 2):
        one, other = own.fly(seed), built_in.fly(seed)
        for signal in map(str, one.data_vars):
            np.testing.assert_array_equal(one[signal].values, other[signal].values)


@pytest.mark.long
def test_a_servo_hears_its_last_control_and_the_messages_and_silence_of_what_does_not_fly() -> None:
    def out(heard: np.ndarray, out: np.ndarray) -> None:
        for i in range(4):
            out[i] = heard[i]

    def step(k: int, control: np.ndarray, uwb: np.ndarray, camera: np.ndarray, heard: np.ndarray) -> None:
        heard[0] = 0.9 * control[0] + 2.6
        heard[1], heard[2], heard[3] = 1e-6 * uwb[1], camera[0] + camera[1], 1e-9 * k

    start = {"heard": np.array([26.0, 0.0, 0.0, 0.0])}
    od.register_servo("own", Own, box=lambda belief: od.box(4, out, step, state=start))
    scenario = od.load_scenario(
        "nominal_imu_uwb", servo={"kind": "own"}, planner={"kind": "hover", "duration": 0.5}, settle=0.0
    )
    u = Engine(scenario).fly(0)["control"].values
    for k in range(len(u) - 1):
        stamp = k * scenario.h if k % scenario.every("uwb") == 0 else 0.0
        np.testing.assert_allclose(u[k + 1], [0.9 * u[k, 0] + 2.6, 1e-6 * stamp, 0.0, 1e-9 * k], rtol=1e-14)


@pytest.mark.long
class Lent(Own):
    """Settings of a servo that is lent the true velocities."""

    velocities: Literal["truth"] = "truth"


def reads_both(estimate: np.ndarray, covariance: np.ndarray, out: np.ndarray) -> None:
    out[0] = estimate[14] + covariance[224]


def test_a_servo_of_ones_own_may_be_lent_the_truth_and_reads_no_number_that_is_not_there() -> None:
    od.register_servo("own", Lent, box=lambda belief: od.box(4, reads_both))
    wiring = Wiring(boxes_of(od.load_scenario("nominal_imu_uwb", servo={"kind": "own"}, **SHORT), 3))
    assert wiring.wires["servo", "estimate"] == Wire("true_velocity", 0, 15)
    assert wiring.wires["servo", "covariance"].size == 225
    split = wiring.wires["servo", "covariance"].box
    assert wiring.wires[split, "belief"].size == 240


def test_a_servo_of_ones_own_that_acts_ahead_reads_the_state_ahead_and_the_covariance_of_the_tick() -> None:
    od.register_servo("own", Own, box=lambda belief: od.box(4, reads_both))
    ahead = {"servo": "predicted", "delay": 0.05}
    wiring = Wiring(boxes_of(od.load_scenario("nominal_imu_uwb", servo={"kind": "own"}, commands=ahead, **SHORT), 3))
    assert wiring.wires["servo", "estimate"] == Wire("state_ahead", 0, 15)
    split = wiring.wires["servo", "covariance"].box
    assert wiring.wires[split, "belief"].size == 240


def test_a_cascade_flies_to_the_goal() -> None:
    flight = example("cascade_servo").main(**SHORT)
    assert flight.attrs["lost"] == "null"
    np.testing.assert_allclose(flight["truth"].values[-1, :3], [1.2, 0.6, 1.5], atol=0.3)


@pytest.mark.long
def test_a_planners_circle_is_its_closed_form_and_is_what_the_figures_measure_by() -> None:
    module = example("circle_planner")
    scenario = od.load_scenario("nominal_imu_uwb", planner={"kind": "circle", "duration": 4.0}, settle=1.0)
    engine = Engine(scenario)
    flight = engine.fly(3)
    assert flight.sizes["tick"] == 151  # 5 s at 30 Hz, and the first
    z = 0.8 * np.exp(0.5j * np.arange(151) * scenario.h)
    for name, value in (("", 8.0 + 1.0j + z), ("_velocity", 0.5j * z), ("_acceleration", -0.25 * z)):
        said = flight[f"reference{name}"].values
        np.testing.assert_allclose(said[:, 0] + 1j * said[:, 1], value, atol=1e-14)
    np.testing.assert_array_equal(flight["truth"].values[0, :3], [8.8, 1.0, 1.5])
    figures = dict(zip(engine.columns, engine.figures([3])[0], strict=True))
    away = np.linalg.norm(flight["truth"].values[:, :3] - flight["reference"].values, axis=1)
    assert figures["max_reference_distance"] == pytest.approx(away.max(), rel=1e-12)
    assert figures["max_path_distance"] == pytest.approx(summary(flight).max_path_distance, rel=1e-9)
    np.testing.assert_allclose(engine.distances(np.full((1, 151), 3))[0], away, rtol=1e-12)
    assert module.main(planner={"kind": "circle", "duration": 1.0}).attrs["lost"] == "null"


@pytest.mark.long
def test_a_planner_may_follow_the_estimate_and_the_messages() -> None:
    def out(n: Any, k: int, center: np.ndarray, out: np.ndarray) -> None:
        out[:] = 0.0
        out[0], out[1], out[2] = center[0] + 0.2, center[1], 1.5

    def step(n: Any, uwb: np.ndarray, estimate: np.ndarray, center: np.ndarray) -> None:
        if uwb[0] != 0.0:
            for i in range(2):
                center[i] += 0.01 * (estimate[i] - center[i])

    start = {"center": np.array([-0.2, 0.0])}
    od.register_planner("own", Own, box=lambda belief: od.box(9, out, step, state=start))
    scenario = od.load_scenario("nominal_imu_uwb", planner={"kind": "own"}, settle=0.0)
    flight = Engine(scenario).fly(0)
    np.testing.assert_array_equal(flight["truth"].values[0, :3], [0.0, 0.0, 1.5])
    center = np.zeros((flight.sizes["tick"], 2))
    center[0] = -0.2, 0.0
    for k in range(len(center) - 1):
        heard = k % scenario.every("uwb") == 0
        center[k + 1] = center[k] + 0.01 * heard * (flight["estimate"].values[k, :2] - center[k])
    np.testing.assert_allclose(flight["reference"].values[:, :2], center + [0.2, 0.0], atol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("link", ["uwb.link.delay=0", "uwb.link.random_delay=2"])
def test_a_fault_that_adds_a_length_to_all_ranges_is_the_built_in_jump_of_the_clock(link: str) -> None:
    example("longer_ranges")
    when = {"start": 1.0, "end": 2.5, "by": 0.4}
    own, built_in = (
        Engine(od.load_scenario("nominal_imu_uwb", link, faults=[when | its], **SHORT))
        for its in ({"kind": "longer_ranges", "rate": 0.0}, {"kind": "clock_jump"})
    )
    one, other = own.fly(4), built_in.fly(4)
    for signal in map(str, one.data_vars):
        np.testing.assert_array_equal(one[signal].values, other[signal].values)


@pytest.mark.long
def test_longer_ranges_make_the_estimate_err(capsys: pytest.CaptureFixture[str]) -> None:
    example("longer_ranges").main(**SHORT)
    without, with_fault = (float(line.split()[-2]) for line in capsys.readouterr().out.splitlines())
    assert with_fault > 1.5 * without


class FollowerSystem(LeafSystem):
    """examples/range_follower.py for Drake, in NumPy."""

    def __init__(self, belief: od.Belief, xbar_0: np.ndarray):
        super().__init__()
        self._h, self._its = belief.h, belief.estimator
        self._anchors = belief.load_room().anchor_positions
        self._uwb = self.DeclareVectorInputPort("uwb", 2 + 2 * len(self._anchors))
        self._imu = self.DeclareVectorInputPort("imu", 11)
        self.DeclareStateOutputPort("estimate", self.DeclareDiscreteState(xbar_0[:12]))
        self.DeclareVectorOutputPort("covariance", 144, self._calc_covariance, {self.nothing_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(belief.h, 0.0, self._update)

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._its.sd**2 * np.eye(12).ravel())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x = context.get_discrete_state_vector().CopyToVector()
        uwb, imu = self._uwb.Eval(context), self._imu.Eval(context)
        ranges, there = np.split(uwb[2:], 2)
        for anchor, r, is_there in zip(self._anchors, ranges, there, strict=True):
            if uwb[0] and is_there:
                away = x[:3] - anchor
                correction = self._its.gain * (r / np.linalg.norm(away) - 1.0) * away
                x[:3] += correction
                x[6:9] += 0.3 * correction
        a = rotation_matrix(imu[2:5]) @ imu[8:11] - [0.0, 0.0, 9.81]
        rates = np.array(euler_rates(imu[2:5], imu[5:8]))
        values.set_value(np.concatenate([x[:3] + self._h * x[6:9], imu[2:5], x[6:9] + self._h * a, rates]))


@pytest.mark.long
def test_an_estimator_that_is_an_element_flies_drakes_flight() -> None:
    module = example("range_follower")
    link = "uwb.link={rate: 10, random_delay: 1}"
    scenario = od.load_scenario("imu_uwb", link, estimator={"kind": "range_follower"}, **SHORT)
    assert why_not(scenario) is None
    flights = [Engine(scenario).fly(seed) for seed in (1, 2)]
    od.register_estimator("range_follower", module.RangeFollower, FollowerSystem)
    assert why_not(scenario) == "estimator.kind: range_follower: has no compiled form"
    with pytest.raises(od.InputError, match="Drake flies it"):
        Engine(scenario)
    for seed, flight in zip((1, 2), flights, strict=True):
        assert_same_bits(fly(with_seed(scenario, seed)), flight, 1e-9)  # the System is NumPy's, which adds otherwise
        e = flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]
        assert 0.0 < np.sqrt(np.mean(e**2)) < 0.5


def wrong_out(state: np.ndarray, out: np.ndarray) -> None:
    out[0] = state[0]


def early_out(control: np.ndarray, out: np.ndarray) -> None:
    out[0] = control[0]


def early_uwb(uwb: np.ndarray, out: np.ndarray) -> None:
    out[0] = uwb[0]


@pytest.mark.parametrize(
    ("role", "size", "out", "said"),
    [
        ("servo", 4, wrong_out, r"servo\.kind: own: out reads 'state', must be one of uwb, imu, .*force"),
        ("servo", 4, early_out, r"servo\.kind: own: out reads 'control', must be one of"),
        ("servo", 3, early_uwb, r"servo\.kind: own: says 3 numbers, must say 4"),
        ("planner", 9, early_uwb, r"planner: out reads 'uwb', must be one of estimate, covariance, belief, force"),
        ("estimator", 156, early_out, r"estimator\.kind: own: out reads 'control', must be one of uwb"),
        ("estimator", 12, early_uwb, r"estimator\.kind: own: says 12 numbers, must say 240 or 156"),
    ],
)
def test_a_part_that_does_not_fit_is_refused(role: str, size: int, out: Any, said: str) -> None:
    box = od.box(size, out)
    getattr(od, f"register_{role}")("own", Own, box=lambda *_: box)
    scenario = od.load_scenario("nominal_imu_uwb", **(SHORT | {role: {"kind": "own"}}))
    with pytest.raises(od.InputError, match=said):
        Engine(scenario)


def beyond(out: np.ndarray) -> None:
    out[7] = 1.0


def misspelt(n: Any, estimate: np.ndarray, out: np.ndarray) -> None:
    out[0] = n.gian * estimate[2]


def unknown(out: np.ndarray) -> None:
    out[0] = thrust  # type: ignore[name-defined]  # noqa: F821


def keeps(out: np.ndarray) -> None:
    out[:] = 0.0


def beyond_its_state(estimate: np.ndarray, kept: np.ndarray) -> None:
    kept[2] = estimate[15]


@pytest.mark.parametrize(
    ("out", "step", "said"),
    [
        (beyond, None, "out: index 7 is out of bounds for axis 0 with size 4"),
        (misspelt, None, "out: n has no 'gian'"),
        (unknown, None, "out: name 'thrust' is not defined"),
        (keeps, beyond_its_state, "step: index 15 is out of bounds for axis 0 with size 15"),
    ],
)
def test_a_slip_in_a_function_is_told_before_it_is_compiled(out: Any, step: Any, said: str) -> None:
    """numba writes beyond an array without a word, and answers an unknown name with a page."""
    made = od.box(4, out, step, numbers={"gain": 2.0}, state={"kept": np.zeros(2)})
    od.register_servo("own", Own, box=lambda belief: made)
    with pytest.raises(od.InputError, match=rf"^servo\.kind: own: {said}$"):
        Engine(od.load_scenario("nominal_imu_uwb", servo={"kind": "own"}, **SHORT))


class OfAnyKind(od.Frozen):
    """Settings whose kind is no word."""

    kind: str


def test_a_kind_that_is_no_word_is_refused_where_it_is_registered() -> None:
    said = r"^servo: own: the field 'kind' of its settings must be Literal\['own'\]$"
    for settings in (OfAnyKind, Fails):
        with pytest.raises(od.InputError, match=said):
            od.register_servo("own", settings, box=lambda belief: od.box(4, keeps))


class Fails(od.Fault):
    """A fault's settings."""

    kind: Literal["fails"]
    sensor: str = "uwb"


def test_a_fault_that_does_not_fit_is_refused() -> None:
    def load(**changes: Any) -> od.Scenario:
        return od.load_scenario("nominal_imu_uwb", faults=[{"kind": "fails", "start": 1.0} | changes], **SHORT)

    with pytest.raises(od.InputError, match=r"faults\.0\.kind: 'fails' is not one of"):
        load()
    od.register_fault("fails", Fails, lambda its, size, h: od.box(size - 1, wrong_out))
    with pytest.raises(od.InputError, match=r"faults\.0: fails: says \d+ numbers, must be \d+, the message's"):
        Engine(load())
    od.register_fault("fails", Fails, lambda its, size, h: od.box(size, early_out))
    with pytest.raises(od.InputError, match=r"faults\.0: fails: reads 'control', must be one of message, state"):
        Engine(load())
    with pytest.raises(od.InputError, match=r"faults\.0: fails: concerns camera, must be in sensors"):
        load(sensor="camera")
    with pytest.raises(od.InputError, match="fault: own: its settings must be a Fault with a field 'sensor'"):
        od.register_fault("own", Own, lambda its, size, h: od.box(size, early_out))  # type: ignore[arg-type]
    with pytest.raises(
        od.InputError, match="servo: own: needs make, which makes a System, or box, which makes an element"
    ):
        od.register_servo("own", Own)


def test_a_sensor_and_a_fault_of_ones_own_fly_in_one_scenario() -> None:
    """The model of such a scenario is made once more of its own data: it kept the fault and forgot the sensor."""
    for name in ("barometer", "longer_ranges"):
        example(name)
    faults = [{"kind": "longer_ranges", "start": 1.0}]
    scenario = od.load_scenario("nominal_imu_uwb", sensors=["uwb", "imu", "barometer"], faults=faults, **SHORT)
    for again in (scenario, od.Scenario.model_validate_json(scenario.model_dump_json())):
        assert again.sensors == ("uwb", "imu", "barometer")
        assert [fault.kind for fault in again.faults] == ["longer_ranges"]
