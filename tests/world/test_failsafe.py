"""The failsafe: its loops against closed forms, the envelope it must recover from, and the world that carries it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from motions import state
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram
from scipy.integrate import solve_ivp

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.model.equations import DYNAMICS, KINEMATICS, step
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.world import Failsafe as FailsafeSettings
from ortilo_drake.world.vehicle.failsafe import MODES, Failsafe, failsafe_control, failsafe_state, hold_control

P, W_Z, W_PSI = FREQUENCIES = np.array([3.0, 2.0, 2.0])
MAX_TILT = np.radians(20.0)
MAX_THRUST = 4 * 1.858582798e-5 * 838.0**2
INERTIA = np.array(M100.inertia)
HOVER = np.array([2.7 * 9.81, 0.0, 0.0, 0.0])
DT = 1e-3
NEVER = -np.inf


def hold(x: np.ndarray, z_r: float = 1.5, psi_r: float = 0.0) -> np.ndarray:
    return hold_control(x, z_r, psi_r, np.inf, MAX_TILT, FREQUENCIES, M100.mass, INERTIA, MAX_THRUST)


# --- the loops ---------------------------------------------------------------------------------------------------


def held_linear(x_0: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The linear plant under the hold, integrated by SciPy (times, 12)."""

    def x_dot(_: float, x: np.ndarray) -> np.ndarray:
        return DYNAMICS["linear"](x, hold(x), np.zeros(6), M100.mass, INERTIA)

    return solve_ivp(x_dot, (0.0, times[-1]), x_0, t_eval=times, rtol=1e-10, atol=1e-12).y.T


def test_each_loop_has_the_poles_it_is_named_after() -> None:
    x_0, e = state(z=1.5), 1e-6

    def x_dot(x: np.ndarray) -> np.ndarray:
        return DYNAMICS["linear"](x, hold(x), np.zeros(6), M100.mass, INERTIA)

    A = np.column_stack([(x_dot(x_0 + e * row) - x_dot(x_0 - e * row)) / (2 * e) for row in np.eye(12)])
    poles = [0.0] * 2 + [-P] * 6 + [-W_Z] * 2 + [-W_PSI] * 2
    np.testing.assert_allclose(np.poly(A).real, np.poly(poles), rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize(("axis", "other"), [(6, 7), (7, 6)], ids=["x", "y"])
def test_braking_is_the_critically_damped_third_order_response(axis: int, other: int) -> None:
    times = np.linspace(0.0, 3.0, 31)
    x_0 = state(z=1.5)
    x_0[axis] = 1.0
    x = held_linear(x_0, times)
    pt = P * times
    np.testing.assert_allclose(x[:, axis], (1 + pt + pt**2 / 2) * np.exp(-pt), atol=1e-8)
    np.testing.assert_allclose(x[:, other], 0.0, atol=1e-12)


@pytest.mark.long
def test_braking_leaves_the_altitude_alone() -> None:
    x = state(z=1.5, vx=1.2, vy=-0.7, psi=0.4)
    for _ in range(2000):
        x = step(x, hold(x, 1.5, 0.4), np.zeros(6), M100.mass, INERTIA, KINEMATICS.index("rigid_body"), DT)
        assert abs(x[2] - 1.5) < 1e-3  # the thrust makes up for the tilt, but for what it turns within a step


@pytest.mark.parametrize(("z", "v_z"), [(1.2, 0.0), (1.5, 0.8), (1.7, -0.5)])
def test_altitude_is_the_critically_damped_second_order_response(z: float, v_z: float) -> None:
    times = np.linspace(0.0, 3.0, 31)
    x = held_linear(state(z=z, vz=v_z), times)
    error = ((z - 1.5) + (v_z + W_Z * (z - 1.5)) * times) * np.exp(-W_Z * times)
    np.testing.assert_allclose(x[:, 2], 1.5 + error, atol=1e-8)


def test_yaw_is_the_critically_damped_second_order_response() -> None:
    times = np.linspace(0.0, 3.0, 31)
    x = held_linear(state(z=1.5, psi=0.3, psi_dot=0.7), times)
    np.testing.assert_allclose(x[:, 5], (0.3 + (0.7 + W_PSI * 0.3) * times) * np.exp(-W_PSI * times), atol=1e-8)


@given(arrays(float, 12, elements=st.floats(-20.0, 20.0)))
def test_tilt_and_thrust_asked_for_are_limited_and_oppose_the_velocity(x: np.ndarray) -> None:
    x[3:5] = x[9:12] = 0.0
    u = hold(x)
    phi_r, theta_r = u[1] / INERTIA[0] / (3 * P**2), u[2] / INERTIA[1] / (3 * P**2)
    assert np.hypot(phi_r, theta_r) <= MAX_TILT * (1 + 1e-12)
    assert 0.0 <= u[0] <= MAX_THRUST
    push = np.cos(x[5]) * theta_r + np.sin(x[5]) * phi_r, np.sin(x[5]) * theta_r - np.cos(x[5]) * phi_r
    assert push[0] * x[6] + push[1] * x[7] <= 0.0
    np.testing.assert_allclose(push[0] * x[7], push[1] * x[6], atol=1e-9)  # straight against it


@pytest.mark.long
@settings(max_examples=40)
@given(
    tilt=st.floats(0.0, np.radians(25.0)),
    towards=st.floats(-np.pi, np.pi),
    yaw=st.floats(-np.pi, np.pi),
    direction=arrays(float, 3, elements=st.floats(-1.0, 1.0)),
    rates=arrays(float, 3, elements=st.floats(-1.0, 1.0)),
    kinematics=st.sampled_from(["small_angle", "rigid_body"]),
)
def test_comes_to_rest_from_anywhere_in_the_envelope(tilt, towards, yaw, direction, rates, kinematics) -> None:
    x = np.array([0.0, 0.0, 1.5, tilt * np.cos(towards), tilt * np.sin(towards), yaw, *[0.0] * 3, *rates])
    x[6:9] = 1.5 * direction / max(np.linalg.norm(direction), 1.0)
    kind, highest = KINEMATICS.index(kinematics), 0.0
    for k in range(4000):
        x = step(x, hold(x, 1.5, yaw), np.zeros(6), M100.mass, INERTIA, kind, DT)
        highest = max(highest, abs(x[2] - 1.5))
        if k >= 2999 and k % 50 == 0:
            assert np.linalg.norm(x[6:9]) < 0.1
            assert np.arccos(np.cos(x[3]) * np.cos(x[4])) < np.radians(3.0)
            assert abs(x[2] - 1.5) < 0.05
    assert highest < 1.5 / (W_Z * np.e) + 0.03  # the closed form's overshoot at 1.5 m/s, and little for the tilt


# --- the system --------------------------------------------------------------------------------------------------


@given(
    u=arrays(float, 4, elements=st.floats(-1e3, 1e3)),
    x=arrays(float, 12, elements=st.floats(-10.0, 10.0)),
    age=st.floats(0.0, 0.2, exclude_max=True),
    s=st.sampled_from([np.zeros(4), np.array([1.0, 6.0, 1.0, 0.2]), np.array([2.0, 3.0, 1.0, 0.2])]),
)
def test_a_command_young_enough_passes_bit_for_bit_and_ends_a_hold(u, x, age, s) -> None:
    failsafe = Failsafe(FailsafeSettings(), M100, DT)
    context = failsafe.CreateDefaultContext()
    context.SetTime(10.0)
    context.SetDiscreteState(s)
    failsafe.GetInputPort("command").FixValue(context, [*u, 10.0 - age])
    failsafe.GetInputPort("state").FixValue(context, x)
    assert failsafe.GetOutputPort("control").Eval(context).tobytes() == u.tobytes()
    assert failsafe.GetOutputPort("mode").Eval(context) == [0.0]


@pytest.mark.long
def test_modes_follow_the_age_of_the_command() -> None:
    x, s, modes = state(z=1.2, psi=0.4), np.zeros(4), {}
    for k in range(9000):
        t = k * DT
        last = max(received for received in (0.0, 1.0, 8.0) if received <= t)  # the second silence outlasts hold_for
        x[2] = 1.2 if t < 2.0 else 0.9
        s = failsafe_state(t, s, np.array([*HOVER, last]), x, 0.2, 5.0)
        modes.setdefault(MODES[int(s[0])], []).append(k)
        if 1.3 < t < 7.9:
            np.testing.assert_allclose(s[1:], [1.201, 1.2, 0.4], atol=2e-3)  # where it took over, for good
    assert modes["command"] == [*range(201), *range(1000, 1201), *range(8000, 8201)]
    assert modes["descend"] == list(range(6201, 8000))
    assert modes["hold"] == [*range(201, 1000), *range(1201, 6201), *range(8201, 9000)]


def test_nothing_received_yet_is_held() -> None:
    s = failsafe_state(0.0, np.zeros(4), np.array([*HOVER, NEVER]), state(z=1.2), 0.2, 5.0)
    np.testing.assert_array_equal(s, [1.0, 0.0, 1.2, 0.0])


@given(z=st.floats(0.2, 3.0), v_z=st.floats(-0.3, 1.0))
def test_a_descent_never_asks_to_climb(z: float, v_z: float) -> None:
    s = np.array([2.0, 0.0, 3.0, 0.0])
    args = (0.3, 0.15, MAX_TILT, FREQUENCIES, M100.mass, INERTIA, MAX_THRUST)
    slow = failsafe_control(s, np.zeros(5), state(z=z, vz=max(v_z, 0.0)), *args)
    assert slow[0] < HOVER[0]
    fast = failsafe_control(s, np.zeros(5), state(z=z, vz=-0.31), *args)
    assert fast[0] > HOVER[0]


# --- the world ---------------------------------------------------------------------------------------------------


def make_flight(*options: str, name: str = "nominal_imu_uwb") -> tuple[Diagram, Simulator]:
    scenario = load_scenario(name, options)
    world = make_world(scenario, DT, r_0=np.array([5.0, 2.0, 1.2]))
    simulator = Simulator(world)
    config = SimulatorConfig(integration_scheme="runge_kutta3", max_step_size=DT, use_error_control=False)
    ApplySimulatorConfig(config, simulator)
    world.SetSeed(simulator.get_mutable_context(), scenario.seed)
    return world, simulator


def put(world: Diagram, simulator: Simulator, x: np.ndarray) -> None:
    plant = world.GetSubsystemByName("quadrotor")
    plant.SetState(plant.GetMyMutableContextFromRoot(simulator.get_mutable_context()), x)


def states(world: Diagram, simulator: Simulator, times: np.ndarray) -> np.ndarray:
    found = []
    for t in times:
        simulator.AdvanceTo(t)
        found.append(world.GetOutputPort("state").Eval(simulator.get_context()).copy())
    return np.array(found)


@pytest.mark.long
@pytest.mark.parametrize("rotors", ["ideal", "first_order"])
def test_in_the_disturbed_world_it_holds_then_lands_and_obeys_again(rotors: str) -> None:
    world, simulator = make_flight("world.plant=continuous", f"world.rotors.kind={rotors}")
    context = simulator.get_mutable_context()
    command = world.GetInputPort("command")
    command.FixValue(context, [*HOVER, NEVER])
    start = state(x=5.0, y=2.0, z=1.2, phi=0.25, theta=-0.3, vx=1.0, vy=-0.8, vz=0.5, phi_dot=0.7, theta_dot=-0.7)
    put(world, simulator, start)
    x = states(world, simulator, np.arange(3.0, 5.0, 0.1))
    assert np.linalg.norm(x[:, 6:9], axis=1).max() < 0.1
    assert np.arccos(np.cos(x[:, 3]) * np.cos(x[:, 4])).max() < np.radians(3.0)
    assert abs(x[:, 2] - 1.2).max() < 0.1

    t = np.arange(5.5, 12.0, 0.1)
    z = states(world, simulator, t)[:, 2]
    far = z > 0.15 + 0.3 * 2 / W_Z  # within that of its landing height the descent slows
    assert np.polyfit(t[far], z[far], 1)[0] == pytest.approx(-0.3, abs=0.02)
    assert z.min() > 0.05
    assert abs(z[-10:] - 0.15).max() < 0.05

    context = simulator.get_mutable_context()
    u = HOVER * 1.1
    command.FixValue(context, [*u, 12.0])
    simulator.AdvanceTo(12.01)
    applied = world.GetSubsystemByName("hold")
    np.testing.assert_array_equal(
        applied.get_output_port().Eval(applied.GetMyContextFromRoot(simulator.get_context())), u
    )


def test_while_commands_come_the_plant_flies_as_without_a_failsafe() -> None:
    world, simulator = make_flight("world.disturbance.force_density=0.0", "world.disturbance.torque_density=0.0")
    x, u = world.GetOutputPort("state").Eval(simulator.get_context()).copy(), HOVER + [0.3, 0.004, -0.003, 0.002]
    world.GetInputPort("command").FixValue(simulator.get_mutable_context(), [*u, 0.0])
    simulator.AdvanceTo(0.15)
    expected = solve_ivp(
        lambda _, x: DYNAMICS["small_angle"](x, u, np.zeros(6), M100.mass, INERTIA), (0.0, 0.15), x, rtol=1e-11
    ).y[:, -1]
    np.testing.assert_allclose(world.GetOutputPort("state").Eval(simulator.get_context()), expected, atol=1e-9)


@pytest.mark.parametrize("timeout", [0.1, 0.6])
def test_the_scenario_says_when_it_takes_over(timeout: float) -> None:
    world, simulator = make_flight(f"failsafe.timeout={timeout}", "failsafe.hold_for=0.5")
    world.GetInputPort("command").FixValue(simulator.get_mutable_context(), [*HOVER, 0.0])
    failsafe = world.GetSubsystemByName("failsafe")
    took_over = {}
    for t in np.arange(0.05, 1.5, 0.01):
        simulator.AdvanceTo(t)
        mode = failsafe.GetOutputPort("mode").Eval(failsafe.GetMyContextFromRoot(simulator.get_context()))[0]
        took_over.setdefault(MODES[int(mode)], t)
    assert took_over["hold"] == pytest.approx(timeout, abs=0.0101)
    assert took_over["descend"] == pytest.approx(timeout + 0.5, abs=0.0201)


@pytest.mark.parametrize("setting", ["failsafe.timeout=0", "failsafe.descent_rate=-1", "failsafe.max_tilt=1"])
def test_settings_it_cannot_fly_are_refused_by_name(setting: str) -> None:
    with pytest.raises(InputError, match=setting.partition("=")[0]):
        load_scenario("nominal_imu_uwb", (setting,))


def test_without_a_command_period_the_world_has_none_of_this() -> None:
    world = make_world(load_scenario("nominal_imu_uwb"))
    assert not world.HasSubsystemNamed("failsafe")
    assert world.HasInputPort("control")
    assert not world.HasInputPort("command")


def test_a_simulated_command_link_is_refused_where_commands_come_from_outside() -> None:
    with pytest.raises(InputError, match="command_link"):
        make_world(load_scenario("nominal_imu_uwb", ("command_link.delay=1",)), DT)
