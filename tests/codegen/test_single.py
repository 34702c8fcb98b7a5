"""What is exported in single precision: no doubles in its code, and flights as near to those in doubles as is said."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import mpmath
import numpy as np
import pytest
from command_line import run
from exports import SHORT, Exported, do, golden, needs
from test_exported_half import flown_by

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import programs_of
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

FUNCTIONS = """
import json, sys
from ortilo_drake.codegen.single import compute_in_floats
compute_in_floats()
from numba import njit
from ortilo_drake.model.elementary import arctan2, cos, exp, sin
@njit
def of(x, y):
    return sin(x), cos(x), exp(y), arctan2(x, y)
print(json.dumps([of(x, y) for x, y in json.load(sys.stdin)]))
"""


@pytest.mark.long
def test_functions_in_floats_are_right_to_two_ulps(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    arguments = np.concatenate([rng.uniform(-s, s, (500, 2)) for s in (0.1, 2.0, 50.0)]).astype(np.float32)
    done = subprocess.run(
        [sys.executable, "-c", FUNCTIONS], input=json.dumps(arguments.tolist()), text=True, capture_output=True,
        check=True, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    for (x, y), found in zip(arguments.tolist(), json.loads(done.stdout), strict=True):
        with mpmath.workdps(40):
            exact = mpmath.sin(x), mpmath.cos(x), mpmath.exp(y), mpmath.atan2(x, y)
            for value, its in zip(found, exact, strict=True):
                assert np.float32(value) == value
                assert abs(mpmath.mpf(value) - its) <= 2.0 * float(np.spacing(np.float32(abs(float(its))))), (x, y)


@pytest.mark.long
def test_the_code_for_a_processor_without_doubles_has_none(short: Scenario, exported: Exported) -> None:
    needs("arm-none-eabi-objdump", "arm-none-eabi-nm")
    there = exported(short, "cortex-m4", precision="single")
    code = do("arm-none-eabi-objdump", "-d", "ortilo_elements.o", folder=there)
    assert "vmul.f32" in code
    assert not re.findall(r"\S*\.f64\S*", code)
    asked = do("arm-none-eabi-nm", "-u", "ortilo_elements.o", folder=there).split()
    assert not [name for name in asked if re.search(r"__aeabi_(?:c?d|\w+2d|\w*f2u?lz)|^sqrt$|_?df", name)]
    for name in ("ortilo.h", "ortilo.c"):
        assert not re.search(r"\bdouble\b", (there / name).read_text())


@pytest.mark.long
@pytest.mark.parametrize("target", ["x86-64", "cortex-m4"])
def test_the_golden_test_is_passed(target: str, short: Scenario, exported: Exported, tmp_path: Path) -> None:
    said = do(*golden(exported(short, target, precision="single"), target, tmp_path), folder=tmp_path)
    assert re.fullmatch(r"0 of 60 ticks differ; at most \d+ um, \d+ urad\n", said)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "target"), [("nominal_imu_uwb", "x86-64"), ("nominal_imu_uwb", "cortex-m4"), ("imu_uwb", "x86-64")]
)
def test_a_flight_stays_within_a_millimetre_and_a_tenth_of_a_degree(name: str, target: str, exported: Exported) -> None:
    needs(*programs_of(target))
    scenario = load_scenario(name, SHORT)
    flown = flown_by(exported(scenario, target, precision="single"), scenario)
    its = fly_lockstep(scenario, in_this_process(scenario))
    for signal in ("truth", "estimate"):
        apart = np.abs(flown[signal].values - its[signal].values)
        assert 0.0 < apart[:, :3].max() < 1e-3
        assert np.rad2deg(apart[:, 3:6].max()) < 0.1


def test_what_has_not_flown_near_doubles_is_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        export(load_scenario("robust_imu_uwb"), "cortex-m4", tmp_path, precision="single")
    assert str(refused.value).startswith("--precision: single: ")
    assert str(refused.value).endswith(" has not been flown within 1 mm of doubles")
    assert "\n" not in str(refused.value)
    assert not [*tmp_path.iterdir()]


def test_what_flew_far_from_doubles_is_refused_in_a_line_that_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        export(load_scenario("tight_imu_uwb"), "cortex-m4", tmp_path, precision="single")
    said = "came 850 mm and 52 degrees within 46 ticks from doubles, 1 mm and 0.1 degree are allowed"
    assert str(refused.value) == f"--precision: single: filter: the element 'tight' {said}"


def test_another_precision_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", "nominal_imu_uwb", "--precision", "half", "--out", str(tmp_path / "half")) == 2
    assert capsys.readouterr().err == "ortilo: --precision: 'half': must be one of double, single\n"
