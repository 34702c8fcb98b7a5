"""The path of a scenario: planned before the flight, or given by a System tick by tick."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from pydrake.systems.framework import PortDataType, System
from pydrake.trajectories import Trajectory

from ortilo_drake.loop.element import Box
from ortilo_drake.loop.own import output_at_first
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.signals import N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.onboard.planner.seen import fix_sources
from ortilo_drake.scenario import Belief, GcsPlanner, HoverPlanner, WaypointPlanner
from ortilo_drake.scenario.own_parts import box_of

Planned: TypeAlias = Trajectory | System | Box
BUILT_IN = (GcsPlanner, HoverPlanner, WaypointPlanner)
_READ_AT_FIRST = {"estimate": N_XBAR, "covariance": N_XBAR**2, "belief": N_XBAR + N_XBAR**2, "force": 3}


def planned(scenario: Belief, make: Callable[[Belief], Planned] | None = None) -> Planned:
    """Return the plan of the scenario's planner, or of `make`: a Trajectory, a new System, or a Box for an element.

    InputError if there is no path, or the planner returns neither a path nor a System with a reference.
    """
    scenario = scenario.belief
    if make is None and not isinstance(scenario.planner, BUILT_IN):
        found = find_part("planner", scenario.planner.kind)
        if found is not None and found.box is not None:
            its: Box = box_of(found, f"planner.kind: {scenario.planner.kind}", scenario)
            return its
        make = found.make if found else None
    if make is None:
        return plan(scenario.planner, scenario.load_room(), scenario.vehicle, fix_sources(scenario))
    made = make(scenario)
    if isinstance(made, Trajectory) and (made.rows(), made.cols()) == (3, 1):
        return made
    if isinstance(made, System) and made.HasOutputPort("reference"):
        port = made.GetOutputPort("reference")
        if port.get_data_type() == PortDataType.kVectorValued and port.size() == REFERENCE_SIZE:
            return made
    raise InputError(
        f"planner: returns {type(made).__name__}: must be a Trajectory of 3 rows, or a System with an output "
        f"'reference' of {REFERENCE_SIZE} numbers"
    )


def path_of(scenario: Belief) -> Trajectory:
    """Return the path p_WB(t) (3 rows) [m] of the scenario's planner; InputError if it plans none before the flight."""
    path = planned(scenario)
    if not isinstance(path, Trajectory):
        what = "an element" if isinstance(path, Box) else "a System"
        raise InputError(
            f"planner.kind: {scenario.planner.kind}: is {what}: this needs a path planned before the flight"
        )
    return path


def start_of(plan: Planned) -> np.ndarray:
    """Return p_WB (3) [m] at the start; for a System or a Box, its first reference position, with inputs of zeros.

    InputError if the reference of a Box depends on an input that is not known before the flight.
    """
    if isinstance(plan, Box):
        element = plan.element
        for port in element.inputs_of(element.out) if element.out else ():
            if port not in _READ_AT_FIRST:
                raise InputError(f"planner: out reads {port!r}, must be one of {', '.join(_READ_AT_FIRST)}")
        return output_at_first(plan, "out", _READ_AT_FIRST)[0:3]
    if isinstance(plan, Trajectory):
        return np.array(plan.value(plan.start_time())[:, 0])
    context = plan.CreateDefaultContext()
    for i in range(plan.num_input_ports()):
        port = plan.get_input_port(i)
        is_vector = port.get_data_type() == PortDataType.kVectorValued
        port.FixValue(context, np.zeros(port.size()) if is_vector else plan.AllocateInputAbstract(port))
    return np.array(plan.GetOutputPort("reference").Eval(context)[0:3])


def duration_of(scenario: Belief, plan: Planned) -> float:
    """Return the time for which the flight follows its reference [s], before it settles.

    A System or a Box has no end time. It uses the `duration` in its settings, or, if the scenario has a built-in
    planner's settings, the duration of that planner's path. InputError if the settings have no duration.
    """
    if not isinstance(plan, Trajectory) and isinstance(scenario.planner, BUILT_IN):
        plan = path_of(scenario)
    if isinstance(plan, Trajectory):
        return float(plan.end_time())
    duration = getattr(scenario.planner, "duration", None)
    if not isinstance(duration, float | int) or not duration > 0.0:
        raise InputError(
            f"planner: {scenario.planner.kind}: its settings need a field 'duration' [s], greater than 0: it does not "
            "tell when it ends itself"
        )
    return float(duration)
