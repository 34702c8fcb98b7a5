"""Compiles numba's functions once, before the workers of the tests start; the workers then load them from the disk.

No test depends on this: a function that is missing here is compiled at its first call.
"""

import contextlib
import gc
import io
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from command_line import run

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import make_simulator
from ortilo_drake.hil.real_time.warm_up import warm_up
from ortilo_drake.onboard.estimator.filter_model import filter_model
from ortilo_drake.onboard.estimator.intermittent_filter import filter_step
from ortilo_drake.scenario import load_scenario
from ortilo_drake.theory.arrivals.arrival_simulation import draw_independent, simulate
from ortilo_drake.theory.arrivals.arrivals import Model, check_model

PROJECTED = "camera.kind=projected"
SHORT = ("--set", "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}")
VARIANTS = (
    ("estimator.delay=replay", "uwb.link.delay=2"),
    ("command_link.loss={kind: bernoulli, probability: 0.5}",),
    ("world.kinematics=rigid_body",),
)


def fly_moment(name: str, changes: tuple[str, ...] = ()) -> None:
    """Fly a scenario for a moment in Drake, so that all its elements are compiled."""
    scenario = load_scenario(name, (PROJECTED, *changes))
    make_simulator(make_closed_loop(scenario), scenario).AdvanceTo(12.5 * scenario.h)


def fly_variants() -> None:
    """Fly other forms of the filter and of the world for a moment."""
    for changes in VARIANTS:
        fly_moment("nominal_imu_uwb", changes)


def run_commands() -> None:
    """Run the commands fly, replay and tune, and warm up the halves of a flight."""
    warm_up(load_scenario("nominal_imu_uwb"))
    with tempfile.TemporaryDirectory() as folder:
        flight, log = f"{folder}/flight.nc", f"{folder}/log"
        assert run("fly", "nominal_imu_uwb", *SHORT, "--log", log, "--out", flight) == 0
        assert run("replay", log) == 0
        assert run("tune", flight, "--out", f"{folder}/tuned.yaml") == 0
        assert run("fly", "nominal_imu_uwb_yolo", "--camera", "projected", *SHORT) == 0  # for the floor with a camera


def compile_flight() -> None:
    """Compile a whole flight of one kind; other kinds are compiled where they are flown."""
    engine = Engine(load_scenario("nominal_imu_uwb", (SHORT[1],)))
    engine.figures([0])
    engine.fly(0)


def step_by_name() -> None:
    """Call the filter with named tuples as tests and notebooks do; numba compiles it for these types too."""
    scenario = load_scenario("nominal_imu_uwb_yolo", (PROJECTED,))
    model = filter_model(scenario.estimator, scenario.vehicle, scenario.estimator.integrator, scenario.h)
    layout, sizes = scenario.measurement.layout, scenario.measurement.sizes
    belief, y, delta, V2 = (np.zeros(size) for size in (15 + 15 * 15, sizes["y"], sizes["delta"], sizes["V2"]))
    filter_step(belief, y, delta, V2, np.zeros(4), np.zeros(3), model, layout)


def simulate_arrivals() -> None:
    """Simulate arrivals for a system with one state."""
    one = np.ones((1, 1))
    model = check_model(Model(one, one, one, one, np.array([[False], [True]])))
    simulate(model, one, draw_independent(np.array([0.5, 0.5]), 2, 2, seed=0))


def analyze_all() -> None:
    """Call the functions of the analyses."""
    step_by_name()
    simulate_arrivals()
    with tempfile.TemporaryDirectory() as folder:
        assert run("analyze", "nominal_imu_uwb", "--flights", "0", "--out", folder) == 0


def collect_tests() -> None:
    """Let pytest rewrite the asserts of the tests once; otherwise each worker would rewrite them."""
    words = (sys.executable, "-m", "pytest", "--collect-only", "-q", str(Path(__file__).parent))
    subprocess.run(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)


# Functions of one group share compiled functions; two processes at once would compile these twice.
# Functions that only few quick tests need are left out: the tight filter, the filter of recordings, the tube.
OF_THEORY = (analyze_all, partial(fly_moment, "flow"))
OF_FLIGHTS = (partial(fly_moment, "nominal_imu_uwb_yolo"), partial(fly_moment, "imu_uwb"), compile_flight, fly_variants)
OF_FLIGHTS += (run_commands,)


def call_all(functions: tuple[Callable[[], None], ...]) -> None:
    """Call functions one after the other, without their output and without garbage collection.

    Garbage collection would take a seventh of the time and free little, because these processes soon end.
    """
    gc.disable()
    with contextlib.redirect_stdout(io.StringIO()):
        for function in functions:
            function()


if __name__ == "__main__":
    with ProcessPoolExecutor(2) as pool:
        for side_by_side in (((collect_tests,), (partial(fly_moment, "nominal_imu_uwb"),)), (OF_FLIGHTS, OF_THEORY)):
            list(pool.map(call_all, side_by_side))
