"""NOISE.yaml: written and read again, those of the package, and what is refused."""

import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.fit.noise_file import load_noise, noise_text, preset_names
from ortilo_drake.studies.fit.scenario_text import scenario_text


@pytest.mark.parametrize("name", ["iasl_2023", "util_2021"])
def test_those_of_the_package_are_read_written_and_read_again(name, tmp_path) -> None:
    noise = load_noise(name)
    assert noise.source
    (tmp_path / "NOISE.yaml").write_text(noise_text(noise))
    assert load_noise(str(tmp_path / "NOISE.yaml")) == noise


def test_a_scenario_flies_the_numbers(tmp_path) -> None:
    noise = load_noise("util_2021")
    (tmp_path / "FITTED.yaml").write_text(scenario_text(noise, "tight_imu_uwb"))
    scenario = load_scenario(tmp_path / "FITTED.yaml")
    assert (scenario.truth.uwb.slow_sd, scenario.truth.uwb.slow_time) == (noise.uwb.lasting.sd, noise.uwb.lasting.time)
    assert scenario.uwb.noise.sds == (noise.uwb.white, 0.0)
    assert min(noise.imu.rotation) < scenario.imu.rate_density < max(noise.imu.rotation)


def test_a_name_that_is_none_and_a_number_that_is_none_are_one_line(tmp_path) -> None:
    assert preset_names() == ["iasl_2023", "util_2021"]
    with pytest.raises(InputError, match=r"util_2012.*util_2021"):
        load_noise("util_2012")
    (tmp_path / "NOISE.yaml").write_text("uwb: {white: -1}")
    with pytest.raises(InputError, match=r"uwb\.white"):
        load_noise(str(tmp_path / "NOISE.yaml"))
