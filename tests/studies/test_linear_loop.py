"""Servo and rotors give the same in Drake's other scalars."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, InitializeAutoDiff
from pydrake.symbolic import Expression
from pydrake.systems.framework import System

from ortilo_drake.diagrams.single_parts import make_lq_servo
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import LqServo, Scenario
from ortilo_drake.world.vehicle.rotors import Rotors_


@pytest.mark.parametrize("form", ["paper", "error"])
@pytest.mark.parametrize("T", [AutoDiffXd, Expression])
def test_servo_of_another_scalar_gives_the_same_control(form: str, T: type) -> None:
    rng = np.random.default_rng(6)
    values = {"estimate": rng.normal(size=15), "reference": rng.normal(size=9), "velocity": rng.normal(size=8)}
    settings = LqServo(form=form, velocities="truth", yaw=0.1 * (form == "error"))
    servo = make_lq_servo(Scenario(servo=settings))
    assert_same_output(servo, servo.ToScalarType[T](), T, values)


def test_rotors_of_autodiff_give_the_same_wrench_and_lag() -> None:
    rotors = Rotors_[float](M100)
    other = rotors.ToAutoDiffXd()
    command = np.array([30.0, 0.4, -0.3, 0.1])
    assert_same_output(rotors, other, AutoDiffXd, {"control": command})
    rates = []
    for system, values in ((rotors, command), (other, InitializeAutoDiff(command[:, None])[:, 0])):
        context = system.CreateDefaultContext()
        system.get_input_port().FixValue(context, values)
        rates.append(system.EvalTimeDerivatives(context).CopyToVector())
    np.testing.assert_array_equal([rate.value() for rate in rates[1]], rates[0])


def assert_same_output(system: System, other: System, T: type, values: dict[str, np.ndarray]) -> None:
    outputs = []
    for each, scalar in ((system, float), (other, T)):
        context = each.CreateDefaultContext()
        for name, value in values.items():
            each.GetInputPort(name).FixValue(context, [scalar(v) for v in value])
        outputs.append(each.get_output_port().Eval(context))
    back = [v.value() if T is AutoDiffXd else v.Evaluate() for v in outputs[1]]
    np.testing.assert_allclose(back, outputs[0], rtol=1e-14, atol=1e-13)
