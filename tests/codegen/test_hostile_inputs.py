"""An exported half under inputs that no sensor should send: it does what Python does, and keeps to its own memory.

The program and the C that is written are built with AddressSanitizer and UBSan; the object file is LLVM's own and has
neither. `ORTILO_FUZZ_CASES=1000000 make fuzz` flies a million ticks.
"""

import os
from pathlib import Path

import numpy as np
from test_object_code import needs

from ortilo_drake.codegen.c_header import c_name
from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import ExportedHalf
from ortilo_drake.codegen.golden import COMPARED, flown_ticks
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.flight.stepped_halves import OnboardHalf
from ortilo_drake.model.signals import STAMP
from ortilo_drake.scenario import load_scenario

TICKS = int(os.environ.get("ORTILO_FUZZ_CASES", "400"))
EPISODE = 40  # ticks; then both begin anew, as what is NaN stays so
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer", "-g")
HOSTILE = np.array([np.nan, np.inf, -np.inf, 1.7e308, -1.7e308, 5e-324, -5e-324, 0.0, -0.0, -1.0, 1e9, 2.0**63])


def spoiled(rng: np.random.Generator, inputs: np.ndarray, sizes: list[int]) -> np.ndarray:
    """Return a tick's inputs, some numbers of which are hostile, and some stamps another time's."""
    found = inputs.copy()
    for at in np.cumsum([0, *sizes[:-1]]):
        if rng.random() < 0.2:
            found[at + STAMP] += rng.choice([-100.0, -1.0, -0.1, 0.1, 1e6])
    if rng.random() < 0.3:
        where = rng.integers(0, found.size, rng.integers(1, 4))
        found[where] = np.where(rng.random(where.size) < 0.7, rng.choice(HOSTILE, where.size), rng.normal(0.0, 1e3))
    return found


def test_a_half_that_is_sent_nonsense_does_what_python_does(tmp_path: Path) -> None:
    needs("gcc")
    scenario = load_scenario("nominal_imu_uwb")
    export(scenario, "x86-64", tmp_path, ticks=1)
    half, onboard, rng = onboard_half(scenario), OnboardHalf(scenario), np.random.default_rng(39)
    sizes, refused = [*half.inputs.values()], {"exported": 0, "python": 0}
    came = flown_ticks(scenario, half, EPISODE)[0]
    with ExportedHalf(scenario, tmp_path, SANITIZED) as flown:
        for k in range(TICKS):
            if k % EPISODE == 0:
                onboard.restart()
                flown.restart()
            inputs = spoiled(rng, came[k % EPISODE], sizes)
            flown.take_inputs(inputs)
            parts = np.split(inputs, np.cumsum(sizes)[:-1])
            onboard.take({c_name(name): part for name, part in zip(half.inputs, parts, strict=True)})
            said, its = flown.outputs(), onboard.outputs()
            for name in COMPARED:
                np.testing.assert_array_equal(said[name], its[name].ravel(), err_msg=f"{name} of tick {k}")
            refused["exported"] += int(np.sum(said["delta"] == 0.0))
            refused["python"] += int(np.sum(its["delta"] == 0.0))
            onboard.advance()
    assert refused["exported"] == refused["python"] > 0
