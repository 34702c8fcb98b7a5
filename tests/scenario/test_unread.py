"""Settings that no flown part reads are told, and only those: shown by flights that they do not change."""

import re
import shlex
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from command_line import run

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, scenario_names
from ortilo_drake.scenario.unread import unread_settings, why_unread

ROOT = Path(__file__).parents[2]
HOVER = ("planner={kind: hover, duration: 0.7}", "settle=0", "uwb.link.blackouts=[]", "camera.kind=projected")


@cache
def flown(name: str, *settings: tuple[str, Any]) -> xr.Dataset:
    return fly(load_scenario(name, (*HOVER, *settings)))


def is_same(one: xr.Dataset, other: xr.Dataset) -> bool:
    signals = ("truth", "estimate", "covariance", "control", "arrival")
    return all(np.array_equal(one[name].values, other[name].values, equal_nan=True) for name in signals)


def leaves(data: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in data.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def another(value: Any) -> Any:
    """Return another value of the same kind, None where there is none."""
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return None
    if isinstance(value, list | tuple):
        return tuple(map(another, value)) if value and all(isinstance(v, float) for v in value) else None
    return value + 1 if isinstance(value, int) else 0.73 * value if value else 0.01


@pytest.mark.family("nominal_imu_uwb")
@pytest.mark.parametrize("name", ["nominal_imu_uwb", "tight_imu_uwb", "imu_uwb", "imu_uwb_yolo"])
def test_all_that_is_told_to_have_no_effect_has_none_all_together(name: str) -> None:
    scenario, changes = load_scenario(name, HOVER), []
    for key, value in leaves(scenario.model_dump(mode="json")):
        if why_unread(key, scenario) and another(value) is not None:
            try:
                load_scenario(name, (*HOVER, *changes, (key, another(value))))
            except InputError:
                continue  # no such value
            changes.append((key, another(value)))
    assert len(changes) > 15
    assert is_same(flown(name), flown(name, *changes))


@pytest.mark.family
@pytest.mark.parametrize(
    ("key", "value", "unread", "read"),
    [
        ("imu.rate_density", 1.0, "nominal_imu_uwb", "imu_uwb"),
        ("imu.specific_force_density", 5.0, "nominal_imu_uwb", "tight_imu_uwb"),
        ("truth.imu.specific_force_factor", 1.1, "nominal_imu_uwb", "imu_uwb"),
        ("estimator.V.rates", (1.0, 1.0, 1.0), "nominal_imu_uwb", "imu_uwb"),
        ("estimator.walks.force_sd", 0.3, "nominal_imu_uwb", "imu_uwb"),
        ("multilateration.noise.fraction", 0.1, "tight_imu_uwb", "nominal_imu_uwb"),
        ("camera.latency", 4, "imu_uwb", "imu_uwb_yolo"),
        ("vehicle.rotor_time_constant", (0.1, 0.1), "imu_uwb_yolo", "rotors"),
    ],
)
def test_a_setting_is_told_where_nothing_reads_it_and_not_where_it_changes_the_flight(
    key: str, value: Any, unread: str, read: str
) -> None:
    (line,) = unread_settings(load_scenario(unread, ((key, value),)), unread, ((key, value),))
    assert line.startswith(f"{key}: has no effect here")
    assert is_same(flown(unread), flown(unread, (key, value)))
    assert unread_settings(load_scenario(read, ((key, value),)), read, ((key, value),)) == []
    assert not is_same(flown(read), flown(read, (key, value)))


@pytest.mark.long
def test_of_a_file_what_it_sets_is_told_and_not_what_it_repeats(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, below = tmp_path / "mine.yaml", tmp_path / "below.yaml"
    below.write_text("base: nominal_imu_uwb\nimu: {rate_density: 0.0913, angle_density: 0.00365}\n")
    file.write_text("base: below.yaml\nimu: {specific_force_density: 0.009128709291752768}\ncamera: {width: 640}\n")
    assert run("scenario", "check", str(file), "--set", "failsafe.timeout=0.1") == 3
    told = [line.split(":")[0].split()[-1] for line in capsys.readouterr().err.splitlines()]
    assert sorted(told) == ["camera.width", "failsafe.timeout", "imu.rate_density"]


OF_FILES = ("room", "vehicle", "camera.calibration")


def documented() -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the scenario and the settings of each flight that the documents tell to fly."""
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        text = page.read_text().replace("\\\n", " ")
        for line in re.findall(r"ortilo (?:--plugin \S+ )?(?:fly|live|rare|map) [^\n`#|]*--set [^\n`#|]*", text):
            if re.search(r"--plugin (mine|bright)\.py", line):
                continue  # the page itself shows that file
            try:
                words = shlex.split(line)
            except ValueError:
                continue  # not the whole of a line
            name = next((word for word in words if word in scenario_names()), "")
            settings = [word for at, word in pairwise(words) if at == "--set" and "=" in word]
            plain = tuple(word for word in settings if word.split("=")[0] not in OF_FILES)
            if name and plain:
                yield name, plain


def test_no_documented_setting_is_told() -> None:
    found = list(documented())
    assert len(found) >= 10
    for name, settings in found:
        assert unread_settings(load_scenario(name, settings), name, settings) == [], (name, settings)


def test_what_a_ready_made_scenario_sets_for_those_laid_over_it_is_not_told() -> None:
    """`nominal_imu_uwb` sets imu.rate_density, which it does not read, and others that name it as their base do."""
    for name in scenario_names():
        assert unread_settings(load_scenario(name), name) == []
