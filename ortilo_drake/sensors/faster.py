"""The description of a sensor faster than the tick, for the filter: the mean of the samples in each tick.

The n samples of a tick are taken at t_k - h + h / n, ..., t_k. Their mean measures the state (n - 1) h / (2 n) ago, to
first order in the state's change over a tick, with 1 / n of one sample's noise covariance. The rows of C include this
age (model/measurement.py, seen_earlier), so filter, gates, theory bench and tube know it; nothing is corrected with the
estimate. A solver gets the mean payload. A covariance that comes with a fix is divided by n as a whole. But the part
due to the filter's own error is common to all samples, so this covariance is too small. An integrator of measured
positions does not use a mean over the tick.
"""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import Gain

from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.onboard.sample_mean import SampleMean
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.messages import message_port, message_size, solver_of


def with_samples(sensor: Sensor, n: int) -> Sensor:
    """Return the description of a sensor that sends n samples per tick, given the description of a single sample.

    Rows, limits and make_world stay those of a sample: Scenario.measurement has the rows with their age, and
    diagrams/world.py collects the samples.
    """

    def V(scenario: Belief) -> np.ndarray | None:
        of_one = sensor.V(scenario)
        return None if of_one is None else of_one / n

    def covariance(scenario: Belief, room: Room, x: np.ndarray) -> np.ndarray | None:
        of_one = None if sensor.covariance is None else sensor.covariance(scenario, room, x)
        return None if of_one is None else of_one / n

    def sd(scenario: Belief, room: Room, states: np.ndarray) -> np.ndarray:
        assert sensor.sd is not None
        return np.asarray(sensor.sd(scenario, room, states) / np.sqrt(n))

    return replace(
        sensor,
        V=V,
        sd=None if sensor.sd is None else sd,
        covariance=None if sensor.covariance is None else covariance,
        make_onboard=lambda scenario, room: make_mean_fix(sensor, n, scenario, room),
        compiled=None,
    )


def make_mean_fix(sensor: Sensor, n: int, scenario: Belief, room: Room) -> Diagram:
    """Return the Diagram that computes the fix of a tick from a message of n samples.

    Ports:
        <message> (2 + n (2 + p)): n samples.
        estimate (15), covariance (225): if the sensor's own solver reads them.
        fix (output): the fix of the sensor's own solver with its covariance divided by n; without a solver, the mean
            message.

    Args:
        sensor: the description of a single sample.
        n: number of samples in a message.
        scenario: the scenario.
        room: the scenario's room.
    """
    builder = DiagramBuilder()
    solver = solver_of(sensor, scenario, room)
    name = sensor.name if solver is None else message_port(solver).get_name()
    mean = builder.AddSystem(SampleMean(name, message_size(sensor, scenario, room), n))
    builder.ExportInput(mean.get_input_port(), name)
    fix = mean.get_output_port()
    if solver is not None:
        builder.AddSystem(solver)
        builder.Connect(fix, message_port(solver))
        for port in ("estimate", "covariance"):
            if solver.HasInputPort(port):
                builder.ExportInput(solver.GetInputPort(port), port)
        fix = solver.get_output_port()
    if sensor.V(scenario) is None:  # the covariance comes after the value
        share = np.ones(fix.size())
        share[PAYLOAD + len(sensor.rows) :] = 1.0 / n
        of_mean = builder.AddSystem(Gain(share))
        builder.Connect(fix, of_mean.get_input_port())
        fix = of_mean.get_output_port()
    builder.ExportOutput(fix, "fix")
    diagram = builder.Build()
    diagram.set_name(f"{sensor.name}_fix")
    return diagram
