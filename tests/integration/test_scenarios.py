"""The ready-made scenarios: valid, flyable, and what the paper and its authors fix."""

import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import run

from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.flight.metrics import summary
from ortilo_drake.scenario import (
    SCENARIO_FOLDER,
    GcsPlanner,
    Link,
    PositionBlackout,
    Scenario,
    load_scenario,
    scenario_names,
)

PAPERS = [f"{preset}imu_uwb{camera}" for preset in ("", "nominal_", "paper_", "printed_") for camera in ("", "_yolo")]
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"


def leaves(data: Any, name: str = "") -> dict[str, Any]:
    """Return every setting of a scenario by its full name."""
    if not isinstance(data, dict):
        return {name: data}
    return {k: v for key, value in data.items() for k, v in leaves(value, f"{name}.{key}".lstrip(".")).items()}


def differences(one: Scenario, other: Scenario) -> set[str]:
    a, b = leaves(one.model_dump(mode="json")), leaves(other.model_dump(mode="json"))
    return {name for name in a.keys() | b.keys() if a.get(name) != b.get(name)}


def test_the_papers_scenarios_are_among_the_ready_made_ones() -> None:
    assert set(PAPERS) <= set(scenario_names())


@pytest.mark.parametrize("name", scenario_names())
def test_a_ready_made_scenario_is_named_as_its_file_and_says_what_it_is(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    of_editors, first, *_ = (SCENARIO_FOLDER / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    assert of_editors == "# yaml-language-server: $schema=scenario.schema.json"
    assert first.startswith("# ")
    assert first.endswith(".")


@pytest.mark.family("nominal_imu_uwb")
@pytest.mark.parametrize("name", scenario_names())
def test_a_ready_made_scenario_flies(name: str) -> None:
    found = summary(fly(load_scenario(name, (SHORT, "camera.kind=projected"))))
    # Where no fix arrives the printed integral takes in the reference: without a camera the vehicle is thrown at once.
    assert (found.lost is not None) == (name == "printed_imu_uwb")
    assert all(math.isfinite(value) for value in found.mse.values())


@pytest.mark.family
@pytest.mark.parametrize("name", [*scenario_names(), "default"])
def test_what_show_prints_loads_again_as_the_same_scenario(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "default.yaml").write_text("")
    which = name if name != "default" else str(tmp_path / "default.yaml")
    assert run("scenario", "show", which, "--set", "seed=5") == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    (tmp_path / "again.yaml").write_text(printed.out, encoding="utf-8")
    again = load_scenario(tmp_path / "again.yaml")
    assert again == load_scenario(which, ("seed=5",))
    assert again.seed == 5
    assert set(yaml.safe_load(printed.out)) == {*Scenario.model_fields, *again.sensors}  # every default filled in


@pytest.mark.family
@pytest.mark.parametrize("name", scenario_names())
def test_check_says_that_a_ready_made_scenario_is_valid(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("scenario", "check", name) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{name}: valid")
    assert printed.err == ""


def test_list_names_every_scenario_on_a_line_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("scenario", "list") == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == scenario_names()


def test_the_defaults_together_are_a_valid_flight() -> None:
    scenario = Scenario()
    assert 60 * 30 < flight_ticks(scenario) < 120 * 30
    short = scenario.model_copy(update={"planner": load_scenario("nominal_imu_uwb", (SHORT,)).planner})
    assert summary(fly(short)).lost is None


@pytest.mark.parametrize("name", PAPERS)
def test_the_papers_world_is_the_one_that_theory_fixes(name: str) -> None:
    scenario = load_scenario(name)
    uwb, planner = scenario.uwb, scenario.planner
    assert set(scenario.sensors) == {"uwb", "imu"} | ({"camera"} if name.endswith("yolo") else set())
    assert scenario.room == "ortilo"
    assert scenario.control_rate == 30.0
    assert scenario.world.kinematics == "small_angle"
    assert scenario.world.rotors.kind == "ideal"
    assert scenario.world.disturbance.sds(scenario.h) == (0.27, 0.005)
    assert (uwb.noise.kind, uwb.noise.fraction) == ("proportional", 0.0075)
    assert uwb.walls.kind == "none"
    blackouts = ((1.5, 5.5), (12.9, 14.0), (16.9, 18.8))
    dark = tuple(PositionBlackout(kind="position", axis="x", start=start, end=end) for start, end in blackouts)
    assert uwb.link == Link(rate=10.0, blackouts=dark)
    assert scenario.every("imu") == 1
    assert scenario.imu.sds(scenario.h)[0] == 0.01
    assert scenario.camera.link.rate == 10.0
    assert isinstance(planner, GcsPlanner)
    assert (planner.start, planner.goal) == ((0.0, 0.0), (21.0, -3.2))
    assert (planner.height, planner.speed) == (1.5, 0.35)
    assert (scenario.vehicle.mass, scenario.vehicle.inertia) == (2.7, (0.1547563, 0.1658929, 0.2077))


def test_the_papers_preset_has_the_printed_covariances_and_true_velocities() -> None:
    for name in ("paper_imu_uwb", "paper_imu_uwb_yolo"):
        scenario = load_scenario(name)
        assert scenario.servo.velocities == "truth"
        W, V = scenario.estimator.W, scenario.estimator.V
        assert (W.kind, W.position, W.angle, W.velocity, W.rate) == ("diagonal", 1.0, 1.0, 1.0, 1.0)
        assert (V.uwb, V.camera, V.imu) == ((0.05,) * 3, (0.08,) * 3, (0.01,) * 3)


def test_the_printed_preset_flies_the_text_where_the_authors_code_differs() -> None:
    for camera in ("", "_yolo"):
        text, code = load_scenario(f"printed_imu_uwb{camera}"), load_scenario(f"paper_imu_uwb{camera}")
        assert differences(text, code) == {"name", "estimator.integrator", "servo.form", "servo.velocities"}
        assert (text.servo.form, text.servo.velocities, text.estimator.integrator) == ("paper", "estimate", "literal")
        assert (code.servo.form, code.servo.velocities, code.estimator.integrator) == ("error", "truth", "estimate")


def test_the_tuned_preset_takes_w_from_the_disturbance_and_estimates_velocities() -> None:
    for name in ("nominal_imu_uwb", "nominal_imu_uwb_yolo"):
        scenario = load_scenario(name)
        W, disturbance = scenario.estimator.W, scenario.world.disturbance
        assert scenario.servo.velocities == "estimate"
        assert (W.kind, W.force_density, W.torque_density) == (
            "disturbance",
            disturbance.force_density,
            disturbance.torque_density,
        )
        assert (scenario.estimator.V.uwb, scenario.estimator.V.camera) == (None, None)  # from each fix
        assert scenario.estimator.V.imu == pytest.approx((scenario.imu.sds(scenario.h)[0] ** 2,) * 3)


def test_with_and_without_the_camera_only_the_sensors_differ() -> None:
    assert differences(load_scenario("nominal_imu_uwb"), load_scenario("nominal_imu_uwb_yolo")) == {
        "name",
        "sensors",
        "camera.kind",
    }
    found = differences(load_scenario("paper_imu_uwb"), load_scenario("paper_imu_uwb_yolo"))
    # How boxes would become fixes is settled only where the camera flies.
    assert {name for name in found if not name.startswith("landmark_fix.")} == {"name", "sensors", "camera.kind"}


@pytest.mark.parametrize("preset", ["printed", "paper", "nominal"])
@pytest.mark.parametrize("name", ["imu_uwb", "imu_uwb_yolo"])
def test_the_presets_fly_in_the_same_world(name: str, preset: str) -> None:
    found = differences(load_scenario(name), load_scenario(f"{preset}_{name}"))
    allowed = ("estimator", "servo", "multilateration", "landmark_fix")
    # The paper's vehicle does not stand still before take-off, and its filter would learn nothing by it.
    assert {setting for setting in found if setting.split(".")[0] not in allowed} == {"name", "imu.standstill"}


# --- settings over a scenario ---------------------------------------------------------------------------------


def test_a_setting_changes_one_value_and_leaves_the_rest() -> None:
    changed = load_scenario("nominal_imu_uwb", ("uwb.noise.fraction=0.02",))
    assert differences(changed, load_scenario("nominal_imu_uwb")) == {"uwb.noise.fraction"}
    assert changed.uwb.noise.fraction == 0.02


def test_later_settings_win_and_a_seed_beats_the_scenarios() -> None:
    assert load_scenario("nominal_imu_uwb", ("seed=1", "seed=2")).seed == 2
    assert load_scenario("nominal_imu_uwb", ("seed=1",), 3).seed == 3


def test_a_setting_reaches_a_group_that_the_file_leaves_to_its_defaults() -> None:
    assert load_scenario("nominal_imu_uwb", ("planner.speed=0.5",)).planner == GcsPlanner(speed=0.5)
    assert (
        load_scenario("nominal_imu_uwb", ("uwb.link.loss={kind: bernoulli, probability: 0.3}",)).uwb.link.rate == 10.0
    )


def test_a_changed_kind_drops_what_belonged_to_the_former_one() -> None:
    changed = load_scenario("nominal_imu_uwb", ("uwb.noise.kind=constant", "uwb.noise.sd=0.1"))
    assert changed.uwb.noise.model_dump() == {"kind": "constant", "sd": 0.1}


@pytest.mark.parametrize("stem", ["my flight", "Flug (2)", "-x", "π"])
def test_a_scenario_file_may_have_any_name(tmp_path: Path, stem: str) -> None:
    (tmp_path / f"{stem}.yaml").write_text("seed: 4\n")
    assert load_scenario(tmp_path / f"{stem}.yaml").seed == 4


def test_files_laid_over_a_ready_made_scenario_are_meant_from_the_working_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "way.txt").write_text("0 0 1.5\n1 0 1.5\n")
    scenario = load_scenario(
        "nominal_imu_uwb_yolo",
        (
            "planner={kind: waypoints, file: way.txt}",
            "camera.errors.file=mine.yaml",
            "detector={cfg: a.cfg, weights: b.weights}",
        ),
    )
    assert scenario.planner.points == ((0.0, 0.0, 1.5), (1.0, 0.0, 1.5))
    assert scenario.camera.errors.file == str(tmp_path / "mine.yaml")
    assert (scenario.detector.cfg, scenario.detector.weights) == (str(tmp_path / "a.cfg"), str(tmp_path / "b.weights"))
