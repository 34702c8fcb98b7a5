"""Several tags on one body: rows and files that name them, calibration and filter by each tag's lever."""

from pathlib import Path

import numpy as np
import pytest
from made_up_motion import ANCHORS, LEVER, TABLE_MAP, attitude, made_up, place, write_tables
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from ortilo_drake.interop.recorded.map_file import FilterSettings, load_map
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, read_recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.replayed import RAW, replay
from ortilo_drake.studies.recorded.setups import calibrated_setup

TAGS = np.array([[0.0, 0.3, 0.05], [0.1, -0.3, 0.0]])
HEADING, HOVERS = 1.0, np.array([2.0, 5.0, 1.2])
ROWS = f"""
ranges: {{file: uwb.csv, time: t, anchor: to, tag: from, values: [range]}}
anchors: {dict(enumerate(ANCHORS.tolist()))}
tags: {{10: {TAGS[0].tolist()}, 11: {TAGS[1].tolist()}}}
"""


def map_file(folder, text):
    folder.mkdir(exist_ok=True)
    (folder / "MAP.yaml").write_text(text)
    return load_map(folder / "MAP.yaml")


def heard_by(p, R, tag, rng):
    """Return noisy ranges to all anchors (n, 6) of the tags (n) of bodies at p (n, 3), R (n, 3, 3)."""
    at = np.array([p_k + R_k @ TAGS[i] for p_k, R_k, i in zip(p, R, tag, strict=True)])
    r = np.linalg.norm(at[:, None] - ANCHORS, axis=2)
    return r + 0.03 * rng.standard_normal(r.shape)


def hover(tags):
    """Return ranges and IMU of a body that hovers for 20 s at HEADING, heard by these tags in turn."""
    rng, R = np.random.default_rng(3), Rotation.from_rotvec([0.0, 0.0, HEADING]).as_matrix()
    t, t_imu = np.arange(0.0, 20.0, 0.05), np.arange(0.0, 20.0, 0.02)
    tag = np.resize(tags, len(t))
    r = heard_by(np.tile(HOVERS, (len(t), 1)), np.tile(R, (len(t), 1, 1)), tag, rng)
    ranges = single_ranges(np.repeat(t, 6), np.tile(np.arange(6), len(t)), r.ravel())
    noise = rng.standard_normal((2, len(t_imu), 3))
    imu = Imu(t_imu, 0.001 * noise[0], np.array([0.0, 0.0, 9.81]) + 0.03 * noise[1], None)
    return ranges._replace(tag=np.repeat(tag, 6)), imu


def off_by(found) -> float:
    """Return the last estimate's error of heading [rad]."""
    R = found.R[-1]
    return abs(float(np.angle(np.exp(1j * (np.arctan2(R[1, 0], R[0, 0]) - HEADING)))))


SETTINGS = FilterSettings(range_correlated=0.001)
AT = np.array([19.9])


@pytest.mark.long
def test_ranges_of_two_tags_tell_the_heading_of_a_body_that_hovers() -> None:
    known = FilterSetup(ANCHORS, np.zeros(6), np.zeros(3), HEADING + 0.3, tags=TAGS)
    ends = {tags: estimate(*hover(tags), known, SETTINGS, AT) for tags in ((0, 1), (0,))}
    assert off_by(ends[0, 1]) < 0.03
    assert np.linalg.norm(ends[0, 1].p[-1] - HOVERS) < 0.03
    assert off_by(ends[0,]) > 0.2  # one tag tells where it is, and not on which side of the body


@pytest.mark.long
def test_without_a_heading_the_tags_find_it() -> None:
    known = FilterSetup(ANCHORS, np.zeros(6), np.zeros(3), None, tags=TAGS)
    found = estimate(*hover((0, 1)), known, SETTINGS, AT)
    assert off_by(found) < 0.03
    assert np.linalg.norm(found.p[-1] - HOVERS) < 0.03


@pytest.mark.long
def test_without_a_truth_each_tag_is_where_the_map_says(tmp_path) -> None:
    map_ = map_file(tmp_path / "a", ROWS + TABLE_MAP[TABLE_MAP.index("imu:") : TABLE_MAP.index("truth:")])
    recording = Recording("hovers", *hover((0, 1)), None, ANCHORS, 0.0, 0.0, [], {}, tags=TAGS)
    found = replay(recording, map_, lambda _: None)[1][RAW][0]
    assert off_by(found) < 0.03
    e = found.p[-1] - HOVERS  # who hovers does not learn the anchors' biases
    assert e @ np.linalg.solve(found.P[-1], e) < chi2.ppf(0.999, 3)


@pytest.mark.long
def test_the_lever_to_the_tags_frame_is_calibrated_and_the_filter_follows(tmp_path) -> None:
    motion = made_up()
    folder = write_tables(tmp_path / "made_up", motion)
    tag = np.arange(len(motion.t_r)) % 2
    rng, R = np.random.default_rng(5), attitude(motion.t_r).as_matrix()
    r = heard_by(place(motion.t_r) + R @ LEVER, R, tag, rng)
    lines = ["t,from,to,range"]
    for k, t in enumerate(motion.t_r):
        lines += [f"{t:.3f},{10 + tag[k]},{i},{r[k, i]:.5f}" for i in range(6)]
    (folder / "uwb.csv").write_text("\n".join(lines))
    map_ = map_file(folder, ROWS + TABLE_MAP[TABLE_MAP.index("imu:") :])
    recording = read_recording(folder, map_)
    found = calibrate(recording, map_.calibration)
    np.testing.assert_allclose(found.lever, LEVER, atol=0.02)
    assert found.left == pytest.approx(0.03, rel=0.15)
    assert calibrate(recording._replace(tags=0.0 * TAGS), map_.calibration).left > 0.08
    t = np.arange(25.0, 55.0, 0.1)
    at = estimate(recording.ranges, recording.imu, calibrated_setup(found, recording, map_), map_.filter, t)
    true = np.column_stack([np.interp(t + found.offset, recording.truth.t, axis) for axis in recording.truth.p.T])
    assert np.sqrt(np.mean(np.sum((at.p - found.position(true)) ** 2, axis=1))) < 0.05
    assert at.run.taken.mean() > 0.98


def write_rows(folder, header, rows):
    folder.mkdir(exist_ok=True)
    times = 4
    lines = [f"{0.1 * n + 0.01 * k:.2f},{row}" for n in range(times) for k, row in enumerate(rows)]
    (folder / "uwb.csv").write_text("\n".join([f"t,{header}", *lines]))


def test_rows_name_their_tag_and_those_of_other_bodies_are_counted(tmp_path) -> None:
    write_rows(tmp_path / "a", "from,to,range", ["11,0,3.5", "10,5,2.5", "20,1,4.5", "11,4,1.5"])
    read = read_recording(tmp_path / "a", map_file(tmp_path / "a", ROWS))
    assert read.ranges.tag[:3].tolist() == [1, 0, 1]
    assert read.ranges.anchor[:3].tolist() == [0, 5, 4]
    np.testing.assert_array_equal(read.tags, TAGS)
    assert [n for reason, n in read.rejected.items() if "tags that the map does not name" in reason] == [4]
    assert any("('20')" in line for line in read.told)


def test_two_columns_name_a_tag_and_tags_may_hear_an_anchor_at_one_stamp(tmp_path) -> None:
    write_rows(tmp_path / "a", "node,antenna,to,range", ["200,1,0,3.5", "200,2,0,2.5", "200,2,1,4.5", "200,1,4,1.5"])
    text = (tmp_path / "a" / "uwb.csv").read_text()
    for k in range(4):
        text = text.replace(f"0.{k}1,200", f"0.{k}0,200")
    (tmp_path / "a" / "uwb.csv").write_text(text)
    map_ = map_file(
        tmp_path / "a",
        ROWS.replace("tag: from", "tag: [node, antenna]").replace("{10:", "{200.1:").replace(" 11:", " 200.2:"),
    )
    read = read_recording(tmp_path / "a", map_)
    assert list(map_.tags) == ["200.1", "200.2"]
    assert read.ranges.tag[:4].tolist() == [0, 1, 1, 0]
    assert not read.rejected


def test_files_may_be_of_a_tag_each(tmp_path) -> None:
    (tmp_path / "a").mkdir()
    for name, r in (("left", 2.0), ("right", 3.0)):
        rows = [f"{0.1 * k:.1f},{r},{r + 0.1},{r + 0.2},{r + 0.3},{r + 0.4},{r + 0.5}" for k in range(4)]
        (tmp_path / "a" / f"{name}.csv").write_text("\n".join(["t,a,b,c,d,e,f", *rows]))
    files = "[{file: right.csv, tag: 11}, {file: left.csv, tag: 10}]"
    text = ROWS.replace("uwb.csv", files).replace(
        "anchor: to, tag: from, values: [range]", "values: [a, b, c, d, e, f]"
    )
    read = read_recording(tmp_path / "a", map_file(tmp_path / "a", text))
    assert set(read.ranges.r[read.ranges.tag == 0].astype(int)) == {2}
    assert set(read.ranges.r[read.ranges.tag == 1].astype(int)) == {3}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("tag: from, ", "", "tags: are given, but ranges name none"),
        ("tags:", "# tags:", "ranges: name tags, but `tags`, where they are, is missing"),
        ("tag: from, ", "tag: [from], ", "tag"),
        ("uwb.csv", "[{file: a.csv, tag: 10}, b.csv]", "either every file names its tag, or none does"),
    ],
)
def test_a_map_that_says_half_of_it_is_one_line(tmp_path, old, new, said) -> None:
    with pytest.raises(InputError, match=said):
        map_file(tmp_path / "a", ROWS.replace(old, new))


def test_rows_of_none_of_its_tags_are_one_line(tmp_path) -> None:
    write_rows(tmp_path / "a", "from,to,range", ["20,0,3.5", "21,5,2.5", "21,4,1.5"])
    with pytest.raises(InputError, match="no row names a tag of the map: 20, 21, not 10, 11"):
        read_recording(tmp_path / "a", map_file(tmp_path / "a", ROWS))


def test_the_maps_of_the_page_are_maps(tmp_path) -> None:
    text = (Path(__file__).parents[3] / "docs/how_to/recorded.md").read_text(encoding="utf-8")
    maps = text.split("**Several tags on one body.**")[1].split("```")[1].removeprefix("yaml").split("---\n")
    for text in maps:
        assert len(map_file(tmp_path / "a", text + ROWS.splitlines()[2]).tags) >= 2
    assert len(maps) == 3
