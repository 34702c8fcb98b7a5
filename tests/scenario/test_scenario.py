"""The typed scenario: ready-made files, settings laid over them, and what is refused in one line."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ortilo_drake.model.inputs.nearest_key import keys_of
from ortilo_drake.model.room import ORTILO_ROOM
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import (
    SCENARIO_FOLDER,
    HoverPlanner,
    Scenario,
    load_scenario,
    read_waypoints,
    scenario_names,
    with_seed,
)
from ortilo_drake.scenario.link import check_rate
from ortilo_drake.scenario.schema import scenario_schema


def test_settings_are_laid_over_the_file() -> None:
    scenario = load_scenario(
        "nominal_imu_uwb",
        ("uwb.noise.fraction=0.02", "planner={kind: hover, point: [1.0, 2.0, 1.0]}", "sensors=[imu]"),
        seed=9,
    )
    assert scenario.uwb.noise.fraction == 0.02
    assert scenario.uwb.link.rate == 10.0  # what the setting did not name stays
    assert scenario.planner == HoverPlanner(kind="hover", point=(1.0, 2.0, 1.0))
    assert scenario.sensors == ("imu",)
    assert scenario.seed == 9
    assert scenario.name == "nominal_imu_uwb"


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("uwb.nois.fraction=0.1", ["uwb.nois", "unknown key"]),
        ("uwb.noise.fraction=-1", ["uwb.noise", "fraction", "-1", "at least 0"]),
        ("uwb.noise.fraction=.nan", ["uwb.noise.fraction", "nan", "finite"]),
        ("uwb.noise.fraction='0.1'", ["fraction", "'0.1'", "number"]),
        ("uwb.noise.kind=loud", ["uwb.noise.kind", "'loud'", "proportional", "constant"]),
        ("servo.form=fuzzy", ["servo.form", "'fuzzy'", "'paper'", "'error'"]),
        ("estimator.integrator=none", ["estimator.integrator", "'none'", "'literal'", "'hold'", "'estimate'"]),
        ("servo.weights.integral=[0.0, 1.0, 1.0]", ["servo.weights.integral.0", "0.0", "above 0"]),
        ("sensors=[imu, imu]", ["sensors", "names one twice"]),
        ("sensors=[sonar]", ["sensors.0", "'sonar'"]),
        ("seed=-1", ["seed", "-1"]),
        ("seed=1.5", ["seed", "1.5", "integer"]),
        ("control_rate=0", ["control_rate", "0"]),
        ("world.kinematics=flat", ["world.kinematics", "'flat'", "'linear'"]),
        ("uwb.link.rate=0", ["uwb.link.rate", "0", "at least 0.001"]),
        ("uwb.link.rate=9", ["uwb.link.rate: 9.0", "control_rate, 30 Hz", "7.5 and 10"]),
        ("imu.link.rate=100", ["imu.link.rate: 100.0", "control_rate, 30 Hz", "2 to 100 times it", "are: 90 and 120"]),
        ("imu.link.rate=40", ["imu.link.rate: 40.0", "the nearest that are: 30 and 60"]),
        ("imu.link.rate=3030", ["imu.link.rate: 3030.0", "be 2 to 100 times it"]),
        ("imu.link.rate=1.0e+12", ["imu.link.rate: 1000000000000.0", "be 2 to 100 times it"]),
        ("uwb.link.rate=60", ["uwb.link.rate: 60.0", "of uwb comes no more than one message a tick"]),
        ("control_rate=25", ["uwb.link.rate: 10.0", "control_rate, 25 Hz", "8.33333333333 and 12.5"]),
        ("uwb.link.blackouts=[{kind: time, start: 5, end: 4}]", ["uwb.link", "start 5.0", "below end 4.0"]),
        ("uwb.link.blackouts=[{start: 5, end: 6}]", ["uwb.link.blackouts.0", "needs a 'kind'"]),
        ("planner={kind: waypoints}", ["planner", "none given"]),
        ("vehicle.mass=60", ["vehicle", "60.0", "hover needs"]),
        ("vehicle.inertia=[1.0, 2.0]", ["vehicle.inertia.2", "missing"]),
        ("seed", ["must read key.key=value"]),
        ("=3", ["must read key.key=value"]),
        ("seed.deep=1", ["'seed' is not a group"]),
        (
            "estimator.gates.camera=0.9",
            ["estimator.gates.camera", "must be one of the sensors that fly", "'uwb', 'imu'"],
        ),
        ("estimator.gates.uwb=1.0", ["estimator.gates.uwb: 1.0", "below 1"]),
        ("camera={kind: rendered, latency: 0}", ["camera.latency: 0", "at least 1"]),
        ("camera={kind: rendered, width: 63}", ["camera.width: 63", "64 to 2048"]),
        ("camera.width=9000", ["camera.width: 9000", "8192"]),
        (
            "uwb.link.loss={kind: bursts, loss: 0.98, mean_length: 1}",
            ["uwb.link.loss.loss: 0.98", "at most 0.967", "30"],
        ),
        (
            "command_link.loss={kind: bursts, loss: 0.1, mean_length: 0.03}",
            ["command_link.loss.mean_length: 0.03", "tick"],
        ),
        ("uwb=[1", ["not valid YAML"]),
        ("uwb={link: {rate: 1, rate: 2}}", ["'rate' stands twice"]),
        ("room=/nowhere/room.yaml", ["/nowhere/room.yaml", "no such room file"]),
    ],
)
def test_a_wrong_setting_is_refused_in_one_line(setting: str, words: list[str]) -> None:
    with pytest.raises(InputError) as refusal:
        load_scenario("nominal_imu_uwb", ("seed=0", setting))
    line = str(refusal.value)
    assert "\n" not in line
    for word in words:
        assert word in line


def test_an_unknown_name_is_answered_with_the_nearest_ones() -> None:
    with pytest.raises(InputError) as refusal:
        load_scenario("imu_ubw")
    assert "'imu_ubw' is unknown, did you mean 'imu_uwb'" in str(refusal.value)
    assert f"prints all {len(scenario_names())}" in str(refusal.value)


def test_files_are_found_beside_the_scenario_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ORTILO_ROOM.read_text())
    (tmp_path / "path.txt").write_text("# a path\n0 0 1.5\n\n2, 0.0, 1.5  # comma\n")
    file = tmp_path / "mine.yaml"
    file.write_text("room: room.yaml\nplanner: {kind: waypoints, file: path.txt}\n")
    scenario = load_scenario(file)
    assert scenario.name == "mine"
    assert scenario.load_room().name == "ortilo"
    assert scenario.planner.file is None  # read at once: a flight carries its waypoints, not the name of a file
    np.testing.assert_array_equal(scenario.planner.points, [[0, 0, 1.5], [2, 0, 1.5]])
    with pytest.raises(InputError, match=r"other\.txt"):
        load_scenario(file, ("planner.file=other.txt",))


def test_a_waypoint_file_that_changes_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("planner: {kind: waypoints, file: path.txt}\n")
    for x in (3.0, 6.0):
        (tmp_path / "path.txt").write_text(f"0 0 1.5\n{x} 0 1.5\n")
        assert load_scenario(file).planner.points[-1] == (x, 0.0, 1.5)


@pytest.mark.parametrize("text", ["0 0\n", "0 0 1 2\n", "0 zero 0\n", "0 nan 0\n", "0 inf 0\n"])
def test_wrong_waypoints_name_file_and_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "path.txt"
    path.write_text("1 1 1\n" + text)
    with pytest.raises(InputError, match=r"line 2: .* is not three") as refusal:
        read_waypoints(path)
    assert str(refusal.value).startswith(f"{path}: ")


@pytest.mark.parametrize("text", ["- a\n- b\n", "3\n"])
def test_a_scenario_that_is_no_mapping_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="must hold settings by name"):
        load_scenario(path)


@pytest.mark.long
@given(st.integers(0, 2**63 - 1))
def test_another_seed_changes_nothing_else(seed: int) -> None:
    scenario = load_scenario("nominal_imu_uwb")
    assert with_seed(scenario, seed).model_dump() == {**scenario.model_dump(), "seed": seed}


def test_a_seed_below_zero_is_refused() -> None:
    with pytest.raises(InputError, match="seed"):
        with_seed(Scenario(), -1)


def test_defaults_are_a_valid_scenario_and_so_is_an_empty_file(tmp_path: Path) -> None:
    empty = tmp_path / "default.yaml"
    empty.write_text("")
    assert load_scenario(empty) == Scenario()
    assert SCENARIO_FOLDER.is_dir()


def written(path: Path, text: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    return path


def test_a_file_says_what_differs_from_its_base(tmp_path: Path) -> None:
    file = written(tmp_path / "mine.yaml", "base: nominal_imu_uwb\nuwb: {link: {loss: 0.3}}\nseed: 5\n")
    scenario, base = load_scenario(file), load_scenario("nominal_imu_uwb")
    assert scenario == load_scenario("nominal_imu_uwb", ("uwb.link.loss=0.3", "name=mine"), 5)
    assert scenario.uwb.link.blackouts == base.uwb.link.blackouts
    above = written(tmp_path / "above.yaml", "base: mine.yaml\nseed: 6\nname: third\n")
    assert load_scenario(above) == load_scenario("nominal_imu_uwb", ("uwb.link.loss=0.3", "name=third"), 6)


def test_a_group_of_another_kind_replaces_that_of_the_base(tmp_path: Path) -> None:
    file = written(
        tmp_path / "mine.yaml", "base: paper_imu_uwb\nestimator: {W: {kind: disturbance, force_density: 0.0183}}\n"
    )
    scenario = load_scenario(file)
    assert scenario.estimator.W.kind == "disturbance"
    assert scenario.estimator.V == load_scenario("paper_imu_uwb").estimator.V


def test_another_kind_of_camera_keeps_its_other_settings(tmp_path: Path) -> None:
    ours = ("camera.link.loss=0.3", "camera.width=640", "camera.errors.kind=parametric")
    projected, rendered = (
        load_scenario("nominal_imu_uwb_yolo", (*ours, f"camera.kind={k}")) for k in ("projected", "rendered")
    )
    assert rendered.camera == projected.camera.model_copy(update={"kind": "rendered"})
    assert rendered.projected() == projected
    file = written(tmp_path / "mine.yaml", "base: bursty_link\ncamera: {kind: rendered}\n")
    assert load_scenario(file).camera.link == load_scenario("bursty_link").camera.link


def test_gates_are_a_mapping_that_hashes() -> None:
    scenario = load_scenario("nominal_imu_uwb_yolo", ("estimator.gates.uwb=0.99", "estimator.gates.camera=0.9"))
    assert scenario.model_dump(mode="json")["estimator"]["gates"] == {"uwb": 0.99, "camera": 0.9}
    other = load_scenario("nominal_imu_uwb_yolo", ("estimator.gates={camera: 0.9, uwb: 0.99}",))
    assert other == scenario
    assert hash(other) == hash(scenario)


def test_files_that_a_base_names_lie_beside_it(tmp_path: Path) -> None:
    written(tmp_path / "below" / "path.csv", "0, 0, 1.5\n1, 0, 1.5\n")
    written(tmp_path / "below" / "room.yaml", ORTILO_ROOM.read_text())
    written(tmp_path / "below" / "base.yaml", "planner: {kind: waypoints, file: path.csv}\nroom: room.yaml\n")
    scenario = load_scenario(written(tmp_path / "mine.yaml", "base: below/base.yaml\n"))
    assert scenario.planner.points == ((0.0, 0.0, 1.5), (1.0, 0.0, 1.5))
    assert scenario.room == str(tmp_path / "below" / "room.yaml")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("base: mine.yaml\n", "mine.yaml: base: mine.yaml: leads back to itself"),
        ("base: 3\n", "base: 3: must be a ready-made scenario's name or a .yaml file"),
        ("base: imu_uwbb\n", "mine.yaml: base: 'imu_uwbb' is unknown, did you mean 'imu_uwb'"),
        ("base: none.yaml\n", "mine.yaml: base: none.yaml: no such file"),
        ("base: nominal_imu_uwb\nuwb: {lnk: {}}\n", "lnk"),
    ],
)
def test_a_base_that_cannot_be_is_refused_in_one_line(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(InputError, match=named) as error:
        load_scenario(written(tmp_path / "mine.yaml", text))
    assert "\n" not in str(error.value)


def test_a_long_chain_of_bases_is_refused(tmp_path: Path) -> None:
    files = [tmp_path / f"{k}.yaml" for k in range(1500)]
    for k, file in enumerate(files):
        file.write_text("base: nominal_imu_uwb\n" if k == 0 else f"base: {k - 1}.yaml\nseed: {k}\n")
    assert load_scenario(files[20]).seed == 20
    with pytest.raises(InputError, match=r"base: 1466\.yaml: must be at most 32 files on one another"):
        load_scenario(files[-1])


def test_an_integer_too_large_for_a_quantity_is_refused_before_it_is_a_float() -> None:
    with pytest.raises(InputError, match=r"servo\.weights\.angle\.0: 9223372036854775807: must not exceed 1e\+12"):
        load_scenario("outage", ("servo.weights.angle=[9223372036854775807, 1.0, 1.0]",))
    assert load_scenario("outage", seed=2**63 - 1).belief == load_scenario("outage").belief


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("uwb.link.loss=yes", "uwb.link.loss: True: must be a number from 0 to 1, as 0.1"),
        ("uwb.link.loss=", "uwb.link.loss: None: must be a number from 0 to 1, as 0.1"),
        ("uwb.link.blackouts=[[5,3]]", "must be a group of settings, its kind one of position, time"),
        ("planner=fast", "must be a group of settings, its kind one of gcs, hover, waypoints"),
        ("servo=3", "must be a group of settings: {kind: , form: , velocities: , "),
    ],
)
def test_a_value_in_place_of_a_group_is_answered_with_what_the_group_has(value, said) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        load_scenario("imu_uwb", [value])


@pytest.mark.parametrize(
    ("setting", "meant"),
    [
        ("uwb.rate=20", "'uwb.link.rate'"),  # moved into a group of the group
        ("camera.loss=0.2", "'camera.link.loss'"),
        ("force_density=0.1", "'world.disturbance.force_density'"),  # two groups down, of several
        ("disturbance.force_density=0.1", "'world.disturbance.force_density'"),
        ("gates.uwb=0.9", "'estimator.gates.uwb'"),
        (
            "estimator.ranges.noise.sd=0.1",
            "'estimator.ranges.noise.sd' (kind tight, affine or tight, constant)",
        ),  # of another kind
        ("estimator.huber=3", "kind tight, which has 'estimator.huber'"),
        ("estimator.horizn=0.2", "'horizon'"),  # mistyped
        ("torque_densityd=0.1", "'world.disturbance.torque_density'"),  # mistyped, and in another group
    ],
)
def test_an_unknown_key_is_answered_with_the_one_that_was_meant(setting: str, meant: str) -> None:
    with pytest.raises(InputError, match=rf"unknown key .*did you mean .*{re.escape(meant)}"):
        load_scenario("imu_uwb", (setting,))


def test_a_key_of_no_likeness_is_answered_with_what_its_group_has() -> None:
    with pytest.raises(InputError, match=r"uwb\.link\.zzz: unknown key .*known are rate, loss, blackouts, delay"):
        load_scenario("imu_uwb", ("uwb.link.zzz=1",))
    with pytest.raises(InputError, match=r"'flow\.gyro_sd'\? imu has link, standstill, angle_density, rate_density"):
        load_scenario("imu_uwb", ("imu.gyro_sd=1",))


KEYS = keys_of(scenario_schema())
SETTABLE = sorted({key.words for key in KEYS if len(key.words) > 2 and key.words[-1] != "kind"})


@pytest.mark.long
@settings(max_examples=40)
@given(st.sampled_from(SETTABLE))
def test_a_key_without_the_group_it_is_in_is_answered_in_full(words: tuple[str, ...]) -> None:
    """As `uwb.rate` for `uwb.link.rate`: where only one key of the group ends so, it is the one named."""
    group, last = words[0], words[-1]
    alike = {w for w in SETTABLE if w[0] == group and w[-1] == last} | {w for w in SETTABLE if w[:2] == (group, last)}
    siblings = {key.words[1] for key in KEYS if len(key.words) > 1 and key.words[0] == group}
    if len(alike) == 1 and last not in siblings:
        with pytest.raises(InputError) as refused:
            load_scenario("imu_uwb", (f"{group}.{last}=1",))
        assert f"did you mean '{'.'.join(words)}'" in str(refused.value)


@given(st.integers(1, 120), st.sampled_from([10, 25, 30, 50, 100]))
def test_a_rate_that_does_not_divide_is_answered_with_a_control_rate_that_it_divides(rate: int, ticks: int) -> None:
    try:
        check_rate("uwb", float(rate), float(ticks))
        assert ticks % rate == 0
        return
    except ValueError as refused:
        assert ticks % rate != 0
        hint = re.search(r"set control_rate: (\d+), which allows it", str(refused))
    if hint is None:
        assert all(n * ticks % rate for n in range(1, 1000 // ticks + 1))
    else:
        assert int(hint[1]) % rate == int(hint[1]) % ticks == 0
        check_rate("uwb", float(rate), float(hint[1]))


def test_twenty_hertz_are_answered_with_sixty_ticks() -> None:
    with pytest.raises(InputError, match=r"uwb\.link\.rate: 20\.0: .*set control_rate: 60, which allows it"):
        load_scenario("imu_uwb", ("uwb.link.rate=20",))
    with pytest.raises(InputError, match=r"report_link\.rate: 20\.0: .*set control_rate: 60, which allows it"):
        load_scenario("imu_uwb", ("report_link.rate=20",))
