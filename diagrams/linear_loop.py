"""The parts of the flying diagram that Drake can differentiate, wired for linearisation.

Plant, rotors and servo are the very systems that fly; they come in Drake's AutoDiffXd as well. What Drake cannot
differentiate is left out: sensors and fixes stand as y = Delta C x, which is what they are without noise, and the
filter with its gain frozen is an affine system.
"""

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import AffineSystem, MatrixGain

from ortilo_drake.diagrams.wiring.onboard import servo_boxes
from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.diagram import add_wiring
from ortilo_drake.loop.element import bundle, constant, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_I, N_U, N_X, PAYLOAD, REFERENCE_SIZE, STATE_NAMES
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
    plant, rotors = (
        builder.AddSystem(QuadrotorPlant_[float](vehicle, kinematics)),
        builder.AddSystem(Rotors_[float](vehicle)),
    )
    builder.Connect(rotors.get_output_port(), plant.GetInputPort("control"))
    builder.ExportInput(rotors.get_input_port(), "control")
    builder.ExportOutput(plant.GetOutputPort("state"), "state")
    return builder.Build()


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
    N, y, rows = len(names), measurement.sizes["y"], measurement.arrival_matrix(delta) @ measurement.layout.C
    columns = list(range(N_X))
    plant = QuadrotorPlant_[float](scenario.vehicle, scenario.world.kinematics, scenario.h)
    signals = {"control": ("servo", N_U), "disturbance": ("calm", 6)}
    seen = [system_box("plant", plant, ("state",), signals)]
    if set(F) <= set(names):
        B, f_0 = np.eye(3, N_U, -2), np.array([0.0, 0.0, -scenario.vehicle.hover_thrust])  # (f_T - m g) e_z, flown
        zeros, identity = np.zeros((3, 3)), np.eye(3)
        flown = AffineSystem(zeros, B, f_0, identity, np.zeros((3, N_U)), np.zeros(3), scenario.h)
        seen = [*seen, system_box("flown_force", flown, ("y0",), {"u0": ("servo", N_U)})]
        columns += [names.index(name) for name in F]
    sensors = system_box("sensors", MatrixGain(rows[:, columns]), ("y0",), {"u0": ("seen", len(columns))})
    kalman = make_frozen_filter(scenario, K, delta)
    inputs = ("inputs", y + N_U + REFERENCE_SIZE)
    boxes = [
        *seen,
        constant("calm", np.zeros(6)),
        sensors,
        system_box("kalman_filter", kalman, ("y0",), {"u0": inputs}),
    ]
    picks = {"estimate": [*range(N_X), *range(N, N + N_I)]} | ({"force": [names.index(d) for d in D]} if extras else {})
    for name, numbers in picks.items():
        pick = MatrixGain(np.eye(N + N_I)[numbers])
        boxes.append(system_box(name, pick, ("y0",), {"u0": ("kalman_filter", N + N_I)}))
    if scenario.lends_velocities:  # in a message whose flag and stamp are not read
        message = MatrixGain(np.vstack([np.zeros((PAYLOAD, N_X)), np.eye(N_V, N_X, N_V)]))
        boxes.append(system_box("velocity", message, ("y0",), {"u0": ("plant", N_X)}))
    reference, no_force = outside("reference", REFERENCE_SIZE), constant("no_force", np.zeros(3))
    servo = servo_boxes(scenario.belief, "estimate", "force" if extras else "no_force", {}, None, {})
    boxes += [*servo, reference, no_force, bundle("seen", seen), bundle("inputs", [sensors, servo[-1], reference])]
    builder = DiagramBuilder()
    added = add_wiring(builder, Wiring(boxes), {"state": "plant"}, scenario.h)
    builder.ExportOutput(added.outputs["state"], "state")
    return builder.Build()
