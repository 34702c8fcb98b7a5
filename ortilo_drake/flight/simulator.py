"""The simulator of a closed loop: its integrator, its seed and start, and one flight to its end."""

import time
from collections.abc import Callable

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

from ortilo_drake.diagrams.closed_loop import ClosedLoop
from ortilo_drake.flight.lost import Lost, find_loss
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.vehicle.continuous import steps_a_tick

CHECK_EVERY = 30  # ticks between two checks for a loss


def make_simulator(diagram: ClosedLoop, scenario: Scenario) -> Simulator:
    """Return a simulator of a closed loop that hovers at the start, with a Context of its own and the scenario's seed.

    A sampled plant leaves Drake nothing to integrate. A continuous one gets one third-order Runge-Kutta step a tick,
    whose error is far below any noise here; rotors, whose lag is shorter than a tick, get four. The diagram is the
    closed loop of the scenario, whatever seed it was built with.
    """
    simulator = Simulator(diagram)
    fix_steps(simulator, scenario)
    diagram.SetSeed(simulator.get_mutable_context(), scenario.seed)
    return simulator


def fix_steps(simulator: Simulator, scenario: Scenario) -> None:
    """Give a simulator its integrator; see make_simulator."""
    step = scenario.h / steps_a_tick(scenario)
    config = SimulatorConfig(integration_scheme="runge_kutta3", max_step_size=step, use_error_control=False)
    ApplySimulatorConfig(config, simulator)


def advance(
    simulator: Simulator, scenario: Scenario, ticks: int, progress: Callable[[int], None] | None
) -> tuple[Lost | None, float]:
    """Fly that many ticks, or until the flight is lost; return the loss and the seconds spent in AdvanceTo."""
    room, diagram, context = scenario.load_room(), simulator.get_system(), simulator.get_context()
    state = diagram.GetOutputPort("state")
    simulator.Initialize()
    wall = 0.0
    for k in range(0, ticks, CHECK_EVERY):
        end = min(k + CHECK_EVERY, ticks)
        # Python notices Ctrl-C between two calls of AdvanceTo; having Drake look for it costs more.
        started = time.perf_counter()
        simulator.AdvanceTo(end * scenario.h, interruptible=False)
        wall += time.perf_counter() - started
        if progress:
            progress(end)
        if find_loss(state.Eval(context)[np.newaxis], scenario.h, room, scenario.vehicle):
            break
    log = diagram.FindLog(context)
    return find_loss(log.data()[: len(STATE_NAMES)].T, scenario.h, room, scenario.vehicle), wall
