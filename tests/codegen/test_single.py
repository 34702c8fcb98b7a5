"""What is exported in single precision: no doubles in its code, and flights as near to those in doubles as is said."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import mpmath
import numpy as np
import pytest
from command_line import run
from test_object_code import compiled, do, needs

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import ExportedHalf, programs_of
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.signals import Signals
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [0.3, 0.2, 1.5]]}"
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    made = dict[str, Path]()

    def of(target: str) -> Path:
        if target not in made:
            made[target] = tmp_path_factory.mktemp(target)
            export(load_scenario("nominal_imu_uwb", SHORT), target, made[target], precision="single", ticks=60)
        return made[target]

    return of


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


def test_the_code_for_a_processor_without_doubles_has_none(folder: Callable[[str], Path]) -> None:
    needs("arm-none-eabi-objdump", "arm-none-eabi-nm")
    there = folder("cortex-m4")
    code = do("arm-none-eabi-objdump", "-d", "ortilo_elements.o", folder=there)
    assert "vmul.f32" in code
    assert not re.findall(r"\S*\.f64\S*", code)
    asked = do("arm-none-eabi-nm", "-u", "ortilo_elements.o", folder=there).split()
    assert not [name for name in asked if re.search(r"__aeabi_(?:c?d|\w+2d|\w*f2u?lz)|^sqrt$|_?df", name)]
    for name in ("ortilo.h", "ortilo.c"):
        assert not re.search(r"\bdouble\b", (there / name).read_text())


@pytest.mark.parametrize("target", ["x86-64", "cortex-m4"])
def test_the_golden_test_is_passed(target: str, folder: Callable[[str], Path]) -> None:
    said = do(*compiled(folder(target), target), folder=folder(target))
    assert re.fullmatch(r"0 of 60 ticks differ; at most \d+ um, \d+ urad\n", said)


@pytest.mark.parametrize("target", ["x86-64", pytest.param("cortex-m4", marks=pytest.mark.long)])
def test_a_flight_stays_within_a_millimetre_and_a_tenth_of_a_degree(target: str, folder: Callable[[str], Path]) -> None:
    needs(*programs_of(target))
    scenario = load_scenario("nominal_imu_uwb", SHORT)
    with ExportedHalf(scenario, folder(target)) as half:

        def ask(tick: int, messages: Signals) -> Signals:
            half.take(messages)
            assert half.stopped == 0
            return half.outputs()

        flown = fly_lockstep(scenario, ask)
    its = fly_lockstep(scenario, in_this_process(scenario))
    for name in ("truth", "estimate"):
        apart = np.abs(flown[name].values - its[name].values)
        assert 0.0 < apart[:, :3].max() < 1e-3
        assert np.rad2deg(apart[:, 3:6].max()) < 0.1


def test_what_has_not_flown_near_doubles_is_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        export(load_scenario("robust_imu_uwb"), "cortex-m4", tmp_path, precision="single")
    assert str(refused.value).startswith("--precision: single: ")
    assert str(refused.value).endswith(" has not been flown within 1 mm of doubles")
    assert "\n" not in str(refused.value)
    assert not [*tmp_path.iterdir()]


def test_another_precision_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", "nominal_imu_uwb", "--precision", "half", "--out", str(tmp_path / "half")) == 2
    assert capsys.readouterr().err == "ortilo: --precision: 'half': must be one of double, single\n"
