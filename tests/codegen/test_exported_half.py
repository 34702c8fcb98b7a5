"""An exported half flies a world as Python's does: here, emulated, and on a board behind its serial port."""

import json
from pathlib import Path

import numpy as np
import pytest
from test_object_code import needs

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import ExportedHalf, programs_of
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.metrics import fix_errors
from ortilo_drake.flight.stepped_halves import Signals
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [0.3, 0.2, 1.5]]}"


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("exported")


@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("nominal_imu_uwb", "x86-64"),
        ("nominal_imu_uwb", "aarch64"),
        ("nominal_imu_uwb", "cortex-m7"),
        pytest.param("imu_uwb", "cortex-m7", marks=pytest.mark.long),
    ],
)
def test_a_flight_in_lockstep_has_the_bits_of_one_in_this_process(name: str, target: str, folders: Path) -> None:
    needs(*programs_of(target))
    scenario, folder = load_scenario(name, SHORT), folders / f"{name}-{target}"
    export(scenario, target, folder, ticks=1)
    with ExportedHalf(scenario, folder) as half:

        def ask(tick: int, messages: Signals) -> Signals:
            half.take(messages)
            assert half.stopped == 0
            return half.outputs()

        flown = fly_lockstep(scenario, ask)
    its = fly_lockstep(scenario, in_this_process(scenario))
    for name in its.data_vars:
        np.testing.assert_array_equal(flown[name].values, its[name].values, err_msg=str(name))


@pytest.mark.parametrize("distortion", ["fisheye", pytest.param("brown_conrady", marks=pytest.mark.long)])
def test_a_lens_that_bends_is_exported_with_its_bits(distortion: str, folders: Path) -> None:
    needs(*programs_of("x86-64"))
    lens = {"distortion": distortion, "coefficients": [-0.02, 0.004, 0.002, -0.001]}
    camera = {"width": 1600, "height": 1200, "focal_length": [746.6, 731.2], "center": [810.5, 590.5]} | lens
    settings = ("camera.kind=projected", "planner={kind: hover, point: [8, 1, 1.5], duration: 1.0}", "settle=0.0")
    scenario = load_scenario("nominal_imu_uwb_yolo", (*settings, f"camera.calibration={json.dumps(camera)}"))
    export(scenario, "x86-64", folders / distortion, ticks=1)
    with ExportedHalf(scenario, folders / distortion) as half:

        def ask(tick: int, messages: Signals) -> Signals:
            half.take(messages)
            assert half.stopped == 0
            return half.outputs()

        flown = fly_lockstep(scenario, ask)
    its = fly_lockstep(scenario, in_this_process(scenario))
    assert "camera" in fix_errors(its)
    for name in its.data_vars:
        np.testing.assert_array_equal(flown[name].values, its[name].values, err_msg=str(name))


def test_a_folder_of_another_scenario_is_refused_in_a_line(folders: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb", SHORT)
    with pytest.raises(InputError, match=r"holds no manifest\.json of `ortilo export`"):
        ExportedHalf(scenario, folders / "nowhere")
    export(scenario, "x86-64", folders / "other", ticks=1)
    with pytest.raises(InputError, match="is an export of nominal_imu_uwb with other settings"):
        ExportedHalf(load_scenario("nominal_imu_uwb"), folders / "other")
