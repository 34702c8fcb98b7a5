"""The parts of the flying diagram that Drake can differentiate, wired for linearisation.

Plant, rotors and servo are the very systems that fly; they come in Drake's AutoDiffXd as well. What Drake cannot
differentiate is left out: sensors and fixes stand as y = Delta C x, which is what they are without noise, and the
filter with its gain frozen is an affine system.
"""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import AffineSystem, Demultiplexer, MatrixGain, Multiplexer

from ortilo_drake.diagrams.servo import make_lq_servo
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, STATE_NAMES, VELOCITY_SIZE
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.estimator.extra_states import D, F, augmented_rows, extra_states, names_of
from ortilo_drake.onboard.estimator.filter_model import augmented_model, filter_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_

N_V = N_X // 2  # velocities and Euler rates, which a scenario may lend the servo


def make_rotors_and_plant(vehicle: Vehicle, kinematics: str) -> Diagram:
    """Return the rotors before the continuous plant; state [x; rotor speeds] (12 + n).

    Ports:
        control (4): the commanded u.
        state (12, output): x.
    """
    builder = DiagramBuilder()
    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle, kinematics))
    rotors = builder.AddSystem(Rotors_[float](vehicle))
    builder.Connect(rotors.get_output_port(), plant.GetInputPort("control"))
    builder.ExportInput(rotors.get_input_port(), "control")
    builder.ExportOutput(plant.GetOutputPort("state"), "state")
    return _named(builder, "rotors_and_plant")


def make_servo(scenario: Scenario) -> Diagram:
    """Return the servo with its inputs in one vector; memoryless.

    Ports:
        inputs (24 or more): estimate (15), reference (9), where the filter estimates one the disturbance force (3), and
            where the scenario lends them the true velocities (6).
        control (4, output): u, f_T absolute.
    """
    builder = DiagramBuilder()
    servo = builder.AddSystem(_servo_of(scenario))
    lends, told = servo.HasInputPort("velocity"), servo.HasInputPort("force")
    parts = builder.AddSystem(Demultiplexer([N_XBAR, REFERENCE_SIZE] + [3] * told + [N_V] * lends))
    builder.Connect(parts.get_output_port(0), servo.GetInputPort("estimate"))
    builder.Connect(parts.get_output_port(1), servo.GetInputPort("reference"))
    if told:
        builder.Connect(parts.get_output_port(2), servo.GetInputPort("force"))
    if lends:
        message = builder.AddSystem(MatrixGain(np.eye(VELOCITY_SIZE, N_V, -PAYLOAD)))
        builder.Connect(parts.get_output_port(2 + told), message.get_input_port())
        builder.Connect(message.get_output_port(), servo.GetInputPort("velocity"))
    builder.ExportInput(parts.get_input_port(), "inputs")
    builder.ExportOutput(servo.get_output_port(), "control")
    return _named(builder, "servo")


def _servo_of(scenario: Scenario) -> System:
    return make_lq_servo(scenario, filter_of(scenario).force != "none")


def make_frozen_filter(scenario: Scenario, K: np.ndarray, delta: np.ndarray) -> AffineSystem:
    """Return the filter of onboard/estimator/intermittent_filter.py with its gain and the arrivals frozen.

        xhat_{k+1} = Phi xhat + Gamma (u - u_hover) + K Delta (y - C xhat)
        i_{k+1}    = i + r - E y;  'hold': i where E = 0;  'estimate': i + r - p_hat

    xhat is [xhat; ehat] (N) where the filter estimates more than the vehicle's states; a lift that tilts is none to
    first order. Ports: input [y (p); u (4); reference (9)], output [xhat; i] (N + 3).
    """
    vehicle = scenario.vehicle
    settings = filter_of(scenario)
    extras = extra_states(settings, vehicle, scenario.h, scenario.flown_rows, scenario.yaw)
    model = augmented_model(settings, vehicle, settings.integrator, scenario.h, extras, scenario.yaw)
    measurement = augmented_rows(scenario.measurement.rows, extras)
    Delta, E, p = measurement.arrival_matrix(delta), measurement.selection_matrix(delta), measurement.sizes["y"]
    integrator, N = settings.integrator, len(model.Phi)
    A, B = np.eye(N + N_I), np.zeros((N + N_I, p + N_U + REFERENCE_SIZE))
    A[:N, :N] = model.Phi - K @ Delta @ measurement.layout.C
    B[:N, :p], B[:N, p : p + N_U] = K @ Delta, model.Gamma
    if integrator == "estimate":
        A[N:, :N_I] = -np.eye(N_I)
    else:
        B[N:, :p] = -E
    if integrator != "hold" or E.any():
        B[N:, p + N_U :] = np.eye(N_I, REFERENCE_SIZE)
    f_0 = -B[:, p] * vehicle.hover_thrust
    identity, no_feedthrough = np.eye(N + N_I), np.zeros((N + N_I, B.shape[1]))
    return AffineSystem(A, B, f_0, identity, no_feedthrough, np.zeros(N + N_I), scenario.h)


def make_flown_force(vehicle: Vehicle, h: float) -> AffineSystem:
    """Return the force of the step just flown less the hover lift, f_{k+1} = (f_T - m g) e_z; u (4) to f (3)."""
    B, f_0 = np.zeros((3, N_U)), np.array([0.0, 0.0, -vehicle.hover_thrust])
    B[2, 0] = 1.0
    return AffineSystem(np.zeros((3, 3)), B, f_0, np.eye(3), np.zeros((3, N_U)), np.zeros(3), h)


def make_linear_loop(scenario: Scenario, K: np.ndarray, delta: np.ndarray) -> Diagram:
    """Return sampled plant, servo and frozen filter in a loop; discrete state [x; xhat; i] (27), in that order.

    With a filter that estimates more, xhat is longer, and x is [x; f] where it takes the accelerometer.

    Ports:
        reference (9): r, r_dot, r_ddot.
        state (12, output): x.

    Args:
        scenario: the scenario, of which rotors, links and noise are left out.
        K: predictor gain (N x p) at full size; columns of sensors that did not arrive are ignored.
        delta: arrivals (s).
    """
    extras = extra_states(filter_of(scenario), scenario.vehicle, scenario.h, scenario.flown_rows, scenario.yaw)
    measurement, names = augmented_rows(scenario.measurement.rows, extras), (*STATE_NAMES, *names_of(extras))
    N, rows = len(names), measurement.arrival_matrix(delta) @ measurement.layout.C
    builder = DiagramBuilder()
    plant = builder.AddSystem(QuadrotorPlant_[float](scenario.vehicle, scenario.world.kinematics, scenario.h))
    state, control = plant.GetOutputPort("state"), plant.GetInputPort("control")
    seen, columns = state, list(range(N_X))
    if set(F) <= set(names):
        flown = builder.AddNamedSystem("flown_force", make_flown_force(scenario.vehicle, scenario.h))
        both = builder.AddSystem(Multiplexer([N_X, 3]))
        builder.Connect(state, both.get_input_port(0))
        builder.Connect(flown.get_output_port(), both.get_input_port(1))
        seen = both.get_output_port()
        columns += [names.index(name) for name in F]
    kalman = builder.AddNamedSystem("kalman_filter", make_frozen_filter(scenario, K, delta))
    servo = builder.AddSystem(_servo_of(scenario))
    sensors = builder.AddNamedSystem("sensors", MatrixGain(rows[:, columns]))
    inputs = builder.AddSystem(Multiplexer([measurement.sizes["y"], N_U, REFERENCE_SIZE]))
    builder.Connect(seen, sensors.get_input_port())
    builder.Connect(sensors.get_output_port(), inputs.get_input_port(0))
    builder.Connect(servo.get_output_port(), inputs.get_input_port(1))
    builder.Connect(inputs.get_output_port(), kalman.get_input_port())
    picks = {"estimate": [*range(N_X), *range(N, N + N_I)]} | ({"force": [names.index(d) for d in D]} if extras else {})
    for port, numbers in picks.items():
        pick = builder.AddSystem(MatrixGain(np.eye(N + N_I)[numbers]))
        builder.Connect(kalman.get_output_port(), pick.get_input_port())
        builder.Connect(pick.get_output_port(), servo.GetInputPort(port))
    builder.Connect(servo.get_output_port(), control)
    if len(columns) > N_X:
        builder.Connect(servo.get_output_port(), flown.get_input_port())
    if servo.HasInputPort("velocity"):  # whose flag and stamp it does not read
        message = builder.AddSystem(MatrixGain(np.vstack([np.zeros((PAYLOAD, N_X)), np.eye(N_V, N_X, N_V)])))
        builder.Connect(state, message.get_input_port())
        builder.Connect(message.get_output_port(), servo.GetInputPort("velocity"))
    reference = builder.ExportInput(servo.GetInputPort("reference"), "reference")
    builder.ConnectInput(reference, inputs.get_input_port(2))
    builder.ExportOutput(state, "state")
    return _named(builder, "linear_loop")


def _named(builder: DiagramBuilder, name: str) -> System:
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram
