"""Ranges with fitted errors against the closed forms of what a NOISE.yaml describes."""

from dataclasses import replace

import numpy as np
import pytest
from drake_box import PlayedBox
from scipy.stats import t as student

from ortilo_drake.loop.element import Box, Values
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Uwb, load_scenario
from ortilo_drake.scenario.noise_file import load_noise
from ortilo_drake.sensors.uwb import check
from ortilo_drake.world.drawn_truth import of_seed
from ortilo_drake.world.sensors.fitted_uwb import draw_day, fitted_box, fitted_drawn, growth
from ortilo_drake.world.sensors.uwb import uwb_box

H = 1.0 / 30.0
ROOM = load_room()
N = len(ROOM.anchors)
PLACE = np.array([3.0, -1.0, 1.4])
STATE = np.concatenate((PLACE, np.zeros(9)))
DISTANCES = np.linalg.norm(PLACE - ROOM.anchor_positions, axis=1)
SENT = np.zeros(1)


def uwb_of(**fitted: object) -> Uwb:
    return Uwb.model_validate({"errors": "fitted", "fitted": fitted})


def box_of(settings: Uwb, seed: int | None = None) -> Box:
    box = fitted_box(settings, ROOM, H)
    given = Values() if seed is None else fitted_drawn(settings, N, H, of_seed(seed))
    return replace(box, given=box.given.updated(given))


def errors(settings: Uwb, ticks: int, seed: int = 1) -> np.ndarray:
    """Return the ranges' errors of a flight that stands still (ticks, anchors), NaN of those that are missing."""
    plays, found = PlayedBox(box_of(settings, seed), H, seed, sent=SENT, state=STATE), []
    for k in range(ticks):
        said = plays.say(k)
        there = said[PAYLOAD + N :] == 1.0
        assert (said[PAYLOAD : PAYLOAD + N][~there] == 0.0).all()
        found.append(np.where(there, said[PAYLOAD : PAYLOAD + N] - DISTANCES, np.nan))
        plays.step()
    return np.array(found)


def test_what_lasts_has_its_deviation_and_correlation_from_the_first_tick_on() -> None:
    settings = uwb_of(white=0.0, lasting={"time": 0.1, "sd": 0.2})
    e = errors(settings, 2500)
    assert e.std() == pytest.approx(0.2, rel=0.04)
    for lag in (1, 3):
        assert np.mean(e[lag:] * e[:-lag]) / 0.04 == pytest.approx(np.exp(-lag * H / 0.1), abs=0.03)
    assert abs(np.corrcoef(e.T)[0, 1]) < 0.08  # each anchor's its own
    first = [fitted_drawn(settings, N, H, of_seed(seed)).start["g"] for seed in range(500)]
    assert np.std(first) == pytest.approx(0.2, rel=0.06)


def test_white_noise_is_drawn_anew_and_grows_near_the_floor() -> None:
    e = errors(uwb_of(white=0.1), 1500)
    assert e.std() == pytest.approx(0.1, rel=0.03)
    assert np.mean(e[1:] * e[:-1]) / 0.01 == pytest.approx(0.0, abs=0.04)
    near = errors(uwb_of(white=0.1, near_floor=1.4), 10)  # at that height the floor doubles errors
    np.testing.assert_allclose(near, 2.0 * e[:10], rtol=1e-9)
    assert [growth(z, 1.0) for z in (np.inf, 1.0, -1.0)] == [1.0, 2.0, 10.0]


def test_a_heavy_tail_is_that_of_student_s_t() -> None:
    e = np.abs(errors(uwb_of(white=0.1, freedom=2.0), 2500)).ravel()
    for share in (0.3, 0.5, 0.8):  # six normals err by less far out
        assert np.quantile(e, share) == pytest.approx(0.1 * student.ppf(0.5 + 0.5 * share, 2.0), rel=0.06)


def test_its_white_noise_is_that_of_the_paper_s_receiver() -> None:
    plain = uwb_box(Uwb.model_validate({"noise": {"kind": "constant", "sd": 0.1}}), ROOM, H)
    others = (PlayedBox(box, H, 5, sent=SENT, state=STATE).say(7) for box in (box_of(uwb_of(white=0.1), 5), plain))
    np.testing.assert_allclose(*others, rtol=1e-14)


def test_outliers_come_in_their_share_and_bursts_among_the_ranges_that_are_there() -> None:
    settings = uwb_of(white=0.0, outliers={"share": 0.1, "sd": 0.5, "burst": 3.0}, missing=0.25)
    e = errors(settings, 2500)
    missing = np.isnan(e)
    assert missing.mean() == pytest.approx(0.25, abs=0.01)
    assert np.mean(missing[1:] & missing[:-1]) == pytest.approx(0.0625, abs=0.006)  # one by one
    rows = [anchor[~np.isnan(anchor)] for anchor in e.T]
    odd = [np.abs(anchor) > 1e-9 for anchor in rows]
    began = sum(int(anchor[0]) + int((anchor[1:] & ~anchor[:-1]).sum()) for anchor in odd)
    share = np.mean(np.concatenate(odd))
    assert share == pytest.approx(0.1, abs=0.012)
    assert np.concatenate(odd).sum() / began == pytest.approx(3.0, rel=0.08)
    assert np.concatenate(rows)[np.concatenate(odd)].std() == pytest.approx(0.5, rel=0.06)
    first = [fitted_drawn(settings, N, H, of_seed(seed)).start["odd"] for seed in range(500)]
    assert np.mean(first) == pytest.approx(0.1, abs=0.02)


def test_no_message_is_sent_where_the_link_loses_it_and_no_outlier_begins_then() -> None:
    settings = uwb_of(white=0.0, outliers={"share": 0.5, "sd": 1.0})
    plays = PlayedBox(box_of(settings), H, 1, sent=np.array([-1.0]), state=STATE)
    for k in range(20):
        assert (plays.say(k) == 0.0).all()
        plays.step()
    assert plays.say(20, sent=SENT)[PAYLOAD : PAYLOAD + N] == pytest.approx(DISTANCES)


def test_constants_and_fields_are_the_days() -> None:
    settings = uwb_of(white=0.0, constants_sd=0.3, field={"length": 1.0, "sd": 0.2})
    e = errors(settings, 2, seed=4)
    day = draw_day(settings.fitted, N, of_seed(4))
    expected = day.constants + day.fields_at(PLACE[np.newaxis])[0]
    np.testing.assert_allclose(e, [expected, expected], atol=1e-12)
    drawn = np.array(
        [draw_day(uwb_of(white=0.0, constants_sd=0.3).fitted, N, of_seed(s)).constants for s in range(400)]
    )
    assert drawn.std() == pytest.approx(0.3, rel=0.05)
    known = uwb_of(white=0.0, constants_sd=0.3, constants=(0.1,) * N)
    np.testing.assert_allclose(errors(known, 1), np.full((1, N), 0.1), atol=1e-12)


@pytest.mark.long
def test_noise_of_differences_flies_as_that_of_single_ranges() -> None:
    assert errors(uwb_of(white=0.1, differences=True), 1500).std() == pytest.approx(0.1 / np.sqrt(2.0), rel=0.03)
    odd = uwb_of(white=0.0, outliers={"share": 0.19, "sd": 1.0}, differences=True)  # 1 - 0.9²
    assert np.mean(np.abs(errors(odd, 1500)) > 1e-9) == pytest.approx(0.1, abs=0.012)


def test_presets_are_known_by_name_and_files_are_found_beside_the_scenario(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = load_scenario("imu_uwb", uwb__errors="fitted", uwb__file="util_2021")
    assert found.uwb.fitted == load_noise("util_2021").uwb
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "N.yaml").write_text("uwb: {white: 0.3}")
    (tmp_path / "sub" / "S.yaml").write_text("base: imu_uwb\nuwb: {errors: fitted, file: N.yaml}")
    (tmp_path / "TOP.yaml").write_text("base: sub/S.yaml\nseed: 3")
    for file in ("sub/S.yaml", "TOP.yaml"):
        assert load_scenario(file).uwb.sds == (0.3, 0.0)
    again = load_scenario(load_scenario("TOP.yaml"), uwb__file="iasl_2023")
    assert again.uwb.fitted == load_noise("iasl_2023").uwb


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"uwb.errors": "fitted"}, r"uwb\.file"),
        ({"uwb.errors": "fitted", "uwb.file": "util_2012"}, r"uwb\.file.*util_2021"),
        ({"uwb.errors": "fitted", "uwb.file": "NONE.yaml"}, r"NONE\.yaml"),
        ({"uwb.errors": "fitted", "uwb.file": 3}, r"uwb\.file"),
        ({"uwb.errors": "fitted", "uwb.fitted": {"white": -1}}, r"uwb\.fitted\.white"),
    ],
)
def test_what_is_wrong_is_one_line(settings, named) -> None:
    with pytest.raises(InputError, match=named) as raised:
        load_scenario("imu_uwb", settings)
    assert "\n" not in str(raised.value)


def test_constants_of_other_anchors_are_refused() -> None:
    with pytest.raises(InputError, match=r"uwb\.fitted\.constants: 2 .* anchors"):
        check(load_scenario("imu_uwb", {"uwb.errors": "fitted", "uwb.fitted": {"white": 0, "constants": [0, 0]}}), ROOM)


def test_the_onboard_half_sees_none_of_it() -> None:
    scenario = load_scenario("imu_uwb", {"uwb.errors": "fitted", "uwb.file": "util_2021"})
    assert scenario.belief.uwb.model_dump() == load_scenario("imu_uwb").belief.uwb.model_dump()
