"""The loop opened at the plant's input against the same loop put together of Drake's blocks."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Demultiplexer, LinearSystem, MatrixGain, Multiplexer

from ortilo_drake.diagrams.linear_loop import make_frozen_filter
from ortilo_drake.scenario import IntermittentFilter, LqServo, Scenario
from ortilo_drake.studies.linearization.linearize import differentiate_tick
from ortilo_drake.studies.loop.hover_loop import VELOCITIES, hover_loop, open_loop

K = np.random.default_rng(1).normal(size=(12, 9))


@pytest.mark.parametrize("delta", [(1.0, 1.0, 1.0), (0.0, 1.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("velocities", ["estimate", "truth"])
@pytest.mark.parametrize("integrator", ["literal", "hold", "estimate"])
def test_open_loop_is_that_of_drakes_blocks(integrator: str, velocities: str, delta: tuple[float, ...]) -> None:
    estimator = IntermittentFilter(integrator=integrator)
    scenario = Scenario(estimator=estimator, servo=LqServo(velocities=velocities))
    loop, arrived = hover_loop(scenario), np.repeat(delta, 3)
    assert loop.true_states == (VELOCITIES if velocities == "truth" else ())
    true = np.isin(np.arange(12), loop.true_states).astype(float)
    builder = DiagramBuilder()
    plant = builder.AddSystem(LinearSystem(loop.Phi, loop.Gamma, np.eye(12), np.zeros((12, 4)), loop.h))
    kalman = builder.AddSystem(make_frozen_filter(scenario, K, np.array(delta)))
    sensors = builder.AddSystem(MatrixGain(arrived[:, None] * loop.C))
    estimate = builder.AddSystem(Demultiplexer([12, 3]))
    seen = builder.AddSystem(Multiplexer([12, 12, 3]))  # what the servo sees: the truth, the estimate, the integral
    choice = np.block([[np.diag(true), np.diag(1.0 - true), np.zeros((12, 3))], [np.zeros((3, 24)), np.eye(3)]])
    output = builder.AddSystem(MatrixGain(loop.L @ choice))
    command = builder.AddSystem(MatrixGain(-np.eye(4)))
    inputs = builder.AddSystem(Multiplexer([9, 4, 9]))
    reference = builder.AddSystem(MatrixGain(np.zeros((9, 4))))  # of anything: the reference is 0
    for source, port in (
        (plant.get_output_port(), sensors.get_input_port()),
        (sensors.get_output_port(), inputs.get_input_port(0)),
        (command.get_output_port(), inputs.get_input_port(1)),
        (command.get_output_port(), reference.get_input_port()),
        (reference.get_output_port(), inputs.get_input_port(2)),
        (inputs.get_output_port(), kalman.get_input_port()),
        (kalman.get_output_port(), estimate.get_input_port()),
        (plant.get_output_port(), seen.get_input_port(0)),
        (estimate.get_output_port(0), seen.get_input_port(1)),
        (estimate.get_output_port(1), seen.get_input_port(2)),
        (seen.get_output_port(), output.get_input_port()),
        (output.get_output_port(), command.get_input_port()),
    ):
        builder.Connect(source, port)
    builder.ExportInput(plant.get_input_port(), "control")
    builder.ExportOutput(output.get_output_port(), "fed_back")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.get_input_port().FixValue(context, np.zeros(4))
    A, B, C, D = differentiate_tick(diagram, context)
    for ours, drakes in zip(open_loop(loop, K, np.array(delta)), (A, B, C), strict=True):
        np.testing.assert_allclose(ours, drakes, rtol=1e-12, atol=1e-13)
    assert not D.any()
