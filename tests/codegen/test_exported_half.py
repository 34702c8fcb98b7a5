"""An exported half flies a world as Python's does: here, emulated, and on a board behind its serial port.

An exported half under inputs that no sensor should send: it does what Python does, and keeps to its own memory.

The program and the C that is written are built with AddressSanitizer and UBSan; the object file is LLVM's own and has
neither. `ORTILO_FUZZ_CASES=1000000 make fuzz` flies a million ticks.
"""

import json
import os
import subprocess
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from exports import SHORT, Exported, needs
from played_half import PlayedHalf

from ortilo_drake.codegen.exported_half import TEMPLATES, ExportedHalf, build, flown_ticks, programs_of
from ortilo_drake.codegen.half import Half, onboard_half
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.metrics import fix_errors
from ortilo_drake.flight.signals import Signals
from ortilo_drake.model.signals import N_U, N_XBAR, STAMP
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario


def flown_by(folder: Path, scenario: Scenario) -> xr.Dataset:
    """Return the flight in lockstep of an exported half, none of whose functions stops."""
    with ExportedHalf(scenario, folder) as half:

        def ask(tick: int, messages: Signals) -> Signals:
            half.receive(messages)
            assert half.stopped == 0
            return half.outputs()

        return fly_lockstep(scenario, ask)


def check_bits(folder: Path, scenario: Scenario) -> xr.Dataset:
    """Check that an exported half flies as this process does; return the flight."""
    flown, its = flown_by(folder, scenario), fly_lockstep(scenario, in_this_process(scenario))
    for name in its.data_vars:
        np.testing.assert_array_equal(flown[name].values, its[name].values, err_msg=str(name))
    return its


def test_a_flight_in_lockstep_has_the_bits_of_one_in_this_process(short: Scenario, exported: Exported) -> None:
    needs(*programs_of("x86-64"))
    check_bits(exported(short), short)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "target"),
    [("nominal_imu_uwb", "aarch64"), ("nominal_imu_uwb", "cortex-m7"), ("imu_uwb", "cortex-m7")],
)
def test_a_flight_in_lockstep_has_them_on_each_processor(name: str, target: str, exported: Exported) -> None:
    needs(*programs_of(target))
    scenario = load_scenario(name, SHORT)
    check_bits(exported(scenario, target), scenario)


@pytest.mark.long
@pytest.mark.parametrize("distortion", ["fisheye", "brown_conrady"])
def test_a_lens_that_bends_is_exported_with_its_bits(distortion: str, exported: Exported) -> None:
    needs(*programs_of("x86-64"))
    lens = {"distortion": distortion, "coefficients": [-0.02, 0.004, 0.002, -0.001]}
    camera = {"width": 1600, "height": 1200, "focal_length": [746.6, 731.2], "center": [810.5, 590.5]} | lens
    settings = ("camera.kind=projected", "planner={kind: hover, point: [8, 1, 1.5], duration: 1.0}", "settle=0.0")
    scenario = load_scenario("nominal_imu_uwb_yolo", (*settings, f"camera.calibration={json.dumps(camera)}"))
    assert "camera" in fix_errors(check_bits(exported(scenario, ticks=1), scenario))


def test_a_folder_of_another_scenario_is_refused_in_a_line(short: Scenario, exported: Exported, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no manifest\.json of `ortilo export`"):
        ExportedHalf(short, tmp_path / "nowhere")
    with pytest.raises(InputError, match="is an export of nominal_imu_uwb with other settings"):
        ExportedHalf(load_scenario("nominal_imu_uwb"), exported(short))


TICKS = int(os.environ.get("ORTILO_FUZZ_CASES", "400"))
EPISODE = 40  # ticks; then both begin anew, as what is NaN stays so
BLOCK = 100 * EPISODE  # ticks that the program is sent at once
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


def sent_to(program: Path, half: Half, inputs: np.ndarray) -> np.ndarray:
    """Return a program's answers, stopped and the outputs by their names, to inputs; it begins anew each EPISODE."""
    asked = np.zeros(len(inputs), np.dtype([("anew", "i4"), ("inputs", "f8", inputs.shape[1])]))
    asked["anew"][::EPISODE], asked["inputs"] = 1, inputs
    done = subprocess.run([program], input=asked.tobytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    answer = [("stopped", "i4"), *((name, "f8", wire.size) for name, wire in half.outputs.items())]
    return np.frombuffer(done.stdout, np.dtype(answer))


ROBUST = pytest.param("robust_imu_uwb_yolo", ("camera.kind=projected",), marks=pytest.mark.long)


@pytest.mark.processes
@pytest.mark.timeout(0)  # a million takes minutes
@pytest.mark.parametrize(("name", "changes"), [("nominal_imu_uwb", ()), ROBUST])
def test_a_half_that_is_sent_nonsense_does_what_python_does(
    name: str, changes: tuple[str, ...], exported: Exported, tmp_path: Path
) -> None:
    needs("gcc")
    scenario = load_scenario(name, (SHORT, *changes))
    build(exported(scenario), "x86-64", TEMPLATES / "serve.c", tmp_path / "serve", SANITIZED)
    half, rng, counted = onboard_half(scenario), np.random.default_rng(39), Counter[str]()
    python, sizes = PlayedHalf(half), [*half.inputs.values()]
    came = flown_ticks(scenario, EPISODE)[0]
    for first in range(0, TICKS, BLOCK):
        inputs = np.array([spoiled(rng, came[k % EPISODE], sizes) for k in range(min(BLOCK, TICKS - first))])
        its = np.vstack([python.play(inputs[k : k + EPISODE]) for k in range(0, len(inputs), EPISODE)])
        said = sent_to(tmp_path / "serve", half, inputs)
        all_said = np.hstack([said[name] for name in ("control", "estimate", "covariance", "delta")])
        np.testing.assert_array_equal(all_said, its, err_msg=f"tick {first} and on")
        taken = its[:, N_U + N_XBAR + N_XBAR**2 :]
        counted.update(
            ticks=len(its), values_refused=int(np.sum(taken == 0.0)), values_taken=int(np.sum(taken == 1.0)),
            ticks_with_nan=int(np.isnan(its).any(axis=1).sum()), ticks_stopped=int(np.sum(said["stopped"] != 0)),
        )  # fmt: skip
    print(dict(counted))
    assert counted["values_refused"] > 0 < counted["values_taken"]
    assert counted["ticks"] == TICKS
