"""The plant against Drake's linearisation, its C++ quadrotor and the conservation laws."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, InitializeAutoDiff
from pydrake.examples import QuadrotorPlant as DrakeQuadrotor
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.symbolic import Evaluate, Expression, Jacobian, MakeVectorContinuousVariable
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Linearize, MatrixGain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from scipy.integrate import solve_ivp

import ortilo_drake as od
from ortilo_drake.model.equations import DYNAMICS, rigid_body_dynamics, small_angle_dynamics
from ortilo_drake.model.hover import discretize, hover_A, hover_B, hover_B_d
from ortilo_drake.model.vehicle import M100
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_

INERTIA = np.array(M100.inertia)
HOVER = np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
ACCURATE = SimulatorConfig(
    integration_scheme="runge_kutta5", max_step_size=0.01, accuracy=1e-11, use_error_control=True
)


@pytest.mark.parametrize("kinematics", DYNAMICS)
def test_drake_linearises_the_plant_at_hover_to_A_and_B(kinematics: str) -> None:
    plant = QuadrotorPlant_[float](vehicle=M100, kinematics=kinematics)
    context = plant.CreateDefaultContext()
    plant.GetInputPort("control").FixValue(context, HOVER)
    plant.GetInputPort("disturbance").FixValue(context, np.zeros(6))
    at_hover = Linearize(
        plant, context, plant.GetInputPort("control").get_index(), plant.GetOutputPort("state").get_index()
    )
    np.testing.assert_allclose(at_hover.A(), hover_A(), atol=1e-12)
    np.testing.assert_allclose(at_hover.B(), hover_B(M100), atol=1e-12)
    np.testing.assert_array_equal(at_hover.C(), np.eye(12))


@pytest.mark.parametrize("kinematics", DYNAMICS)
def test_disturbance_enters_by_B_d(kinematics: str) -> None:
    plant = QuadrotorPlant_[float](vehicle=M100, kinematics=kinematics).ToScalarType[AutoDiffXd]()
    context = plant.CreateDefaultContext()
    plant.GetInputPort("control").FixValue(context, HOVER)
    plant.GetInputPort("disturbance").FixValue(context, InitializeAutoDiff(np.zeros((6, 1))))
    x_dot = plant.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(ExtractGradient(x_dot), hover_B_d(M100), atol=1e-12)


@pytest.mark.parametrize("kinematics", DYNAMICS)
def test_symbolic_jacobian_at_hover_is_A_and_B(kinematics: str) -> None:
    plant = QuadrotorPlant_[float](vehicle=M100, kinematics=kinematics).ToScalarType[Expression]()
    assert isinstance(plant, QuadrotorPlant_[Expression])
    context = plant.CreateDefaultContext()
    x, u = MakeVectorContinuousVariable(12, "x"), MakeVectorContinuousVariable(4, "u")
    context.SetContinuousState([Expression(v) for v in x])
    plant.GetInputPort("control").FixValue(context, [Expression(v) for v in u])
    # Drake boxes an Expression's cell in a NaN; NumPy's ufuncs see the flag that comparing it raises.
    with np.errstate(invalid="ignore"):
        x_dot = plant.EvalTimeDerivatives(context).CopyToVector()
    hover = dict(zip([*x, *u], [0.0] * 12 + HOVER.tolist(), strict=True))
    np.testing.assert_allclose(Evaluate(Jacobian(x_dot, x), hover), hover_A(), atol=1e-12)
    np.testing.assert_allclose(Evaluate(Jacobian(x_dot, u), hover), hover_B(M100), atol=1e-12)


@pytest.mark.parametrize("kinematics", DYNAMICS)
@pytest.mark.parametrize("T", [AutoDiffXd, Expression])
def test_other_scalars_give_the_same_derivatives(kinematics: str, T: type) -> None:
    rng = np.random.default_rng(2)
    x, u = rng.uniform(-0.8, 0.8, 12), HOVER + rng.uniform(-2.0, 2.0, 4)
    plant = QuadrotorPlant_[float](vehicle=M100, kinematics=kinematics)
    other = plant.ToScalarType[T]()
    derivatives = []
    for system, scalar in ((plant, float), (other, T)):
        context = system.CreateDefaultContext()
        context.SetContinuousState([scalar(v) for v in x])
        system.GetInputPort("control").FixValue(context, [scalar(v) for v in u])
        derivatives.append(system.EvalTimeDerivatives(context).CopyToVector())
    value = [d.value() if T is AutoDiffXd else d.Evaluate() for d in derivatives[1]]
    np.testing.assert_allclose(value, derivatives[0], rtol=1e-13, atol=1e-13)


def swinging_control() -> PiecewisePolynomial:
    """Thrust about hover and torques that swing roll and pitch to about 1 rad within 5 s, as a smooth spline."""
    t = np.linspace(0.0, 5.0, 101)
    roll, pitch = 0.9 * np.sin(1.7 * t), 0.8 * np.sin(2.3 * t + 0.4)
    u = np.array(
        [
            HOVER[0] + 6.0 * np.sin(3.0 * t),
            -INERTIA[0] * 1.7**2 * roll,
            -INERTIA[1] * 2.3**2 * pitch,
            0.1 * np.sin(1.1 * t),
        ]
    )
    return PiecewisePolynomial.CubicShapePreserving(t, u)


def test_rigid_body_flies_as_drakes_cpp_quadrotor_through_large_angles() -> None:
    # The twin has its rotors in '+' configuration: front, left, rear, right; front and rear drag it to +z.
    arm, kF, kM = M100.arm_length, 1.3, 0.4
    mixing = np.array([[kF] * 4, [0.0, arm * kF, 0.0, -arm * kF], [-arm * kF, 0.0, arm * kF, 0.0], [kM, -kM, kM, -kM]])
    builder = DiagramBuilder()
    control = builder.AddSystem(TrajectorySource(swinging_control()))
    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle=M100, kinematics="rigid_body"))
    twin = builder.AddSystem(DrakeQuadrotor(M100.mass, arm, np.diag(INERTIA), kF, kM))
    to_rotors = builder.AddSystem(MatrixGain(np.linalg.inv(mixing)))
    builder.Connect(control.get_output_port(), plant.GetInputPort("control"))
    builder.Connect(control.get_output_port(), to_rotors.get_input_port())
    builder.Connect(to_rotors.get_output_port(), twin.get_input_port(0))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(ACCURATE, simulator)
    context = simulator.get_mutable_context()
    x_0 = np.zeros(12)
    x_0[3:6], x_0[9:12] = [0.0, 0.3, 0.5], [1.5, 1.7, 0.2]
    mine, its = plant.GetMyMutableContextFromRoot(context), twin.GetMyMutableContextFromRoot(context)
    mine.SetContinuousState(x_0)
    its.SetContinuousState(x_0)
    largest = np.zeros(2)
    for t in np.linspace(0.1, 5.0, 50):
        simulator.AdvanceTo(t)
        x = mine.get_continuous_state_vector().CopyToVector()
        x_its = its.get_continuous_state_vector().CopyToVector()
        largest = np.maximum(largest, np.abs(x[3:5]))
        np.testing.assert_allclose(x[:3], x_its[:3], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(x[3:], x_its[3:], rtol=0.0, atol=1e-5)
    assert np.all(largest > 0.7), f"the motion was gentle: {largest}"
    assert np.all(largest < 1.5)


def test_small_angle_is_the_rigid_body_to_second_order() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        dx, du = rng.normal(size=12), rng.normal(size=4)

        def gap(scale: float, dx: np.ndarray = dx, du: np.ndarray = du) -> float:
            arguments = (scale * dx, HOVER + scale * du, np.zeros(6), M100.mass, INERTIA)
            return float(np.linalg.norm(rigid_body_dynamics(*arguments) - small_angle_dynamics(*arguments)))

        assert 0.0 < gap(1e-3) < 2e-5
        assert gap(1e-3) / gap(1e-4) == pytest.approx(100.0, rel=0.02)  # the difference is of second order


def test_free_rotation_conserves_energy_and_angular_momentum() -> None:
    builder = DiagramBuilder()
    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle=M100, kinematics="rigid_body"))
    free = builder.AddSystem(ConstantVectorSource(np.zeros(4)))
    builder.Connect(free.get_output_port(), plant.GetInputPort("control"))
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(ACCURATE, simulator)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    # Spinning about z, with a wobble: the tilt stays away from the singularity.
    context.SetContinuousState([0.0, 0.0, 100.0, 0.1, 0.2, 0.0, 1.0, -2.0, 3.0, 0.6, -0.4, 4.0])

    def conserved() -> np.ndarray:
        x = context.get_continuous_state_vector().CopyToVector()
        attitude = RollPitchYaw(x[3:6])
        w_B = attitude.CalcAngularVelocityInChildFromRpyDt(x[9:12])
        momentum_W = attitude.ToRotationMatrix().matrix() @ (INERTIA * w_B)
        translation = M100.mass * (0.5 * x[6:9] @ x[6:9] + 9.81 * x[2])
        return np.array([*momentum_W, 0.5 * INERTIA @ w_B**2, translation])

    at_first, yaw = conserved(), 0.0
    for t in np.linspace(0.25, 5.0, 20):
        simulator.AdvanceTo(t)
        np.testing.assert_allclose(conserved(), at_first, rtol=1e-8, atol=1e-9)
        x = context.get_continuous_state_vector().CopyToVector()
        assert abs(x[4]) < 1.4
        yaw = x[5]
    assert abs(yaw) > 2 * np.pi


@pytest.mark.parametrize("kinematics", DYNAMICS)
def test_the_sampled_plant_linearises_to_phi_and_gamma(kinematics: str) -> None:
    h = 1.0 / 30.0
    plant = QuadrotorPlant_[float](M100, kinematics, time_step=h)
    context = plant.CreateDefaultContext()
    plant.SetState(context, np.array([3.0, 1.0, 1.5] + [0.0] * 9))
    plant.GetInputPort("control").FixValue(context, [M100.hover_thrust, 0.0, 0.0, 0.0])
    plant.GetInputPort("disturbance").FixValue(context, np.zeros(6))
    system = Linearize(
        plant,
        context,
        plant.GetInputPort("control").get_index(),
        plant.GetOutputPort("state").get_index(),
        equilibrium_check_tolerance=1e-9,
    )
    Phi, Gamma = discretize(hover_A(), hover_B(M100), h)
    np.testing.assert_allclose(system.A(), Phi, atol=1e-12)
    np.testing.assert_allclose(system.B(), Gamma, atol=1e-12)


@pytest.mark.parametrize("kinematics", DYNAMICS)
def test_a_step_of_the_sampled_plant_agrees_with_scipy(kinematics: str) -> None:
    x = np.array([0.0, 0.0, 1.5, 0.05, -0.04, 0.1, 0.3, -0.2, 0.1, 0.4, -0.3, 0.2])
    u, d, h = np.array([27.0, 0.02, -0.03, 0.01]), np.array([0.2, -0.1, 0.3, 0.004, 0.002, -0.003]), 1.0 / 30.0
    inertia = np.array(M100.inertia)
    exact = solve_ivp(
        lambda _, y: DYNAMICS[kinematics](y, u, d, M100.mass, inertia), (0.0, h), x, rtol=1e-12, atol=1e-14
    ).y[:, -1]
    plant = QuadrotorPlant_[float](M100, kinematics, time_step=h)
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    plant.SetState(context, x)
    plant.GetInputPort("control").FixValue(context, u)
    plant.GetInputPort("disturbance").FixValue(context, d)
    simulator.AdvanceTo(0.5 * h)
    np.testing.assert_allclose(context.get_discrete_state_vector().CopyToVector(), exact, atol=2e-8)


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
