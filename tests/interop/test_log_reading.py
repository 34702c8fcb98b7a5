"""A log read back: the same Dataset, the same ticks, whatever cut it short; and one clear line for all else."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from logged_flights import SETTINGS, flight, scenario, ticks
from mcap.writer import Writer

from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.lost import find_loss
from ortilo_drake.interop.log import reader as log_reader
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.logged_map import logged_noise
from ortilo_drake.interop.log.mcap_records import read_logged
from ortilo_drake.interop.log.reader import log_file, log_scenario, read_log, read_messages, read_ticks
from ortilo_drake.interop.log.writer import KEEP_EVERY, LogWriter
from ortilo_drake.interop.recorded.map_file import load_map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.interop.ros.ros_messages import ARRAY_TYPE, SCENARIO_TOPIC
from ortilo_drake.interop.ros.ros_sensors import image_message, image_of
from ortilo_drake.interop.ros.ros_types import definition, from_cdr, message_maker, to_cdr, typestore
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import load_scenario

FROM_OUTSIDE = ("goal", "shutter", "image")  # put into the ticks by hand: the onboard half has no ports for them


def write(path, flown=None, sent=None):
    with LogWriter(path, flown or scenario()) as log:
        for tick in ticks() if sent is None else sent:
            log.write_tick(*tick)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write(tmp_path_factory.mktemp("logs") / "flight")


def test_a_log_is_read_as_a_recording_by_the_map_beside_it(folder: Path) -> None:
    map_ = load_map(folder / "map.yaml")
    recording = read_recording(folder, map_)
    room = scenario().load_room()
    np.testing.assert_allclose(recording.anchors, room.anchor_positions)
    assert recording.truth is not None
    p = recording.truth.p[0]
    assert map_.start is not None
    np.testing.assert_allclose(map_.start.position, p, atol=1e-3)
    assert map_.start.heading == pytest.approx(ticks()[0].state[STATE_NAMES.index("psi")], abs=1e-3)
    of_first = recording.ranges.t < 0.1
    d = np.linalg.norm(room.anchor_positions[recording.ranges.anchor[of_first]] - p, axis=1)
    np.testing.assert_allclose(recording.ranges.r[of_first], d, rtol=0.05)  # the ranges' noise is 0.75 %
    assert recording.imu is not None
    assert np.linalg.norm(recording.imu.force, axis=1).mean() == pytest.approx(GRAVITY, rel=0.02)


def test_the_map_beside_a_log_has_the_noise_that_the_scenario_sets(folder: Path) -> None:
    map_, flown = load_map(folder / "map.yaml"), scenario()
    recording = read_recording(folder, map_)
    assert flown.uwb.noise.kind == "proportional"
    r = recording.ranges.r
    assert map_.filter.range_white == pytest.approx(flown.uwb.noise.fraction * np.sqrt(np.mean(r**2)), rel=5e-3)
    assert map_.filter.rotation == pytest.approx(flown.imu.rate_density, rel=5e-3)
    assert map_.filter.acceleration == pytest.approx(flown.imu.specific_force_density, rel=5e-3)
    assert (map_.calibration.clock, map_.calibration.frame, map_.calibration.lever) == (0.0, "same", (0.0, 0.0, 0.0))


def test_lasting_errors_and_walls_are_in_the_map_as_far_as_they_are_known() -> None:
    r = np.array([3.0, 4.0])
    slow = load_scenario(
        "imu_uwb_yolo", ("truth.uwb={slow_sd: 0.1, slow_time: 3.0}", "uwb.noise={kind: constant, sd: 0.05}")
    )
    found = {name: number for name, (number, _) in logged_noise(slow, r).items()}
    assert (found["range_white"], found["range_correlated"], found["correlation_time"]) == (0.05, 0.1, 3.0)
    assert "range_correlated" not in logged_noise(load_scenario("imu_uwb_yolo", ("uwb.walls={kind: excess}",)), r)


def without_speed(data):
    data = data.copy()
    del data.attrs["real_time_factor"], data.attrs["player"]
    return data


def assert_same(found, expected):
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name].dtype == value.dtype
        np.testing.assert_array_equal(found[name], value)


def test_dataset_is_the_flights(folder):
    xr.testing.assert_identical(read_log(folder), without_speed(flight()))
    xr.testing.assert_identical(read_log(folder / "flight.mcap"), read_log(folder))
    assert log_scenario(folder) == scenario()


def test_ticks_are_the_flights(folder):
    for (k, messages, outputs), tick in zip(read_messages(folder), ticks(), strict=True):
        assert k == tick.k
        assert_same(messages, tick.messages)
        assert_same(outputs, tick.outputs)


def test_onboard_log_knows_no_truth(tmp_path):
    path = write(tmp_path / "onboard", sent=[(t.k, None, t.messages, t.outputs) for t in ticks()[:20] if t.k != 7])
    data = read_log(path)
    assert data.truth.isnull().all()
    assert json.loads(data.attrs["lost"]) is None
    assert data.sizes["tick"] == 20
    assert data.estimate[7].isnull().all()
    np.testing.assert_array_equal(data.estimate[8:], flight().estimate[8:20])
    assert all(tick.state is None for tick in read_ticks(path))


@pytest.mark.parametrize("bad", [{3: 1.2}, {0: np.nan}, {2: 99.0}])
def test_lost_flight_ends_as_the_flights_does(tmp_path, bad):
    sent = [t._replace(state=t.state.copy()) for t in ticks()[:40]]
    for tick in sent[25:]:
        for i, value in bad.items():
            tick.state[i] = value
    data = read_log(write(tmp_path / "lost", sent=sent))
    states = np.array([t.state for t in sent])
    lost = find_loss(states, scenario().h, scenario().load_room(), scenario().vehicle)
    rows = np.array([np.concatenate([t.state, *t.outputs.values()]) for t in sent[:26]])
    xr.testing.assert_identical(data, flight_dataset(scenario(), np.arange(26) * scenario().h, rows, lost))
    assert json.loads(data.attrs["lost"])["cause"] == lost.cause


KILLED = """
import itertools, sys, time
sys.path.insert(0, {tests!r})
from pathlib import Path
from logged_flights import SETTINGS
import numpy as np
from ortilo_drake.interop.log.replay import replay_log
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.scenario import load_scenario
scenario = load_scenario("nominal_imu_uwb_yolo", SETTINGS)
state = np.zeros(12)
sizes = dict(control=4, measurement=39, estimate=15, covariance=225, reference=9)
outputs = {{name: np.ones(size) for name, size in sizes.items()}}
with LogWriter(Path({path!r}), scenario) as log:
    for k in itertools.count():
        state[9] = k
        log.write_tick(k, state, {{}}, outputs)
        print(k, flush=True)
"""


@pytest.mark.processes
def test_killed_writer_loses_no_more_than_it_says(tmp_path):
    path = tmp_path / "killed"
    code = KILLED.format(tests=str(Path(__file__).parent), path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if int(line) >= 100:
                break
        os.kill(process.pid, signal.SIGKILL)
        written = int((process.stdout.read().split("\n")[-2:] or [""])[0] or line)
    assert not (path / "metadata.yaml").exists()
    found = list(read_ticks(path))
    assert written >= 100
    assert [tick.k for tick in found] == list(range(len(found)))
    assert [tick.state[9] for tick in found] == list(range(len(found)))
    assert (written + 1 - len(found)) * scenario().h <= KEEP_EVERY
    assert read_log(path).sizes["tick"] >= 1


@pytest.mark.long
def test_cut_anywhere_a_log_is_a_shorter_one_or_refused(folder, tmp_path):
    whole, full = (folder / "flight.mcap").read_bytes(), without_speed(flight())
    lengths: list[int] = []
    problems: list[str] = []
    for size in [*range(0, 40, 7), *np.linspace(40, len(whole), 30).astype(int).tolist()]:
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(whole[:size])
        try:
            found = read_log(cut)
        except InputError as error:
            problems.append(str(error))
            lengths.append(0)
        else:
            lengths.append(found.sizes["tick"])
            assert found.equals(full.isel(tick=slice(0, lengths[-1])))
    assert len(problems) > 5
    assert all("cut" in problem and "\n" not in problem for problem in problems if "not an MCAP" not in problem)
    assert lengths == sorted(lengths)
    assert lengths[0] == 0
    assert lengths[-1] == full.sizes["tick"]
    assert len(set(lengths)) > 5  # half a second each of three


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_refused_in_one_line_or_harmless(folder, tmp_path, data):
    whole = bytearray((folder / "flight.mcap").read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(whole)
    try:
        ticks_found, problem = list(read_ticks(broken)), ""
    except InputError as error:
        ticks_found, problem = [], str(error)
    assert not problem or (problem.startswith(str(broken)) and "\n" not in problem)
    # Chunks carry check sums: what is read is what was written.
    for found, tick in zip(ticks_found, ticks(), strict=False):
        assert_same(found.outputs, tick.outputs)


@given(values=arrays(np.float64, st.integers(0, 300), elements=st.floats(allow_nan=True, allow_infinity=True)))
def test_any_vector_keeps_its_bits(values):
    data = to_cdr(ARRAY_TYPE, {"layout": {"dim": [{"label": "any", "size": len(values)}]}, "data": values})
    assert from_cdr(ARRAY_TYPE, data).data.tobytes() == values.tobytes()


@given(image=arrays(np.uint8, array_shapes(min_dims=2, max_dims=2, max_side=12).map(lambda s: (*s, 4))))
def test_any_picture_keeps_its_bits(image):
    for picture in (image, np.concatenate([image[..., :3], np.full_like(image[..., :1], 255)], axis=2)):
        np.testing.assert_array_equal(image_of(image_message(0.0, picture)[2]["data"]), picture)


def test_absent_fields_are_zero_for_every_type():
    for name in ("sensor_msgs/msg/Range", "vision_msgs/msg/Detection2DArray", "nav_msgs/msg/Odometry"):
        store = typestore()
        data = to_cdr(name, {})
        read = store.deserialize_cdr(data, name)
        assert (read.header.stamp.sec, read.header.frame_id) == (0, "")
        assert bytes(store.serialize_cdr(store.deserialize_cdr(data, name), name)) == data
    hypothesis = message_maker("vision_msgs/msg/ObjectHypothesisWithPose")({})
    assert hypothesis.pose.covariance.shape == (36,)


def test_layout_plots_what_is_logged(folder):
    """Each of its paths is in a log of today, and under the name that the scenario has for it."""
    layout = json.loads((Path(log_reader.__file__).parent / "foxglove_layout.json").read_text())
    text = json.dumps(layout)
    log = list(read_logged(log_file(folder), lambda topic: True))
    sizes = {m.topic: len(from_cdr(ARRAY_TYPE, m.data).data) for m in log if m.type_name == ARRAY_TYPE}
    measurement = scenario().measurement
    names = {"/ortilo/y": measurement.outputs, "/ortilo/delta": [f"{s} arrived" for s in measurement.sensors]}
    for panel in layout["configById"].values():
        for path in panel.get("paths", []):
            topic, index = path["value"].rstrip("]").split(".data[")
            assert int(index) < sizes[topic]
            assert topic not in names or path["label"] == names[topic][int(index)]
    shown = {topic for panel in layout["configById"].values() for topic in panel.get("topics", {})}
    assert shown <= {message.topic for message in log}
    assert f'"/ortilo/state.data[{STATE_NAMES.index("phi")}]"' in text
    for panel in layout["configById"]:
        assert text.count(f'"{panel}"') == 2  # set up and placed


def test_existing_log_is_refused(folder):
    before = (folder / "flight.mcap").read_bytes()
    with pytest.raises(InputError, match="exists, a log is never overwritten"), LogWriter(folder, scenario()):
        pass
    assert (folder / "flight.mcap").read_bytes() == before


def test_bad_places(tmp_path):
    with pytest.raises(InputError, match=r"without \.mcap"), LogWriter(tmp_path / "a.mcap", scenario()):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), LogWriter(tmp_path / "file" / "log", scenario()):
        pass
    with pytest.raises(InputError, match="no such log"):
        read_log(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"holds 0 \.mcap files"):
        log_file(tmp_path)
    with pytest.raises(InputError, match="not an MCAP file"):
        read_log(tmp_path / "file")
    with LogWriter(tmp_path / "empty", scenario()) as log:
        pass
    with pytest.raises(InputError, match="before its first tick"):
        read_log(log.path)


def foreign(path, topic, type_name, fields):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema(type_name, "ros2msg", definition(type_name).encode())
        writer.add_message(writer.register_channel(topic, "cdr", schema), 0, to_cdr(type_name, fields), 0)
        writer.finish()
    return path


def test_foreign_files_are_refused(tmp_path):
    string = "std_msgs/msg/String"
    other = foreign(tmp_path / "other.mcap", "/chatter", string, {"data": "hello"})
    with pytest.raises(InputError, match="not a log of ortilo-drake"):
        read_log(other)
    for data in ("no json", "{}", "[1]", '{"format": 2, "scenario": 3, "software": ""}'):
        with pytest.raises(InputError, match="not a log of ortilo-drake"):
            read_log(foreign(tmp_path / "a.mcap", SCENARIO_TOPIC, string, {"data": data}))
    about = {"format": 3, "scenario": "{}", "software": "ortilo-drake 9"}
    with pytest.raises(InputError, match="format 3, this version reads format 2"):
        read_log(foreign(tmp_path / "b.mcap", SCENARIO_TOPIC, string, {"data": json.dumps(about)}))
    about |= {"format": 2, "scenario_format": 2, "scenario": '{"seed": -1}'}
    with pytest.raises(InputError, match="seed"):
        read_log(foreign(tmp_path / "c.mcap", SCENARIO_TOPIC, string, {"data": json.dumps(about)}))


@pytest.mark.parametrize("version", [None, 1, 3, "2"])
def test_a_scenario_of_another_format_is_refused(version, tmp_path):
    about = {"format": 2, "scenario": "{}", "scenario_format": version, "software": "ortilo-drake 9"}
    path = foreign(tmp_path / "new.mcap", SCENARIO_TOPIC, "std_msgs/msg/String", {"data": json.dumps(about)})
    with pytest.raises(InputError, match=rf"new\.mcap: is of format {version}, this version reads format 2"):
        log_scenario(path)


@pytest.mark.long
def test_the_log_of_registered_sensors_is_their_flight(tmp_path):
    flown = fly_logged(load_scenario("flow", ("settle=0", "planner={kind: hover, duration: 1}")), tmp_path / "log")
    xr.testing.assert_identical(read_log(tmp_path / "log"), without_speed(flown))
    assert log_scenario(tmp_path / "log").sensors[-2:] == ("altimeter", "flow")
    sizes = {name: value.size for tick in read_ticks(tmp_path / "log") for name, value in tick.messages.items()}
    assert {name: sizes[name] for name in ("altimeter", "flow")} == {"altimeter": 2 + 1, "flow": 2 + 5}
    outputs = next(read_ticks(tmp_path / "log")).outputs
    assert [outputs[name].size for name in ("y", "delta", "V2")] == [12, 5, 32]


def test_ticks_must_ascend(tmp_path):
    with LogWriter(tmp_path / "log", scenario()) as log:
        log.write_tick(*ticks()[3])
        with pytest.raises(ValueError, match="tick 3 after tick 3"):
            log.write_tick(*ticks()[3])


def test_log_of_a_flight_that_raised_is_complete(tmp_path):
    def fails():
        with LogWriter(tmp_path / "log", scenario()) as log:
            for tick in ticks()[:10]:
                log.write_tick(*tick)
            raise RuntimeError("onboard")

    with pytest.raises(RuntimeError, match="onboard"):
        fails()
    assert read_log(tmp_path / "log").sizes["tick"] == 10
    assert (tmp_path / "log" / "metadata.yaml").exists()


@pytest.mark.parametrize("rate", [7.3, 30.0, 333.0, 1000.0])
def test_tick_numbers_come_back_at_any_rate(tmp_path, rate):
    flown = load_scenario(
        "nominal_imu_uwb_yolo", (*SETTINGS, f"control_rate={rate}", "uwb.link.rate=null", "camera.link.rate=null")
    )
    ks = [0, 1, 2, 999, 12345, 3_600_000]
    path = write(tmp_path / "log", flown, [(k, None, {}, {"control": np.ones(4)}) for k in ks])
    assert [tick.k for tick in read_ticks(path)] == ks
