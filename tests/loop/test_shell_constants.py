"""Boxes without a step, as a Drake system: constants are no states, and can be given others."""

from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractValue

from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import Values, constant
from ortilo_drake.loop.wiring import Wiring


@pytest.mark.parametrize("differentiates", [False, True])
def test_a_constant_is_no_state_of_its_system_and_can_be_another(differentiates: bool) -> None:
    system: Any = system_of(Wiring([constant("three", [1.0, 2.0, 3.0])]), 0.1)
    system = system.ToAutoDiffXd() if differentiates else system
    context = system.CreateDefaultContext()

    def said() -> np.ndarray:
        values = system.get_output_port().Eval(context)
        return np.asarray(ExtractValue(values[:, None])[:, 0] if differentiates else values)

    assert context.is_stateless()
    np.testing.assert_array_equal(said(), [1.0, 2.0, 3.0])
    system.give(context, {"three": Values(start={"values": np.array([4.0, 5.0, 6.0])})})
    np.testing.assert_array_equal(said(), [4.0, 5.0, 6.0])
    system.give(context, {"three": Values(start={"values": np.array([7.0, 8.0, 9.0])})})
    np.testing.assert_array_equal(said(), [7.0, 8.0, 9.0])
    np.testing.assert_array_equal(system.state_of(system.CreateDefaultContext(), "three", "values"), [1.0, 2.0, 3.0])
