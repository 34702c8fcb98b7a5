"""Filters that estimate the force, in flight: what they learn, and that checkpoints take them."""

import numpy as np
import pytest
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.flight import fly, make_simulator
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.loop.hover_loop import hover_loop
from ortilo_drake.studies.tube.tube import predict_tube
from ortilo_drake.studies.tuning.noise_settings import noise_model

HOVER = "planner={kind: hover, duration: 9.0}"


def hovering(force: str, *settings: str) -> Scenario:
    return load_scenario("nominal_imu_uwb", (HOVER, "settle=0", f"estimator.force={force}", *settings))


@pytest.mark.family("measured")
@pytest.mark.parametrize(
    ("force", "settings"),
    [("thrust", ()), ("measured", ()), ("measured", ("imu.link.rate=240",))],
    ids=["thrust", "measured", "faster"],
)
def test_a_heavier_vehicle_is_a_force_that_the_filter_learns_and_the_servo_counters(
    force: str, settings: tuple[str, ...]
) -> None:
    level = 0.01  # the imu is turned about x and y: its angles, and gravity in its specific force
    turned = f"truth.imu={{level: [{level}, {level}], specific_force: [{-9.81 * level}, {9.81 * level}, 0.0]}}"
    scenario = hovering(force, "truth.vehicle.mass_factor=1.1", turned, *settings)
    diagram = make_closed_loop(scenario, fused=True)
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(8.0)
    context, onboard = simulator.get_context(), diagram.GetSubsystemByName("onboard")
    its = onboard.GetMyContextFromRoot(context)
    value, sd = np.split(onboard.GetOutputPort("extra").Eval(its), 2)
    # d_z = f_T (m / m_true - 1) at hover; roll and pitch that read too large look like a force of m g each.
    weight = scenario.vehicle.mass * 9.81
    expected = np.array([-weight * level, weight * level, -0.1 * weight])
    np.testing.assert_allclose(value[:3], expected, rtol=0.0, atol=0.15)
    assert np.all(np.abs(value[:3] - expected) < 4.0 * sd[:3])
    assert np.all(sd[:3] < 0.1)
    np.testing.assert_array_equal(onboard.GetOutputPort("force").Eval(its), value[:3])
    if force == "measured":  # the whole imu is turned: its specific force fits its angles, and has no bias beside
        assert np.all(np.abs(value[6:9]) < 4.0 * sd[6:9])
        assert np.all(sd[6:9] < 0.1)
    state = diagram.GetOutputPort("state").Eval(context)
    assert abs(state[2] - 1.5) < 0.15


@pytest.mark.long
def test_a_filter_that_replays_is_the_same_where_nothing_is_late() -> None:
    kept = [fly(hovering("measured", f"estimator.delay={delay}"))["estimate"].values for delay in ("ignore", "replay")]
    np.testing.assert_array_equal(*kept)


def test_a_checkpoint_holds_the_force() -> None:
    scenario = hovering("measured")
    world, old, new = WorldHalf(scenario), OnboardHalf(scenario), OnboardHalf(scenario)
    for _ in range(60):
        old.receive(world.sample())
        u = old.answer()
        old.advance()
        world.advance(u)
    new.resume(60, old.state(), 0.0)
    kept = [half.diagram.GetOutputPort("extra").Eval(half.context) for half in (old, new)]
    np.testing.assert_array_equal(*kept)
    assert np.all(kept[0] != 0.0)


class Listening(LeafSystem):
    """A servo of one's own that wants the force."""

    def __init__(self) -> None:
        super().__init__()
        for name, size in (("estimate", 15), ("reference", 9), ("force", 3)):
            self.DeclareVectorInputPort(name, size)
        self.DeclareVectorOutputPort("control", 4, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        d = self.GetInputPort("force").Eval(context)
        output.SetFromVector([26.487 - d[2], 0.0, 0.0, 0.0])


@pytest.mark.family("measured")
@pytest.mark.parametrize("force", ["thrust", "measured"])
def test_a_centre_of_gravity_that_is_off_is_a_torque_that_the_filter_learns(force: str) -> None:
    """The lift of a body whose centre of gravity is at r turns it by [-r_y, r_x] f_T, and f_T is m g in hover."""
    r = np.array([0.01, -0.004])
    torque = "estimator.walks.torque_sd=0.3"
    scenario = hovering(force, f"truth.vehicle.center_of_gravity={r.tolist()}", torque)
    diagram = make_closed_loop(scenario, fused=True)
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(8.0)
    onboard = diagram.GetSubsystemByName("onboard")
    value, sd = np.split(onboard.GetOutputPort("extra").Eval(onboard.GetMyContextFromRoot(simulator.get_context())), 2)
    first = 9 if force == "measured" else 3
    found, expected = value[first : first + 3], scenario.vehicle.hover_thrust * np.array([-r[1], r[0], 0.0])
    assert np.all(np.abs(found - expected) < 4.0 * sd[first : first + 3])
    assert np.all(sd[first : first + 3] < 0.01)


@pytest.mark.long
def test_of_an_unknown_torque_the_attitude_is_wrong_unless_it_is_a_state() -> None:
    def tilt_error(*settings: str) -> float:
        flight = fly(hovering("measured", "truth.vehicle.center_of_gravity=[0.002, 0.0]", *settings))
        error = (flight["estimate"].values[:, :6] - flight["truth"].values[:, :6])[90:, 4]
        return float(np.sqrt(np.mean(error**2)))

    assert tilt_error() > 0.05  # three degrees, of two millimetres
    assert tilt_error("estimator.walks.torque_sd=0.3") < 0.005


@pytest.mark.long
def test_what_a_sensor_of_ones_own_errs_by_is_a_state() -> None:
    """An altimeter reads 20 cm too high: the fixes by uwb tell, and the height is right."""
    settings = ("sensors=[uwb, imu, altimeter]", "truth.sensors.altimeter.bias=[0.2]", "planner.duration=30")

    def height_error(*more: str) -> float:
        flight = fly(hovering("measured", *settings, *more))
        return float(np.mean(flight["estimate"].values[600:, 2] - flight["truth"].values[600:, 2]))

    assert height_error() > 0.05
    assert abs(height_error("estimator.biases.row_sd={z_alt: 0.2}")) < 0.02


def test_of_a_sensor_that_does_not_fly_there_is_no_bias() -> None:
    flying, grounded = (hover_loop(load_scenario("realistic_altimeter", s)) for s in ((), ("sensors=[uwb, imu]",)))
    assert set(flying.names) - set(grounded.names) == {"bias_z_alt"}
    assert "bias_x_cam" not in flying.names


def test_a_bias_of_a_row_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"estimator.biases.row_sd.z_al: must be a row of a sensor beside .*z_alt"):
        hovering("measured", "estimator.biases.row_sd={z_al: 0.05}")
    with pytest.raises(InputError, match=r"estimator.walks.torque_sd: 0.1: must be 0 with force none"):
        hovering("none", "estimator.walks.torque_sd=0.1")


@pytest.mark.parametrize("force", ["none", "thrust"])
def test_a_servo_of_one_s_own_is_told_the_force_or_zero(force: str) -> None:
    scenario = hovering(force)
    diagram = make_closed_loop(scenario, servo=lambda _: Listening())
    simulator = make_simulator(diagram, scenario)
    simulator.AdvanceTo(2.0)
    onboard = diagram.GetSubsystemByName("onboard")
    control = onboard.GetOutputPort("control").Eval(onboard.GetMyContextFromRoot(simulator.get_context()))
    assert (control[0] == 26.487) == (force == "none")


@pytest.mark.parametrize("study", [predict_tube, lambda scenario: noise_model(scenario, scenario)])
def test_tube_and_noise_fit_refuse_what_they_do_not_know(study: object) -> None:
    with pytest.raises(InputError, match=r"^estimator.force: thrust: must be none"):
        study(hovering("thrust"))  # type: ignore[operator]


def test_the_papers_filter_has_no_biases() -> None:
    with pytest.raises(InputError, match=r"estimator.biases.uwb_sd: .0.0, 0.0, 0.1.: must be 0 with force none"):
        hovering("none", "estimator.biases={uwb_sd: [0, 0, 0.1]}")


def test_without_an_imu_no_force_is_measured() -> None:
    with pytest.raises(InputError, match=r"estimator.force: measured: must be none or thrust, no imu in sensors"):
        hovering("measured", "sensors=[uwb]")
