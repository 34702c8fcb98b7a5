"""What the pages on viewers name is in a log and in a recording: topics by MCAP's own reader, entities by Rerun's."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest
from mcap.reader import make_reader

from ortilo_drake.interop.log.writer import fly_logged
from ortilo_drake.interop.rerun.recording import save_recording
from ortilo_drake.interop.rerun.sightings import SightingsRecorder
from ortilo_drake.interop.ros.ros_messages import LATCHED
from ortilo_drake.scenario import load_scenario

HOW_TO = Path(__file__).parents[2] / "docs/how_to"
SETTINGS = ("planner={kind: waypoints, points: [[0, 0, 1.5], [0.3, 0, 1.5]]}", "settle=0")
DRAWN = {"/camera/image/compressed", "/ortilo/shutter"}  # of a rendered camera alone
DIFFERENCES = {"differences"}  # of a UWB that measures differences of ranges alone


def in_code(page: str, beginning: str) -> set[str]:
    """Return what stands in a page's code and begins so."""
    return set(re.findall(rf"`({beginning}[\w/]*)`", (HOW_TO / page).read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the log `log`, and with `flight.rrd` where Rerun is installed, of a flight on boxes."""
    made = tmp_path_factory.mktemp("pages")
    scenario = load_scenario("nominal_imu_uwb_yolo", (*SETTINGS, "camera.kind=projected"))
    recorder = SightingsRecorder(scenario)
    flight = fly_logged(scenario, made / "log", also=recorder.record)
    if find_spec("rerun"):
        save_recording(flight, recorder.sightings, made / "flight.rrd")
    return made


def test_topics_of_the_pages_are_in_a_log(folder: Path) -> None:
    with (folder / "log/log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    logged = {channel.topic for channel in summary.channels.values()}
    encodings = {
        (s.encoding, c.message_encoding) for c in summary.channels.values() for s in [summary.schemas[c.schema_id]]
    }
    assert encodings == {("ros2msg", "cdr")}
    named = in_code("plotjuggler.md", "/")
    assert named - DRAWN <= logged
    assert len(named) > 15
    anchors = {topic for topic in logged if topic.startswith("/uwb/anchor_")}
    assert logged - anchors <= named | DRAWN
    published = in_code("ros2.md", "/") - {"/goal_pose"}
    assert published - DRAWN <= logged
    assert {topic for topic in logged - anchors if not topic.startswith("/ortilo/")} <= published
    assert set(LATCHED) <= named


@pytest.mark.long
@pytest.mark.skipif(find_spec("rerun") is None, reason="rerun-sdk missing: pip install 'ortilo-drake[rerun]'")
def test_entities_of_the_page_are_in_a_recording(folder: Path) -> None:
    from rerun.chunk import RrdReader

    entities = {chunk.entity_path.removeprefix("/") for chunk in RrdReader(folder / "flight.rrd").stream()}
    roots = {path.split("/")[0] for path in entities} - {"__properties"}
    table = [row for row in (HOW_TO / "rerun.md").read_text(encoding="utf-8").splitlines() if row.startswith("| `")]
    named = {name.rstrip("/") for row in table for name in re.findall(r"`([\w/]+)`", row.split("|")[1])}
    assert {name.split("/")[0] for name in named if name in roots or "/" in name} - DIFFERENCES == roots
    known = entities | roots | {path.rsplit("/", 1)[-1] for path in entities} | {"world/truth/camera/picture"}
    assert {name for name in named if not (name.endswith("SENSOR") or name.startswith("differences/"))} <= known
