"""NOISE.yaml: written and read again, those of the package, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from command_line import run

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.noise_file import load_noise, noise_text, preset_names
from ortilo_drake.scenario.truth import UwbTruth
from ortilo_drake.studies.fit.fit import fit_recordings
from ortilo_drake.studies.fit.fit_report import base_seen_from, scenario_text


@pytest.mark.parametrize("name", ["iasl_2023", "util_2021"])
def test_those_of_the_package_are_read_written_and_read_again(name, tmp_path) -> None:
    noise = load_noise(name)
    assert noise.source
    (tmp_path / "NOISE.yaml").write_text(noise_text(noise))
    assert load_noise(str(tmp_path / "NOISE.yaml")) == noise


def test_a_scenario_flies_the_file(tmp_path) -> None:
    noise, base = load_noise("util_2021"), load_scenario("tight_imu_uwb")
    (tmp_path / "N.yaml").write_text(noise_text(noise))
    (tmp_path / "FITTED.yaml").write_text(scenario_text(noise, "N.yaml", "tight_imu_uwb", base))
    scenario = load_scenario(tmp_path / "FITTED.yaml")
    assert (scenario.uwb.errors, scenario.uwb.fitted) == ("fitted", noise.uwb)
    assert scenario.uwb.sds == (pytest.approx(noise.uwb.white / 2**0.5), 0.0)  # it was of differences
    assert min(noise.imu.rotation) < scenario.imu.rate_density < max(noise.imu.rotation)


def test_what_the_base_adds_to_ranges_is_replaced(tmp_path) -> None:
    (tmp_path / "BASE.yaml").write_text("base: realistic\ntruth: {uwb: {bias_sd: 0.05, slow_sd: 0.03}}")
    noise, base = load_noise("iasl_2023"), load_scenario(tmp_path / "BASE.yaml")
    (tmp_path / "FITTED.yaml").write_text(scenario_text(noise, "iasl_2023", "BASE.yaml", base))
    scenario = load_scenario(tmp_path / "FITTED.yaml")
    assert scenario.truth.uwb == UwbTruth()
    assert scenario.truth.survey == base.truth.survey
    assert scenario.uwb.sds == (noise.uwb.white, 0.0)


def test_no_file_that_is_read_is_overwritten(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "BELOW.yaml").write_text("base: tight_imu_uwb\nseed: 77")
    (tmp_path / "MINE.yaml").write_text("base: BELOW.yaml")
    for options in (
        ("--scenario", str(tmp_path / "MINE.yaml")),
        ("--scenario", "BELOW.yaml"),
        ("--scenario", "S.yaml", "--out", "BELOW.yaml"),
        ("--scenario", "S.yaml", "--json", "S.yaml"),
        ("--out", "MAP.yaml"),
        ("--scenario", "S.yaml", "--out", "NOISE.txt"),
    ):
        assert run("fit", "none", "--map", "MAP.yaml", "--base", "MINE.yaml", *options) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert options[-1] in line
    assert (tmp_path / "BELOW.yaml").read_text() == "base: tight_imu_uwb\nseed: 77"


def test_a_base_in_the_working_folder_is_found_from_a_scenario_in_another(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "MINE.yaml").write_text("base: tight_imu_uwb\nseed: 77")
    file = tmp_path / "fitted" / "S.yaml"
    file.parent.mkdir()
    for base, seed in (("MINE.yaml", 77), (str(tmp_path / "MINE.yaml"), 77), ("tight_imu_uwb", None)):
        named = base_seen_from(Path("fitted/S.yaml"), base)
        file.write_text(scenario_text(load_noise("util_2021"), "util_2021", named, load_scenario(base)))
        assert seed in (None, load_scenario(file).seed)
    (tmp_path / "WRONG.yaml").write_text("base: tight_imu_uwb\nseeed: 77")
    for base in ("WRONG.yaml", "NONE.yaml", "none"):
        assert run("fit", "none", "--map", "NONE", "--scenario", "S.yaml", "--base", base) == 2
        assert base in capsys.readouterr().err


def test_recordings_with_other_anchors_are_refused_before_anything_is_fitted() -> None:
    one = Recording("one", None, None, None, np.zeros((4, 3)), 0.0, 0.0, [], {})
    with pytest.raises(InputError, match=r"two: anchors: .* those of one"):
        fit_recordings([one, one._replace(name="two", anchors=np.ones((4, 3)))], Map.model_construct(), False)
    with pytest.raises(InputError, match=r"one: anchors: must be surveyed"):
        fit_recordings([one._replace(anchors=4)], Map.model_construct(), False)


def test_a_name_that_is_none_and_a_number_that_is_none_are_one_line(tmp_path) -> None:
    assert preset_names() == ["iasl_2023", "util_2021"]
    with pytest.raises(InputError, match=r"util_2012.*util_2021"):
        load_noise("util_2012")
    (tmp_path / "NOISE.yaml").write_text("uwb: {white: -1}")
    with pytest.raises(InputError, match=r"uwb\.white"):
        load_noise(str(tmp_path / "NOISE.yaml"))
