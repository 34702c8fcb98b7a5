"""A scenario's vehicle from a file: where it is looked for, what lies over it, what is refused."""

from pathlib import Path

import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import Scenario, load_scenario

ARMS = "arms: [{angle: 0.0, length: 0.2, spin: 1}, {angle: 1.5, length: 0.2, spin: -1}, \
{angle: 3.1, length: 0.2, spin: 1}, {angle: -1.5, length: 0.2, spin: -1}]"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "below").mkdir()
    (tmp_path / "cross.yaml").write_text(f"mass: 2.0\n{ARMS}\n")
    (tmp_path / "mine.yaml").write_text("base: rotors\nvehicle: cross.yaml\n")
    return tmp_path


def test_a_file_stands_for_its_values_and_is_meant_from_the_scenarios_folder(folder: Path) -> None:
    scenario = load_scenario(folder / "mine.yaml")
    assert (scenario.vehicle.mass, scenario.vehicle.rotor_count) == (2.0, 4)
    assert scenario.vehicle.inertia == M100.inertia
    assert "cross" not in scenario.model_dump_json()
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


def test_a_base_means_its_file_from_its_own_folder_and_settings_lie_over_it(folder: Path) -> None:
    (folder / "below" / "lighter.yaml").write_text("base: ../mine.yaml\nvehicle: {mass: 1.5}\n")
    vehicle = load_scenario(folder / "below" / "lighter.yaml", ("vehicle.radius=0.3",)).vehicle
    assert (vehicle.mass, vehicle.rotor_count, vehicle.radius) == (1.5, 4, 0.3)
    assert vehicle.arms is not None


def test_a_file_replaces_the_bases_vehicle_whole(folder: Path) -> None:
    (folder / "other.yaml").write_text("radius: 0.2\n")
    (folder / "back.yaml").write_text("base: mine.yaml\nvehicle: other.yaml\n")
    assert load_scenario(folder / "back.yaml").vehicle == M100.model_copy(update={"radius": 0.2})


def test_a_setting_may_name_a_file_and_the_next_one_change_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = ("vehicle=cross.yaml", "vehicle.mass=1.0")
    vehicle = load_scenario(folder / "mine.yaml", settings).vehicle
    assert (vehicle.mass, vehicle.arms is None) == (1.0, False)
    with monkeypatch.context() as patch:
        patch.chdir(folder)  # a ready-made scenario's files, and those laid over one at hand, lie where the user is
        assert load_scenario("nominal_imu_uwb", settings).vehicle == vehicle
        assert load_scenario(load_scenario("nominal_imu_uwb"), settings).vehicle == vehicle


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mass: -1.0\n", ["cross.yaml", "mass", "-1.0", "above 0"]),
        ("mas: 1.0\n", ["cross.yaml", "mas: unknown key", "'mass'"]),
        ("arms: [{angle: 30.0, length: 0.2, spin: 1}]\n", ["cross.yaml", "arms.0.angle", "30.0", "6.28"]),
        ("arms: [{angle: 3.0, length: 0.2, spin: 2}]\n", ["cross.yaml", "arms.0.spin", "2", "'-1', '1'"]),
        (ARMS.replace("-1}", "1}"), ["cross.yaml", "arms: 4 rotors", "rank 3", "must be 4"]),
        (f"arm_length: 0.3\n{ARMS}", ["cross.yaml", "arm_length: 0.3", "must be left out where arms are given"]),
        ("[1, 2]\n", ["cross.yaml", "[1, 2]", "group"]),
        ("mass: [1\n", ["cross.yaml", "not valid YAML"]),
        (None, ["vehicle", "cross.yaml", "no such vehicle file"]),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(folder: Path, text: str | None, words: list[str]) -> None:
    (folder / "cross.yaml").unlink() if text is None else (folder / "cross.yaml").write_text(text)
    with pytest.raises(InputError) as refusal:
        load_scenario(folder / "mine.yaml")
    assert "\n" not in str(refusal.value)
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize("name", ['"a\\0b"', "x" * 5000, '"a\\nb"'])
def test_a_name_that_no_file_has_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(InputError, match=r"vehicle: .*no such vehicle file") as refusal:
        load_scenario("nominal_imu_uwb", (f"vehicle={name}",))
    assert len(str(refusal.value)) < 300
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("part", "text"),
    [("vehicle", "mass: 1.2\nradius: 0.3\n"), ("room", "interior: {min: [0, 0, 0], max: [8, 6, 3]}\nanchors: []\n")],
)
def test_a_vehicles_or_a_rooms_file_is_no_scenario_and_told_how_to_fly(tmp_path: Path, part: str, text: str) -> None:
    (file := tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match=rf"mine\.yaml: is a {part}, not a scenario: .* --set {part}=\S+mine\.yaml"):
        load_scenario(file)
    file.write_text(f"{text}uwb: {{}}\n")
    with pytest.raises(InputError, match="unknown key"):
        load_scenario(file)
    file.write_text("camera: {kind: projected}\n")  # which a room has too
    assert load_scenario(file).camera.kind == "projected"
