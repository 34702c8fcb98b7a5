"""A quadrotor of 1.2 kg as a body of Drake's MultibodyPlant: it bumps into a wall, and lands on the floor.

    python examples/multibody.py [--meshcat]

Drake moves the body, its contacts and its four Propellers, and draws it. Sensors, filter and servo are the laboratory's
single parts (docs/how_to/single_parts.md). None of them models the wall or the floor.
"""

import sys

import numpy as np
from pydrake.geometry import Box, MeshcatVisualizer, StartMeshcat
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, Propeller, PropellerInfo
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, MatrixGain, TrajectorySource, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

import ortilo_drake as od

H, STEP, SIZE, GRIP = 0.02, 0.002, [0.5, 0.5, 0.2], CoulombFriction(0.6, 0.5)  # s, s, m
ROTORS, DRAG = [(0.17, 0.17, -1), (-0.17, 0.17, 1), (-0.17, -0.17, -1), (0.17, -0.17, 1)], 0.04  # x, y [m], spin; m
WALL, REST = 1.5 - SIZE[0] / 2, SIZE[2] / 2  # x at which it touches the wall, z at which it stands [m]
TIMES = [0.0, 4.0, 8.0, 8.5, 12.0, 18.0, 22.0]  # s: to the wall, 0.15 m into it, back, down, and at rest
POINTS = np.array([[0, 0, 1], [0, 1, 1], [1.4, 1, 1], [1.4, 1, 1], [0, 0, 1], [0, 0, REST], [0, 0, REST]], dtype=float)
ANCHORS = [[x, y, z] for x, z in ((-4, 0.2), (4, 2.8)) for y in (-3, 3)] + [[-4, 0, 2.8], [4, 0, 0.2]]
VEHICLE = od.Vehicle(mass=1.2, inertia=(0.012, 0.013, 0.022))


def main(seed: int = 0, meshcat: bool = False) -> dict[str, tuple[float, float]]:
    """Fly; print and return the RMS error of the estimate [m] and its NEES in the air, at the wall and on the floor."""
    builder = DiagramBuilder()
    plant, scene = AddMultibodyPlantSceneGraph(builder, STEP)
    moments = UnitInertia(*(moment / VEHICLE.mass for moment in VEHICLE.inertia))
    body = plant.AddRigidBody("quadrotor", SpatialInertia(VEHICLE.mass, [0, 0, 0], moments))
    world, floor, wall = plant.world_body(), ([10, 8, 1], [0, 0, -0.5]), ([0.2, 8, 3], [1.6, 0, 1.5])
    for i, (its, size, place) in enumerate([(body, SIZE, [0, 0, 0]), (world, *floor), (world, *wall)]):
        plant.RegisterCollisionGeometry(its, RigidTransform(place), Box(*size), f"solid_{i}", GRIP)
        plant.RegisterVisualGeometry(its, RigidTransform(place), Box(*size), f"solid_{i}", [0.5, 0.5, 0.6, 0.7])
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(POINTS[0]))
    plant.Finalize()
    places = [PropellerInfo(body.index(), RigidTransform([x, y, 0]), 1.0, spin * DRAG) for x, y, spin in ROTORS]
    mixing = np.linalg.inv([[1, 1, 1, 1], *np.transpose([[y, -x, spin * DRAG] for x, y, spin in ROTORS])])
    path = PiecewisePolynomial.CubicShapePreserving(TIMES, POINTS.T, zero_end_point_derivatives=True)
    drakes = (ZeroOrderHold(H, 4), MatrixGain(mixing), Propeller(places), TrajectorySource(path, 2, True))
    hold, mixer, propellers, reference = map(builder.AddSystem, drakes)
    kalman = od.make_estimator(VEHICLE, ANCHORS, h=H, x_0=[*POINTS[0], *[0] * 9], scenario="nominal_imu_uwb")
    uwb, imu = od.make_sensor("uwb", ANCHORS, H, seed), od.make_sensor("imu", None, H, seed)
    ours = (od.make_body_state(body.index()), uwb, imu, kalman, od.make_servo(VEHICLE, H))
    seen, uwb, imu, kalman, servo = map(builder.AddSystem, ours)
    for said, *readers in (  # outputs, and each system that reads one, at a port of its name or at another
        *((plant.GetOutputPort(f"body_{name}"), seen) for name in ("spatial_velocities", "spatial_accelerations")),
        (plant.GetOutputPort("body_poses"), seen, propellers),
        (seen.GetOutputPort("state"), uwb, imu),
        (seen.GetOutputPort("acceleration"), imu),
        *((sensor.get_output_port(), kalman) for sensor in (uwb, imu)),
        (kalman.GetOutputPort("estimate"), servo),
        (reference.get_output_port(), kalman.GetInputPort("reference"), servo.GetInputPort("reference")),
        (servo.GetOutputPort("control"), kalman, hold.get_input_port()),
        (hold.get_output_port(), mixer.get_input_port()),
        (mixer.get_output_port(), propellers.GetInputPort("command")),
        (propellers.get_output_port(), plant.get_applied_spatial_force_input_port()),
    ):
        for to in readers:
            builder.Connect(said, to.GetInputPort(said.get_name()) if hasattr(to, "GetInputPort") else to)
    logged = (seen.GetOutputPort("state"), kalman.GetOutputPort("estimate"), kalman.GetOutputPort("covariance"))
    logs = [LogVectorOutput(port, builder, publish_period=H) for port in logged]
    if meshcat:
        MeshcatVisualizer.AddToBuilder(builder, scene, StartMeshcat())
    simulator = Simulator(builder.Build())
    at_first = [VEHICLE.hover_thrust, 0, 0, 0]  # else the rotors stand still for a tick
    hold.SetVectorState(hold.GetMyMutableContextFromRoot(simulator.get_mutable_context()), at_first)
    simulator.set_target_realtime_rate(1.0 if meshcat else 0.0)
    simulator.AdvanceTo(TIMES[-1])
    x, xhat, P = (log.FindLog(simulator.get_context()).data().T for log in logs)
    error = (x - xhat[:, :12])[:, :3]
    nees = np.array([e @ np.linalg.solve(p.reshape(15, 15)[:3, :3], e) for e, p in zip(error, P, strict=True)])
    at_wall, on_floor, found = x[:, 0] > WALL - 0.01, x[:, 2] < REST + 0.01, {}
    for where, ticks in (("in the air", ~on_floor & ~at_wall), ("at the wall", at_wall), ("on the floor", on_floor)):
        found[where] = float(np.sqrt(np.mean(np.sum(error[ticks] ** 2, axis=1)))), float(np.mean(nees[ticks]))
        rms, mean_nees = found[where]
        print(f"{where:12} {ticks.sum() * H:5.1f} s: {rms:.3f} m off (RMS), NEES {mean_nees:.1f} (3 if consistent)")
    return found


if __name__ == "__main__":
    main(meshcat="--meshcat" in sys.argv)
