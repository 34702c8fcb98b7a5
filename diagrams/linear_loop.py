"""The parts of the flying diagram that Drake can differentiate, wired for linearisation.

Plant, rotors and servo are the very systems that fly; they come in Drake's AutoDiffXd as well. What Drake cannot
differentiate is left out: sensors and fixes stand as y = Delta C x, which is what they are without noise, and the
filter with its gain frozen is an affine system.
"""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import AffineSystem, Demultiplexer, MatrixGain, Multiplexer

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, VELOCITY_SIZE
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.servo.lq_servo import make_lq_servo
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
        inputs (24 or 30): estimate (15), reference (9) and, where the scenario lends them, the true velocities (6).
        control (4, output): u, f_T absolute.
    """
    builder = DiagramBuilder()
    servo = builder.AddSystem(make_lq_servo(scenario.servo, scenario.vehicle, scenario.h))
    lends = servo.HasInputPort("velocity")
    parts = builder.AddSystem(Demultiplexer([N_XBAR, REFERENCE_SIZE] + [N_V] * lends))
    builder.Connect(parts.get_output_port(0), servo.GetInputPort("estimate"))
    builder.Connect(parts.get_output_port(1), servo.GetInputPort("reference"))
    if lends:
        message = builder.AddSystem(MatrixGain(np.eye(VELOCITY_SIZE, N_V, -PAYLOAD)))
        builder.Connect(parts.get_output_port(2), message.get_input_port())
        builder.Connect(message.get_output_port(), servo.GetInputPort("velocity"))
    builder.ExportInput(parts.get_input_port(), "inputs")
    builder.ExportOutput(servo.get_output_port(), "control")
    return _named(builder, "servo")


def make_frozen_filter(scenario: Scenario, K: np.ndarray, delta: np.ndarray) -> AffineSystem:
    """Return the filter of onboard/estimator/intermittent_filter.py with its gain and the arrivals frozen.

        xhat_{k+1} = Phi xhat + Gamma (u - u_hover) + K Delta (y - C xhat)
        i_{k+1}    = i + r - E y;  'hold': i where E = 0;  'estimate': i + r - p_hat

    Ports: input [y (p); u (4); reference (9)], output [xhat; i] (15).
    """
    Phi, Gamma = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
    measurement = scenario.measurement
    Delta, E, p = measurement.arrival_matrix(delta), measurement.selection_matrix(delta), measurement.sizes["y"]
    integrator = scenario.estimator.integrator
    F, G = np.eye(N_XBAR), np.zeros((N_XBAR, p + N_U + REFERENCE_SIZE))
    F[:N_X, :N_X] = Phi - K @ Delta @ measurement.layout.C
    G[:N_X, :p], G[:N_X, p : p + N_U] = K @ Delta, Gamma
    if integrator == "estimate":
        F[N_X:, :N_I] = -np.eye(N_I)
    else:
        G[N_X:, :p] = -E
    if integrator != "hold" or E.any():
        G[N_X:, p + N_U :] = np.eye(N_I, REFERENCE_SIZE)
    f_0 = -G[:, p] * scenario.vehicle.hover_thrust
    identity, no_feedthrough = np.eye(N_XBAR), np.zeros((N_XBAR, G.shape[1]))
    return AffineSystem(F, G, f_0, identity, no_feedthrough, np.zeros(N_XBAR), scenario.h)


def make_linear_loop(scenario: Scenario, K: np.ndarray, delta: np.ndarray) -> Diagram:
    """Return sampled plant, servo and frozen filter in a loop; discrete state [x; xhat; i] (27), in that order.

    Ports:
        reference (9): r, r_dot, r_ddot.
        state (12, output): x.

    Args:
        scenario: the scenario, of which rotors, links and noise are left out.
        K: predictor gain (12 x p) at full size; columns of sensors that did not arrive are ignored.
        delta: arrivals (s).
    """
    measurement = scenario.measurement
    builder = DiagramBuilder()
    plant = builder.AddSystem(QuadrotorPlant_[float](scenario.vehicle, scenario.world.kinematics, scenario.h))
    kalman = builder.AddNamedSystem("kalman_filter", make_frozen_filter(scenario, K, delta))
    servo = builder.AddSystem(make_lq_servo(scenario.servo, scenario.vehicle, scenario.h))
    sensors = builder.AddNamedSystem("sensors", MatrixGain(measurement.arrival_matrix(delta) @ measurement.layout.C))
    inputs = builder.AddSystem(Multiplexer([measurement.sizes["y"], N_U, REFERENCE_SIZE]))
    state = plant.GetOutputPort("state")
    builder.Connect(state, sensors.get_input_port())
    builder.Connect(sensors.get_output_port(), inputs.get_input_port(0))
    builder.Connect(servo.get_output_port(), inputs.get_input_port(1))
    builder.Connect(inputs.get_output_port(), kalman.get_input_port())
    builder.Connect(kalman.get_output_port(), servo.GetInputPort("estimate"))
    builder.Connect(servo.get_output_port(), plant.GetInputPort("control"))
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
