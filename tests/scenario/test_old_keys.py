"""Old names are refused with the new one; a scenario that the old code saved is read."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ortilo_drake as od
from ortilo_drake.flight.flight import flight_dataset, scenario_of
from ortilo_drake.flight.saved_flight import load_flight, save_flight
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.old_keys import FORMAT, OLD_KEYS, scenario_from_json

# Written before format 2, of what is nominal_imu_uwb_yolo now, with the settings below under their old names.
OLD = (Path(__file__).parents[1] / "data" / "scenario_format_1.json").read_text(encoding="utf-8")
NEW = load_scenario(
    "nominal_imu_uwb_yolo",
    (
        "control_rate=60.0",
        "estimator.gates.uwb=0.9",
        "estimator.integrator=literal",
        "estimator.delay=replay",
        "camera.link={rate: 10.0, delay: 1, loss: 0.2}",
        "camera.width=640",
        "camera.latency=2",
        "camera.errors.kind=parametric",
        "uwb.link.rate=10.0",
        "imu.rate_sd=0.01",
        "name=imu_uwb_yolo",
    ),
    seed=3,
)


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("camera=projected", "camera: is now camera.kind"),
        ("camera_link.loss=0.2", "camera_link.loss: is now camera.link.loss"),
        ("camera_link={every: 3, loss: 0.2}", "camera_link.every: is now camera.link.rate [Hz]"),
        ("projected_camera.errors.kind=parametric", "projected_camera.errors.kind: is now camera.errors.kind"),
        ("rendered_camera={width: 640, latency: 1}", "rendered_camera: is now camera"),
        ("uwb.link.every=3", "uwb.link.every: is now uwb.link.rate [Hz]"),
        ("handler.uwb_gate=0.9", "handler.uwb_gate: is now estimator.gates.uwb"),
        ("filter.V.imu=[1, 1, 1]", "filter.V.imu: is now estimator.V.imu"),
        ("servo.integrator=hold", "servo.integrator: is now estimator.integrator"),
    ],
)
def test_an_old_name_is_refused_with_the_new_one(setting: str, line: str) -> None:
    with pytest.raises(InputError) as refusal:
        load_scenario("nominal_imu_uwb", (setting,))
    assert str(refusal.value) == f"--set {setting!r}: {line}"


def test_files_and_keywords_are_told_the_new_name_too(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("base: nominal_imu_uwb\ncamera_link: {loss: 0.1, delay: 1}\n")
    with pytest.raises(InputError, match=r"mine\.yaml: camera_link: is now camera\.link$"):
        load_scenario(tmp_path / "mine.yaml")
    (tmp_path / "above.yaml").write_text("base: mine.yaml\n")
    with pytest.raises(InputError, match=r"^mine\.yaml: camera_link: is now camera\.link$"):
        load_scenario(tmp_path / "above.yaml")
    with pytest.raises(InputError, match=r"camera_link\.delay: is now camera\.link\.delay$"):
        od.load_scenario("nominal_imu_uwb", camera_link__delay=1)


def is_a_setting(key: str) -> bool:
    data: Any = Scenario().model_dump(mode="json")
    for name in key.split("."):
        if not isinstance(data, dict) or name not in data:
            return False
        data = data[name]
    return True


def test_every_new_name_is_a_setting_and_no_old_one_is() -> None:
    for old, new in OLD_KEYS.items():
        key = new.removesuffix(" [Hz]")
        assert is_a_setting(key if ".gates." not in key else key.rpartition(".")[0])
        assert is_a_setting(old) == (old == "camera")  # which is a group now


def test_a_scenario_of_the_old_format_is_read() -> None:
    assert scenario_from_json(OLD, 1, "old") == NEW
    assert scenario_from_json(NEW.model_dump_json(), FORMAT, "new") == NEW


def test_a_flight_saved_in_the_old_format_is_read(tmp_path: Path) -> None:
    flight = flight_dataset(
        NEW, NEW.h * np.arange(3), np.zeros((3, sum(NEW.measurement.logged_sizes().values()))), None
    )
    assert flight.attrs["format"] == FORMAT
    flight.attrs["scenario"] = OLD.strip()
    del flight.attrs["format"]
    save_flight(flight, tmp_path / "old.nc")
    found = load_flight(tmp_path / "old.nc")
    assert scenario_of(found) == NEW
    assert od.Flight(found).scenario == NEW


@pytest.mark.parametrize(("version", "line"), [(3, "is of format 3"), ("2", "is of format 2"), (None, "format None")])
def test_another_format_is_refused(version: Any, line: str) -> None:
    with pytest.raises(InputError, match=f"{line}, this version reads formats 1 to 2"):
        scenario_from_json("{}", version, "flight.nc")


@pytest.mark.parametrize("spoilt", [[], {}, {"camera": 3}, json.loads(OLD) | {"uwb": {"link": 3}}])
def test_what_is_no_scenario_of_the_old_format_is_refused(spoilt: Any) -> None:
    with pytest.raises(InputError, match=r"flight\.nc: is no scenario of format 1"):
        scenario_from_json(json.dumps(spoilt), 1, "flight.nc")
