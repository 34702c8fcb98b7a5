"""A flight beside its simulations: without noise they fly the path, and a group is held to its bounds."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import run
from made_up_motion import ANCHORS, BIASES, GRAVITY, TABLE_MAP, as_map, attitude, made_up, place, write_tables
from scipy.spatial.transform import Rotation
from usd_logs import util_folder, util_map

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, Truth, read_recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario.noise_file import ImuNoise, NoiseFile, UwbNoise, load_noise
from ortilo_drake.studies.fit.fit import fit_recordings
from ortilo_drake.studies.fit.sensor_errors import body_path, mount_of
from ortilo_drake.studies.predict.predicted import Figures, Predicted, group_of, interval, predict, simulated
from ortilo_drake.studies.predict.predicted_report import predicted_text
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.world.sensors.fitted_uwb import Day

SILENT = NoiseFile(uwb=UwbNoise(white=0.0), imu=ImuNoise(rotation=(0.0,) * 3, force=(0.0,) * 3))


def flight(name: str, real: float, fitted: float, nees: tuple[float, float]) -> Predicted:
    one = Figures(real, nees[0], 1.0, 0.0)
    return Predicted(name, one, (replace(one, error=fitted, nees=nees[1]),) * 2, (replace(one, error=real / 2),) * 2)


@pytest.mark.long
def test_without_noise_a_simulation_says_what_the_exact_motion_does(tmp_path) -> None:
    map_ = as_map(TABLE_MAP)
    recording = read_recording(write_tables(tmp_path / "made_up", made_up(noise=0.0)), map_)
    by = calibrate(recording, map_.calibration)
    path = body_path("made_up", recording.truth, by)
    mount = mount_of(recording, path, by, map_)
    day = Day(by.biases, ())
    rng = np.random.default_rng(0)
    found = simulated(recording, by, path, mount, 0.0, SILENT, day, (30.0, np.inf), rng)
    inside = (recording.ranges.t > 2.0) & (recording.ranges.t < 55.0)
    assert np.abs(found.ranges.r - recording.ranges.r)[inside].max() < 0.02
    t = recording.imu.t
    inside = (t > 2.0) & (t < 29.0)  # the made-up imu has a bias of its own
    np.testing.assert_allclose(
        (found.imu.force - recording.imu.force)[inside].mean(axis=0), [-0.15, 0.1, -0.2], atol=0.05
    )
    assert np.isnan(found.imu.force[t >= 30.0, 0]).all()
    assert np.isfinite(found.imu.force[:, 1:]).all()
    assert mount.magnitude() < 0.01
    assert Rotation.from_matrix(by.mount).magnitude() < 0.01


def test_a_group_is_held_to_thirty_percent_and_one_and_a_half() -> None:
    good = [flight("a", 0.2, 0.25, (2.0, 3.0)), flight("b", 0.2, 0.25, (2.0, 3.4))]
    assert group_of(good).holds
    assert group_of(good).error == pytest.approx(0.25)
    assert group_of(good).white_error == pytest.approx(0.1)
    assert not group_of([flight("a", 0.2, 0.27, (2.0, 3.0))]).holds
    assert not group_of([flight("a", 0.2, 0.2, (2.0, 3.6))]).holds
    runs = [Figures(e, 1.0, 1.0, 0.0) for e in np.linspace(0.0, 1.0, 41)]
    assert interval(runs, "error") == pytest.approx((0.025, 0.975))
    assert "does not predict" in predicted_text([flight("a", 0.2, 0.27, (2.0, 3.0))], "NOISE.yaml")


def after_a_rest(gyro_bias: float) -> Recording:
    """Return exact ranges from the body itself and an imu exact but for its gyro's bias; 4 s of rest come first."""
    t, t_r, h = np.arange(0.0, 20.0, 0.01), np.arange(0.05, 19.5, 0.05), 1e-3

    def eased(t):
        s = np.clip((t - 5.0) / 4.0, 0.0, None)
        return 4.0 * np.where(s < 1.0, s**3 * (1.0 - 0.5 * s), s - 0.5)

    def p(t):
        return place(eased(t))

    def R(t):
        return attitude(eased(t))

    rates = (R(t - h).inv() * R(t + h)).as_rotvec() / (2.0 * h) + [gyro_bias, 0.0, 0.0]
    force = R(t).inv().apply((p(t + h) - 2.0 * p(t) + p(t - h)) / h**2 + [0.0, 0.0, GRAVITY])
    r, every = np.linalg.norm(p(t_r)[:, None] - ANCHORS, axis=2), np.arange(len(ANCHORS))
    ranges = single_ranges(np.repeat(t_r, len(every)), np.tile(every, len(t_r)), r.ravel())
    imu, truth = Imu(t, rates, force, R(t).as_matrix()), Truth(t, p(t), R(t).as_matrix())
    return Recording("rested", ranges, imu, truth, ANCHORS, 0.0, 0.0, [], {})


def map_of_a_rest(lever: float) -> Map:
    text = TABLE_MAP.replace("force: [fx, fy, fz]}", "force: [fx, fy, fz], standstill: 4}")
    settings = f"{{share: 0, clock: 0, frame: same, biases: none, lever: [{lever}, 0, 0]}}"
    return as_map(text + f"calibration: {settings}\n")


@pytest.mark.long
def test_a_simulated_imu_tells_its_own_rest() -> None:
    """The simulated gyro has no bias: what the recorded one said at rest would turn it over."""
    found = predict(after_a_rest(0.15), map_of_a_rest(0.0), SILENT, 1, 0)
    assert found.real.error < 0.05
    assert found.fitted[0].error < 0.05


@pytest.mark.long
def test_without_an_imu_the_truth_is_taken_for_the_antenna() -> None:
    found = predict(after_a_rest(0.0)._replace(imu=None), map_of_a_rest(0.5), SILENT, 1, 0)
    assert found.real.error < 0.1
    assert found.fitted[0].error < 0.1


def test_constants_of_other_anchors_are_refused_in_a_line() -> None:
    noise = SILENT.model_copy(update={"uwb": UwbNoise(white=0.0, constants=(0.1, -0.1))})
    with pytest.raises(InputError, match=r"noise\.uwb\.constants: 2 of them, but rested has 6 anchors"):
        predict(after_a_rest(0.0), map_of_a_rest(0.0), noise, 1, 0)


def test_two_folders_of_one_name_are_refused(tmp_path, capsys) -> None:
    folders = [str(write_tables(tmp_path / parent / "one", made_up(duration=3.0))) for parent in "ab"]
    (tmp_path / "MAP.yaml").write_text(TABLE_MAP)
    words = ("--map", str(tmp_path / "MAP.yaml"), "--noise", "iasl_2023", "--out", str(tmp_path / "out"))
    assert run("predict", *folders, *words) == 2
    assert "folders must have different names" in capsys.readouterr().err


@pytest.mark.long
def test_both_commands_on_a_made_up_motion(tmp_path, capsys) -> None:
    folder = write_tables(tmp_path / "made_up", made_up())
    (tmp_path / "MAP.yaml").write_text(TABLE_MAP)
    words = (str(folder), "--map", str(tmp_path / "MAP.yaml"))
    assert run("fit", *words, "--out", str(tmp_path / "NOISE.yaml"), "--scenario", str(tmp_path / "S.yaml")) == 0
    assert "uwb.white" in capsys.readouterr().out
    assert (tmp_path / "S.yaml").is_file()
    constants_sd = load_noise(str(tmp_path / "NOISE.yaml")).uwb.constants_sd
    assert constants_sd == pytest.approx(np.sqrt(np.mean(BIASES**2)), rel=0.02)  # drawn about 0
    out = tmp_path / "out"
    assert run("predict", *words, "--noise", str(tmp_path / "NOISE.yaml"), "--runs", "3", "--out", str(out)) == 0
    assert "made_up" in (out / "predicted.md").read_text()
    assert (out / "predicted.png").is_file()
    capsys.readouterr()
    assert run("predict", *words, "--noise", "util") == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.long
def test_flights_that_were_not_fitted_are_predicted() -> None:
    """Group error within 30 %, NEES within 1.5, of three flights from others of their day; white noise halves it."""
    position = "position: [locSrv.x, locSrv.y, locSrv.z]"
    turned = f"{position}, rotation: {{columns: [locSrv.qx, locSrv.qy, locSrv.qz, locSrv.qw]}}"

    def read(name):
        map_ = as_map(util_map(name).replace(position, turned))
        return read_recording(util_folder() / name, map_)._replace(name=name), map_

    days = {
        ("0425-traj2", "0425-traj16"): ("0425-traj4", "0425-traj20"),
        ("0426-traj2", "0426-traj9"): ("0426-traj12",),
    }
    flights = []
    for fitted, others in days.items():
        noise = fit_recordings([read(name)[0] for name in fitted], read(fitted[0])[1], places=False)
        flights += [predict(*read(name), noise, 8, 0) for name in others]
    group = group_of(flights)
    assert group.holds
    assert group.white_error < 0.75 * group.real_error
    assert group.white_nees < group.real_nees - 1.0
