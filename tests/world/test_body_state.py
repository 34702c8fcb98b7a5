"""A body of a MultibodyPlant in our layout of a state, beside differences of its motion."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

import ortilo_drake as od


@pytest.mark.long
def test_the_state_of_a_tumbling_body_is_what_its_motion_says() -> None:
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(0.0))
    plant.AddRigidBody("other", SpatialInertia(1.0, [0.0, 0.0, 0.0], UnitInertia(1.0, 1.0, 1.0)))
    body = plant.AddRigidBody("body", SpatialInertia(1.2, [0.0, 0.0, 0.0], UnitInertia(0.01, 0.012, 0.02)))
    plant.Finalize()
    seen = builder.AddSystem(od.make_body_state(body.index()))
    for name in ("body_poses", "body_spatial_velocities", "body_spatial_accelerations"):
        builder.Connect(plant.GetOutputPort(name), seen.GetInputPort(name))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    plant.SetFreeBodyPose(own, body, RigidTransform(RollPitchYaw(0.3, -0.4, 0.5), [1.0, 2.0, 3.0]))
    plant.SetFreeBodySpatialVelocity(own, body, SpatialVelocity([0.7, -0.2, 0.4], [0.1, 0.2, 3.0]))
    simulator = Simulator(diagram, context)

    def at(time: float) -> np.ndarray:
        simulator.AdvanceTo(time)
        return np.array(seen.GetOutputPort("state").Eval(seen.GetMyContextFromRoot(simulator.get_context())))

    step = 1e-4
    states = [at(k * step) for k in range(3)]
    acceleration = seen.GetOutputPort("acceleration").Eval(seen.GetMyContextFromRoot(simulator.get_context()))
    np.testing.assert_allclose(states[0][:6], [1.0, 2.0, 3.0, 0.3, -0.4, 0.5], atol=1e-12)
    np.testing.assert_allclose(states[1][6:], (states[2] - states[0])[:6] / (2.0 * step), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(acceleration, [0.0, 0.0, -9.81], atol=1e-12)
