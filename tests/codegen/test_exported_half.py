"""An exported half flies a world as Python's does: here, emulated, and on a board behind its serial port."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from exports import SHORT, Exported, needs

from ortilo_drake.codegen.exported_half import ExportedHalf, programs_of
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.flight.metrics import fix_errors
from ortilo_drake.flight.signals import Signals
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
