"""Has numba compile its kernels once, before the tests' workers start: they find them on the disk.

No test needs it: what is missing here is compiled where it is first called.
"""

import contextlib
import io
import tempfile
from pathlib import Path

from command_line import run

from ortilo_drake.analysis.tube import predict_tube
from ortilo_drake.hil.warm_up import warm_up
from ortilo_drake.scenario import load_scenario, scenario_names

PROJECTED = "camera=projected"
SHORT = ("--set", "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}")
VARIANTS = (
    ("filter.delay=replay", "uwb.link.delay=2"),
    ("filter.delay=drop", "uwb.link.delay=2"),
    ("command_link.loss={kind: bernoulli, probability: 0.5}",),
    ("world.kinematics=rigid_body",),
)


def compile_kernels(folder: Path) -> None:
    """Fly each kind of scenario for a moment and call the analyses, in a folder."""
    for name in scenario_names():
        warm_up(load_scenario(name, (PROJECTED,)))
    for changes in VARIANTS:
        warm_up(load_scenario("imu_uwb", changes))
    flight = str(folder / "flight.nc")
    assert run("fly", "imu_uwb", *SHORT, "--log", str(folder / "log"), "--out", flight) == 0
    assert run("replay", str(folder / "log")) == 0
    assert run("tune", flight, "--out", str(folder / "tuned.yaml")) == 0
    assert run("analyze", "imu_uwb", "--flights", "0", "--out", str(folder / "analysis")) == 0
    predict_tube(load_scenario("imu_uwb_yolo", (PROJECTED,)))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        compile_kernels(Path(name))
