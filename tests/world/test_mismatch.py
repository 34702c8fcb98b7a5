"""Each way in which a world differs acts as physics says, against closed forms."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.world import World, make_world
from ortilo_drake.flight.flight import fix_steps
from ortilo_drake.model.signals import DETECTION_SIZE, PAYLOAD
from ortilo_drake.model.vehicle import GRAVITY, M100
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.sensors.projected_camera import body_that_looks_ahead

H = 1.0 / 30.0
START, TICKS = np.array([8.0, 1.0, 1.5]), 12
QUIET = (
    "world.disturbance={force_density: 0, torque_density: 0}",
    "imu={angle_density: 0, rate_density: 0, specific_force_density: 0}",
    "uwb={noise: {kind: constant, sd: 0}, link: {rate: null}}",
    "camera={kind: projected, latency: 0, link: {rate: null}}",
    "camera.errors={kind: parametric, edge_sd: 0, miss_base: 0, miss_per_metre: 0, false_boxes: 0}",
)
CONTINUOUS = ("world.plant=continuous",)
ROTORS = (*CONTINUOUS, "world.rotors={kind: first_order}")


def scenario_of(*settings: str, name: str = "nominal_imu_uwb_yolo") -> Scenario:
    return load_scenario(name, (*QUIET, *settings))


class Flown:
    """A world that flies under a constant command, without an onboard half."""

    def __init__(self, scenario: Scenario, seed: int = 0):
        self.world: World = make_world(scenario, r_0=START)
        self._simulator = Simulator(self.world)
        fix_steps(self._simulator, scenario)
        self.context = self._simulator.get_mutable_context()
        self.world.SetSeed(self.context, seed)
        self.command()

    def command(self, *torques: float) -> None:
        u = [M100.hover_thrust, *(torques or (0.0, 0.0, 0.0))]
        self.world.GetInputPort("control").FixValue(self.context, u)

    def move_to(self, x: np.ndarray) -> None:
        self.world.SetState(self.context, x)

    def fly(self, ticks: int = TICKS) -> np.ndarray:
        """Return x after that many ticks more (12)."""
        self._simulator.AdvanceTo(self.context.get_time() + ticks * H)
        return self.says("state")

    def says(self, port: str) -> np.ndarray:
        return np.array(self.world.GetOutputPort(port).Eval(self.context))


@pytest.mark.family
@pytest.mark.parametrize("settings", [(), CONTINUOUS, ROTORS], ids=["sampled", "continuous", "rotors"])
def test_a_heavy_or_weak_vehicle_sinks_under_its_hover_thrust(settings: tuple[str, ...]) -> None:
    t = TICKS * H
    for mass, thrust in ((1.1, 1.0), (0.95, 1.0), (1.0, 0.98), (1.03, 0.98)):
        truth = f"truth.vehicle={{mass_factor: {mass}, thrust_factor: {thrust}}}"
        x = Flown(scenario_of(*settings, truth)).fly()
        acceleration = GRAVITY * (thrust / mass - 1.0)
        np.testing.assert_allclose(x[[2, 8]] - [START[2], 0.0], [acceleration * t**2 / 2, acceleration * t], atol=1e-9)
        assert not np.any(np.abs(np.delete(x, [2, 8]) - [*START[:2], *[0.0] * 8]) > 1e-9)


def test_a_mean_force_accelerates_by_force_over_true_mass() -> None:
    F, t = np.array([0.1, 0.5, -0.3]), TICKS * H
    for mass in (1.0, 1.2):
        flown = Flown(scenario_of(f"truth.force.mean={F.tolist()}", f"truth.vehicle.mass_factor={mass}"))
        x = flown.fly()
        a = F / (mass * M100.mass) + [0.0, 0.0, GRAVITY * (1.0 / mass - 1.0)]
        np.testing.assert_allclose(x[6:9], a * t, atol=1e-9)
        # An accelerometer feels all but gravity.
        np.testing.assert_allclose(flown.says("imu")[PAYLOAD + 6 :], a + [0.0, 0.0, GRAVITY], atol=1e-9)


def test_gusts_push_with_what_their_source_says_beside_the_white_force() -> None:
    white = "world.disturbance={force_density: 0.0365, torque_density: 0}"
    gusty, calm = (Flown(scenario_of(white, *more)) for more in (("truth.force={gust_sd: 0.3, gust_time: 1.5}",), ()))
    sources = [gusty.world.GetSubsystemByName(name) for name in ("lasting_force", "disturbance")]
    impulse = np.zeros(3)
    for _ in range(TICKS):
        pushed, alone = (
            source.GetOutputPort(source.get_name()).Eval(source.GetMyContextFromRoot(gusty.context))
            for source in sources
        )
        error = pushed - alone
        assert np.all(error[0:3] != 0.0)
        assert not np.any(error[3:])
        impulse += error[0:3] * H
        one, other = gusty.fly(1), calm.fly(1)
    np.testing.assert_allclose((one - other)[6:9], impulse / M100.mass, atol=1e-9)


def test_inertia_and_a_shifted_centre_of_gravity_turn_it() -> None:
    t, tau, I = TICKS * H, np.array([0.02, -0.03, 0.01]), np.array(M100.inertia)  # noqa: E741
    flown = Flown(scenario_of("truth.vehicle.inertia_factor=1.25", "world.kinematics=linear"))
    flown.command(*tau)
    np.testing.assert_allclose(flown.fly()[9:12], tau / (1.25 * I) * t, atol=1e-12)
    # A centre of gravity ahead of the thrust lowers the nose (theta > 0), one to the left of it that side (phi < 0).
    r, s = np.array([0.004, 0.002]), 0.9
    truth = f"truth.vehicle={{center_of_gravity: {r.tolist()}, thrust_factor: {s}}}"
    x = Flown(scenario_of(truth, "world.kinematics=linear")).fly()
    lift = s * M100.hover_thrust
    np.testing.assert_allclose(x[9:12], np.array([-lift * r[1] / I[0], lift * r[0] / I[1], 0.0]) * t, atol=1e-12)


def test_the_imu_errs_by_bias_walk_and_factor() -> None:
    x = np.array([8.0, 1.0, 1.5, 0.1, -0.05, 0.2, 0.3, 0.2, 0.1, 0.3, -0.2, 0.4])
    plain = Flown(scenario_of())
    plain.move_to(x)
    y = plain.says("imu")[PAYLOAD:]
    bias = "level: [0.01, -0.02], yaw: 0.035, rates: [0.1, 0.2, 0.3], specific_force: [0.4, 0.5, 0.6]"
    b = np.array([0.01, -0.02, 0.035, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    for factors, c in (
        ("", np.ones(9)),
        (", angles_factor: 1.1, rates_factor: 0.9, specific_force_factor: 1.2", np.repeat([1.1, 0.9, 1.2], 3)),
    ):
        flown = Flown(scenario_of(f"truth.imu={{{bias}{factors}}}"))
        flown.move_to(x)
        np.testing.assert_allclose(flown.says("imu")[PAYLOAD:], c * (y + b), rtol=1e-12)
    walking = Flown(scenario_of("truth.imu={level_walk: 0.01, yaw_walk: 0.02}"))
    assert not np.any(walking.says("imu")[PAYLOAD : PAYLOAD + 6])
    walking.fly(30)
    angles = walking.says("imu")[PAYLOAD : PAYLOAD + 3]
    assert np.all(np.abs(angles) > 0.0)
    np.testing.assert_array_less(np.abs(angles), 5.0 * np.array([0.01, 0.01, 0.02]))  # after 1 s


def test_ranges_err_by_bias_survey_and_slowly() -> None:
    scenario = scenario_of("truth.uwb={bias: 0.1, bias_sd: 0.05, factor: 1.02}", "truth.survey.anchors_sd=0.03")
    flown = Flown(scenario, seed=5)
    drawn, room = flown.world.Drawn(flown.context), scenario.load_room()
    true = np.linalg.norm(START - (room.anchor_positions + drawn["survey.anchors"]), axis=1)
    message, n = flown.says("uwb")[PAYLOAD:], len(true)
    assert np.std(drawn["uwb.bias"]) > 0.0
    assert np.all(message[n:] == 1.0)
    np.testing.assert_allclose(message[:n], 1.02 * (true + drawn["uwb.bias"]), rtol=1e-12)
    slow = Flown(scenario_of("truth.uwb={slow_sd: 0.05, slow_time: 2.0}", "uwb.max_distance=7"))
    source: Any = slow.world.GetSubsystemByName("uwb_error")
    message = slow.says("uwb")[PAYLOAD:]
    error = source.state_of(source.GetMyContextFromRoot(slow.context), "uwb_error", "x")
    assert np.all(error != 0.0)
    distances, there = np.linalg.norm(START - room.anchor_positions, axis=1), message[n:] == 1.0
    assert 0 < np.sum(there) < n
    np.testing.assert_allclose(message[:n], np.where(there, distances + error, 0.0), rtol=1e-12)


def test_a_registered_sensor_errs_by_its_own_entry_and_leaves_the_others() -> None:
    sensors = "sensors=[uwb, imu, altimeter, flow]"
    own = "truth.sensors={altimeter: {bias: [0.2], factor: [1.1]}, flow: {bias: [0.01, -0.02, 0, 0, 0]}}"
    plain, flown = Flown(scenario_of(sensors, name="flow")), Flown(scenario_of(sensors, own, name="flow"))
    np.testing.assert_allclose(flown.says("altimeter")[2], 1.1 * (plain.says("altimeter")[2] + 0.2), rtol=1e-12)
    difference = flown.says("flow") - plain.says("flow")
    np.testing.assert_allclose(difference, [0.0, 0.0, 0.01, -0.02, 0.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_array_equal(flown.says("uwb"), plain.says("uwb"))


def boxes(message: np.ndarray) -> dict[int, np.ndarray]:
    """Return the boxes of a detections message by class, of classes that it holds once."""
    rows = message[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    labels = rows[:, 0].astype(int)
    return {label: rows[k, 2:] for k, label in enumerate(labels) if label >= 0 and np.sum(labels == label) == 1}


def test_a_turned_camera_sees_where_a_turned_pinhole_projects() -> None:
    rpy, shift, factor = np.array([0.03, -0.04, 0.06]), np.array([0.05, -0.02, 0.1]), 1.04
    truth = f"truth.camera={{angles: {rpy.tolist()}, position: {shift.tolist()}, focal_factor: {factor}}}"
    scenario = scenario_of(truth, "truth.survey.landmarks_sd=0.05", "camera.width=640")
    flown, room = Flown(scenario), scenario.load_room()
    camera, landmarks = room.camera.scaled_to(640), flown.world.Drawn(flown.context)["survey.landmarks"]
    R_BA = RollPitchYaw(rpy).ToRotationMatrix().matrix()
    found = 0
    for label, box in boxes(flown.says("detections")).items():
        found += 1
        expected = []
        for i in np.flatnonzero(room.landmark_labels == label):
            corners = room.landmark_positions[i] + landmarks[i] + room.landmark_outlines[i]
            q = (corners - START - camera.position - shift) @ R_BA  # in the turned camera's ahead, left, up
            if np.all(q[:, 0] > 0.5):
                f = factor * camera.focal_length
                u, v = camera.center[0] - f * q[:, 1] / q[:, 0], camera.center[1] - f * q[:, 2] / q[:, 0]
                u, v = np.clip(u, -0.5, 639.5), np.clip(v, -0.5, camera.height - 0.5)  # cut at the border
                expected.append([u.min(), v.min(), u.max(), v.max()])
        assert any(np.allclose(box, e, rtol=0.0, atol=1e-6) for e in expected), label
    assert found >= 3


def test_a_late_clock_shows_where_the_vehicle_was() -> None:
    x = np.array([8.0, 1.0, 1.5, 0.1, -0.05, 0.2, 1.0, -2.0, 0.5, 0.3, -0.2, 0.4])
    scenario = scenario_of("truth.clock={offset: 0.02, drift: 0.001}", "truth.uwb.bias=0.0")
    flown = Flown(scenario)
    flown.fly()
    flown.move_to(x)
    before = x[0:3] - (0.02 + 0.001 * TICKS * H) * x[6:9]
    anchors = scenario.load_room().anchor_positions
    message = flown.says("uwb")
    np.testing.assert_allclose(message[2 : 2 + len(anchors)], np.linalg.norm(before - anchors, axis=1), rtol=1e-12)
    assert message[1] == pytest.approx(TICKS * H)  # its stamp does not tell
    np.testing.assert_array_equal(flown.says("imu")[PAYLOAD : PAYLOAD + 3], x[3:6])
    imu = np.array(flown.says("imu"))
    flown.move_to(np.concatenate((before, x[3:6] - (0.02 + 0.001 * TICKS * H) * x[9:12], x[6:])))
    assert not np.array_equal(flown.says("imu"), imu)


def test_it_starts_elsewhere_than_it_is_believed_to() -> None:
    flown = Flown(scenario_of("truth.start={position: [0.3, -0.2, 0.1], yaw: 0.087}"))
    np.testing.assert_allclose(flown.says("state"), [*(START + [0.3, -0.2, 0.1]), 0, 0, 0.087, *[0] * 6], rtol=1e-12)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_spread_alone_differs_by_seed(seed: int) -> None:
    flown = Flown(scenario_of("truth.vehicle.mass_factor_sd=0.05"), seed)
    factor = float(flown.world.Drawn(flown.context)["vehicle.mass_factor"])
    assert abs(factor - 1.0) > 1e-4
    assert flown.fly()[8] == pytest.approx(GRAVITY * (1.0 / factor - 1.0) * TICKS * H, rel=1e-9)


@pytest.mark.long
@pytest.mark.egl
def test_a_turned_rendered_camera_draws_as_one_on_a_turned_body() -> None:
    rpy, width = [0.02, -0.03, 0.15], "camera.width=160"

    def labels(x: np.ndarray, *settings: str) -> Any:
        world = make_world(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=rendered", width, *settings)))
        context = world.CreateDefaultContext()
        world.SetSeed(context, 0)
        world.SetState(context, x)
        return world.GetOutputPort("label_image").Eval(context).data.copy()

    x = np.array([*START, *[0.0] * 9])
    p_BC = np.array(load_scenario("nominal_imu_uwb_yolo").load_room().camera.position)
    turned = labels(x, f"truth.camera.angles={rpy}")
    expected = labels(body_that_looks_ahead(x, p_BC, np.array(rpy)))
    assert np.mean(turned == expected) > 0.999
    assert np.mean(turned == labels(x)) < 0.98
    wide = labels(x, "truth.camera.focal_factor=0.5")
    # Half the focal length shows the picture in half its size: each second pixel about the middle.
    middle = labels(x)
    rows, columns = wide.shape[0], wide.shape[1]
    shrunk = wide[rows // 4 : 3 * rows // 4, columns // 4 : 3 * columns // 4]
    assert np.mean(shrunk == middle[::2, ::2]) > 0.95
