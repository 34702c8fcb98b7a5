"""Ticks of a short flight for the tests of logs: the halves' own, on boxes, with some pictures and two goals."""

from functools import cache
from typing import NamedTuple

import numpy as np

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.flight import fly, make_simulator
from ortilo_drake.flight.signals import output_sizes
from ortilo_drake.scenario import Scenario, load_scenario


class Tick(NamedTuple):
    k: int
    state: np.ndarray
    messages: dict[str, np.ndarray]
    outputs: dict[str, np.ndarray]


SETTINGS = ("settle=0", "planner={kind: hover, duration: 3.0}", "camera.kind=projected")


GOALS = {40: (1.25, -0.1), 55: (-3.0, 1e-3)}  # by tick


@cache
def scenario() -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", SETTINGS)


@cache
def flight():
    return fly(scenario())


@cache
def ticks() -> list[Tick]:
    """Return what crossed at every tick, read off the closed loop's own ports."""
    diagram = make_closed_loop(scenario())
    simulator = make_simulator(diagram, scenario())
    simulator.Initialize()
    context = simulator.get_context()
    halves = {name: diagram.GetSubsystemByName(name) for name in ("world", "onboard")}

    def value(half: str, name: str) -> np.ndarray:
        return np.array(halves[half].GetOutputPort(name).Eval(halves[half].GetMyContextFromRoot(context)))

    sensors = [name for name in ("imu", "uwb", "detections", "velocity") if halves["world"].HasOutputPort(name)]
    rng = np.random.default_rng(3)
    found = []
    for k in range(flight().sizes["tick"]):
        if k:  # at 0 it would already update
            simulator.AdvanceTo(k * scenario().h)
        messages = {name: m for name in sensors if (m := value("world", name)).any()}
        if k % 30 == 4:
            messages["shutter"] = np.array([1.0, k * scenario().h])
            messages["image"] = rng.integers(0, 256, (24, 32, 4), dtype=np.uint8)
            if k == 4:
                messages["image"][..., 3] = 255
        if k in GOALS:
            messages["goal"] = np.array(GOALS[k])
        outputs = {name: value("onboard", name) for name in output_sizes(scenario().measurement)}
        found.append(Tick(k, value("world", "state"), messages, outputs))
    return found
