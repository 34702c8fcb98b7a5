"""`ortilo report`: what other commands wrote is on one page, whole; everything else is refused."""

import base64
import html
import json
import os
import re
import shlex
from dataclasses import fields
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import ortilo_drake.commands
from ortilo_drake.commands.doctor import Finding
from ortilo_drake.commands.report import report
from ortilo_drake.flight.summary import Summary
from ortilo_drake.hil.bridge import BridgeReport
from ortilo_drake.hil.real_time.profile import ProfileRow as BlockRow
from ortilo_drake.hil.reports import OnboardReport, WorldReport
from ortilo_drake.hil.wire.inbox import PacketCounts
from ortilo_drake.interop.log.replay import ReplayReport
from ortilo_drake.model.input_error import InputError
from ortilo_drake.scenario import load_scenario
from ortilo_drake.scenario.noise_file import NoiseFile
from ortilo_drake.studies.faults.fault_flights import FaultStudy
from ortilo_drake.studies.hindsight.hindsight import Hindsight
from ortilo_drake.studies.live.live_bridge import LiveReport
from ortilo_drake.studies.maps.map_flights import Map
from ortilo_drake.studies.predict.predicted import Group
from ortilo_drake.studies.rare.rare_flights import Rare
from ortilo_drake.studies.recorded.fit_noise import Fitted
from ortilo_drake.studies.rooms.coverage import Coverage
from ortilo_drake.studies.tuning.search import Found
from ortilo_drake.studies.tuning.tune import Tuning
from ortilo_drake.training.judging.judge import Judgement
from ortilo_drake.training.judging.recognised import Recognised
from ortilo_drake.views.page.flight_page import repeat_command
from ortilo_drake.views.page.report_page import KINDS, Kind, data_html, markdown_html, report_page

SENSITIVITY = """# What must you know, how well: own_room

| what <it> does not know | lost |
| --- | --- |
| none | 0 of 8 |
| mass | 3 of 8 |
"""


def keys_of(kind: Any) -> dict[str, Any]:
    """Return an object with a dataclass's or a NamedTuple's fields as keys, as a JSON file of it has."""
    names = kind._fields if hasattr(kind, "_fields") else [field.name for field in fields(kind)]
    return dict.fromkeys(names)


WRITTEN: dict[str, Any] = {
    "fly": keys_of(Summary) | {"scenario": "own", "mse": {"x": 0.001}},
    "tables --preset": {"preset": "tuned", "flights": 2, "estimation": {"a": {"x": 1.5}}, "path": {}, "paper": {}},
    "analyze": {"scenario": "own", "no_theory": None, "flights": 0, "no_tube": None},
    "sensitivity": {
        "scenario": "own",
        "rows": [{"name": "mass", "value": 2.5}, {"name": "yaw", "value": 0.5}],
        "limits": {},
    },
    "faults": keys_of(FaultStudy),
    "rare": {"scenario": "own", "verdict": "fewer than 0.0076 (95 %), none in 500 flights"} | keys_of(Rare),
    "map": keys_of(Map) | {"sweep": {"scenario": "own"}},
    "fit": {**dict.fromkeys(NoiseFile.model_fields), "recordings": ["one"]},
    "predict": {"noise": {"source": "own"}, "flights": [{"name": "one"}], "group": keys_of(Group)},
    "replay --map": {"map": {"name": "x"}, "motions": [{"name": "one"}]},
    "replay": keys_of(ReplayReport),
    "hindsight": keys_of(Hindsight) | {"scenario": "own"},
    "tune": keys_of(Tuning) | {"scenario": "own"},
    "tune --fly": keys_of(Found) | {"search": {"scenario": "own"}},
    "tune --map": keys_of(Fitted) | {"settings_before": {}},
    "room coverage": keys_of(Coverage) | {"room": "own"},
    "room place": {"scenario": "own", "candidates": 9, "before": {}, "after": {}, "gain": 0.5, "landmarks": []},
    "room survey": {"room": "own", "known": [1], "anchors": [[0.0, 1.0, 2.0]], "sd": [], "covariance": [[1.0]]},
    "detector evaluate": keys_of(Judgement),
    "detector recognise": [keys_of(Recognised)] * 2,
    "doctor": [keys_of(Finding)],
    "hil check": {"identical": True, "latency_ms": {"p50": 1.25}, "missed_deadlines": None, "lost": None},
    "hil bridge": keys_of(BridgeReport),
    "hil bridge --from": keys_of(LiveReport),
    "hil world": WorldReport(3, PacketCounts(3, 0, 0, 0, 0, {})).lines() | {"lost": None},
    "hil onboard": OnboardReport(3, PacketCounts(3, 0, 0, 0, 0, {})).lines(),
    "hil onboard --profile": [keys_of(BlockRow), keys_of(BlockRow)],
    "hil relay": {"to_onboard": {"sent": 5}, "to_world": {"sent": 7}},
}


class Cells(HTMLParser):
    """The texts of a page's table cells, row by row."""

    def __init__(self, page: str):
        super().__init__()
        self.rows: list[list[str]] = []
        self._open = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self._open = True

    def handle_endtag(self, tag: str) -> None:
        self._open = self._open and tag not in ("td", "th")

    def handle_data(self, data: str) -> None:
        if self._open:
            self.rows[-1][-1] += data


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "own_room.md").write_text(SENSITIVITY, encoding="utf-8")
    cv2.imwrite(str(tmp_path / "own_room.png"), np.full((8, 8, 3), 77, np.uint8))
    (tmp_path / "notes.md").write_text("# My notes\n\nnot a report", encoding="utf-8")
    return tmp_path


def test_the_page_of_a_report_that_says_how_it_was_made_says_it_too(tmp_path: Path) -> None:
    text = "# What must you know, how well: own_room\n\nMade by `ortilo sensitivity own_room --flights 2` with x 1.\n"
    (tmp_path / "own_room.md").write_text(text)
    page = report_page(tmp_path)
    assert "<code>ortilo sensitivity own_room --flights 2</code>" in page
    assert "not recorded" not in page
    (tmp_path / "own_room.md").write_text(text.split("Made by")[0])
    assert "not recorded" in report_page(tmp_path)


def test_a_folder_s_text_tables_and_figures_are_on_its_page(folder: Path) -> None:
    report(folder)
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<h1>What must you know, how well: own_room</h1>" in page
    rows = Cells(page).rows
    assert rows[:3] == [["what <it> does not know", "lost"], ["none", "0 of 8"], ["mass", "3 of 8"]]
    assert ["written by", "ortilo sensitivity own_room"] in rows
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert base64.b64decode(picture) == (folder / "own_room.png").read_bytes()
    assert "My notes" not in page
    assert "http" not in page


@pytest.mark.parametrize("command", list(WRITTEN))
def test_a_json_file_is_known_by_what_is_in_it(tmp_path: Path, command: str) -> None:
    file = tmp_path / "written.json"
    file.write_text(json.dumps(WRITTEN[command]), encoding="utf-8")
    report(file)
    page = (tmp_path / "written.html").read_text(encoding="utf-8")
    assert f"<h1>ortilo {command.split(' --')[0]}" in page
    assert re.search(rf"<code>ortilo {command}( own| tuned)?</code>", page)


def test_every_json_file_that_a_command_writes_is_known() -> None:
    """Each command that writes JSON is among those above; two modules write two or three kinds."""
    commands = Path(ortilo_drake.commands.__file__).parent
    others = [file.read_text() for file in commands.rglob("*.py") if file.name != "terminal.py"]  # which defines both
    assert sum(text.count(f"{call}(") for text in others for call in ("write_json", "hand_over")) == len(WRITTEN)


FOLDERS = {
    "rare": ("# own: about one flight in 1,136 strays 0.13 m or more from its reference", "ortilo rare own"),
    "rare, never": ("# own loses its vehicle: fewer than 0.0076 (95 %), none in 500 flights", "ortilo rare own"),
    "rare, a bound": ("# own: fewer than one flight in 16,000 loses its vehicle (95 %); more", "ortilo rare own"),
    "rare, an often bound": ("# own loses its vehicle in fewer than 40% of flights (95 %); more", "ortilo rare own"),
    "rare, counted": ("# own: about one flight in 250 loses its vehicle, by counting: 2 of 500", "ortilo rare own"),
    "rare, often": ("# own loses its vehicle in about 70% of flights (95 %: 63% to 78%)", "ortilo rare own"),
    "rare, path": (
        "# own: about one flight in 90 strays 5 m or more from its path (95 %: one in 60 to",
        "ortilo rare own",
    ),
    "rare, path, bound": ("# own strays 5 m or more from its path: fewer than 0.1 (95 %), none", "ortilo rare own"),
    "rare, corridor": ("# own strays 5 m or more from its reference: fewer than 0.1 (95 %), none", "ortilo rare own"),
    "map": ("# A map of own over uwb.link.loss, seed", "ortilo map"),
    "recorded": ("# Recorded motions", "ortilo replay --map"),
    "faults": ("# Faults in flight: own other", "ortilo faults"),
    "predicted": ("# Predicted flights", "ortilo predict"),
}


@pytest.mark.parametrize("name", list(FOLDERS))
def test_the_folder_of_each_study_is_known_by_its_report(tmp_path: Path, name: str) -> None:
    heading, command = FOLDERS[name]
    pictures = {"map": "map.png", "recorded": "motion.png", "faults": "faults.png", "predicted": "predicted.png"}
    picture = pictures.get(name)
    (tmp_path / "study.md").write_text(f"{heading}\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n", encoding="utf-8")
    if picture:
        cv2.imwrite(str(tmp_path / picture), np.full((8, 8, 3), 77, np.uint8))
    report(tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"<h1>{heading.removeprefix('# ')}</h1>" in page
    assert ["written by", command] in Cells(page).rows
    assert page.count("<figure>") == (picture is not None)


def test_a_page_shows_svg_figures_as_images_and_no_pdf(folder: Path) -> None:
    (folder / "own_room.png").unlink()
    drawn = b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg"><text>said</text></svg>'
    (folder / "own_room.svg").write_bytes(drawn)
    (folder / "own_room.pdf").write_bytes(b"%PDF-1.4")
    (picture,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', report_page(folder))
    assert base64.b64decode(picture) == drawn
    (folder / "own_room.svg").write_text("no picture")
    with pytest.raises(InputError, match=r"own_room\.svg: is no SVG"):
        report_page(folder)


def test_a_figure_of_another_folder_is_not_taken(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    for subject in ("../outside", "/outside", "*"):
        (inside / "study.md").write_text(f"# What must you know, how well: {subject}\n", encoding="utf-8")
        for file in (tmp_path / "outside.png", inside / "other.png"):
            cv2.imwrite(str(file), np.full((8, 8, 3), 77, np.uint8))
        assert "<figure>" not in report_page(inside)


def test_rows_alike_are_a_table() -> None:
    rows = Cells(data_html(WRITTEN["sensitivity"])).rows
    assert rows[1:4] == [["", "name", "value"], ["1", "mass", "2.5"], ["2", "yaw", "0.5"]]


def test_html_in_a_text_is_shown_as_it_stands() -> None:
    assert markdown_html("a <script>b</script>") == "<p>a &lt;script&gt;b&lt;/script&gt;</p>\n"
    assert "<script>" not in data_html({"<script>": {"<script>": "<script>"}})


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("fly.json", b'{"scenario": "x", "seed": 0}', "not written by a command that reports"),
        ("rows.json", b'[{"number": 1}, {"label": 2}]', "not written by a command that reports"),
        ("empty.json", b"[]", "not written by a command that reports"),
        ("map.csv", b"loss,rms\n0.5,0.1\n", "is no JSON"),
        ("list.json", b"[1, 2]", "not written by a command that reports"),
        ("deep.json", b"[" * 100_000, "is no JSON"),
        ("text.json", b"hello", "is no JSON"),
        ("bytes.json", b"\xff\xfe", "is no JSON"),
        ("flight.nc", b"CDF", "damaged, or not made by ortilo"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, name: str, content: bytes, said: str) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: .*{said}"):
        report(file)
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_a_folder_without_a_report_a_missing_file_and_a_false_picture_are_refused(folder: Path) -> None:
    (folder / "empty").mkdir()
    with pytest.raises(InputError, match="empty: holds no report"):
        report(folder / "empty")
    with pytest.raises(InputError, match="gone: cannot be read"):
        report(folder / "gone")
    (folder / "own_room.png").write_text("<svg>")
    with pytest.raises(InputError, match=r"own_room\.png: is no PNG"):
        report(folder)


def test_the_file_reported_on_is_not_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "written.json"
    file.write_text(json.dumps(WRITTEN["tables --preset"]), encoding="utf-8")
    with pytest.raises(InputError, match="is the file to report on"):
        report(file, file)


@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("uwb.link.loss=0.25",),
        ("planner={kind: hover, point: [1, 1, 1.5]}", "vehicle.mass=2.9", "camera.kind=projected"),
    ],
)
def test_the_command_of_a_page_flies_the_same_scenario(settings: tuple[str, ...]) -> None:
    scenario = load_scenario("imu_uwb_yolo", settings, 5)
    command = repeat_command(scenario)
    assert command is not None
    words = shlex.split(command)
    assert words[:5] == ["ortilo", "fly", "imu_uwb_yolo", "--seed", "5"]
    assert load_scenario(words[2], tuple(words[6::2]), int(words[4])) == scenario


def test_a_scenario_of_an_unknown_file_has_no_command() -> None:
    assert repeat_command(load_scenario("imu_uwb").model_copy(update={"name": "of_mine"})) is None


def write_picture(file: Path) -> None:
    done, data = cv2.imencode(".png", np.full((8, 8, 3), 77, np.uint8))
    assert done
    file.write_bytes(data.tobytes())


def test_a_link_out_of_the_folder_is_refused_and_one_within_it_is_taken(tmp_path: Path) -> None:
    inside, secret = tmp_path / "inside", tmp_path / "secret.png"
    (inside / "pictures").mkdir(parents=True)
    for picture in (secret, inside / "pictures" / "own.png"):
        write_picture(picture)
    (inside / "study.md").write_text("# Analysis of own\n", encoding="utf-8")
    (inside / "own.png").symlink_to("pictures/own.png")
    assert report_page(inside).count("<figure>") == 1
    (inside / "worse.png").symlink_to(secret)
    with pytest.raises(InputError, match=r"worse\.png: is a link out of the folder"):
        report_page(inside)
    (inside / "worse.png").unlink()
    (inside / "study.md").rename(tmp_path / "study.md")
    (inside / "other.md").symlink_to(tmp_path / "study.md")
    with pytest.raises(InputError, match=r"other\.md: is a link out of the folder"):
        report_page(inside)


def test_links_in_a_circle_and_names_that_no_file_can_have_are_refused(tmp_path: Path) -> None:
    (tmp_path / "circle").symlink_to("circle")
    for name in ("circle", "n" * 300, "a\0b"):
        with pytest.raises(InputError):
            report(tmp_path / name)


def test_all_figures_together_have_a_largest_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "study.md").write_text("# Analysis of own\n", encoding="utf-8")
    for name in "abc":
        write_picture(tmp_path / f"{name}.png")
    monkeypatch.setattr("ortilo_drake.views.page.report_page.LARGEST_FOLDER", 150)
    with pytest.raises(InputError, match="its reports and figures must have at most"):
        report_page(tmp_path)


HOSTILE = "\"'><script>alert(1)<img src=x onerror=alert(1)>"


class Tags(HTMLParser):
    """Every tag of a page, and every attribute that runs a script or loads something."""

    def __init__(self, page: str):
        super().__init__()
        self.names: set[str] = set()
        self.attributes: set[tuple[str, str]] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.names.add(tag)
        self.attributes |= {(name, value[:15]) for name, value in attrs if name in ("src", "href") or name[:2] == "on"}


def has_only_its_own(page: str) -> bool:
    """Return whether a page has no script and loads nothing but its own figures."""
    tags = Tags(page)
    return "script" not in tags.names and {value for _, value in tags.attributes} <= {"data:,", "data:image/png;"}


def test_names_from_files_are_text_on_the_page(tmp_path: Path) -> None:
    folder = tmp_path / HOSTILE
    folder.mkdir()
    text = (
        f"# What must you know, how well: own\n\n## {HOSTILE}\n\n- {HOSTILE}\n- `{HOSTILE}`\n\n| {HOSTILE} |\n|---|\n"
    )
    for name in ("own", os.fsdecode(b"\xff")):
        write_picture(folder / f"{name}{HOSTILE}.png")
    (folder / "own.md").write_text(text, encoding="utf-8")
    (folder / "other.md").write_text("# Analysis of own\n", encoding="utf-8")
    page = report_page(folder)
    assert has_only_its_own(page)
    assert page.count("<figure>") == 2
    assert f"\ufffd{html.escape(HOSTILE)}" in page


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.command)
def test_texts_and_keys_of_a_json_file_are_text_on_the_page(kind: Kind, tmp_path: Path) -> None:
    data: dict[str, Any] = {key: {HOSTILE: [HOSTILE, {HOSTILE: HOSTILE}]} for key in kind.keys}
    if kind.subject:
        *group, name = kind.subject.split(".")
        data |= {group[0]: {name: HOSTILE}} if group else {name: HOSTILE}
    (tmp_path / "own.json").write_text(json.dumps(data), encoding="utf-8")
    assert has_only_its_own(report_page(tmp_path / "own.json"))


@example("|---|")
@given(st.text("#|-:*` ab\n<>&'\"\x0c\u2028", max_size=60))
def test_any_markdown_gives_a_page_without_a_tag_of_its_own(text: str) -> None:
    headings, cells = {f"h{level}" for level in range(1, 7)}, {"table", "thead", "tbody", "tr", "th", "td"}
    words = {"p", "ul", "ol", "li", "code", "pre", "strong", "em", "blockquote", "hr", "br"}
    assert Tags(markdown_html(text)).names <= headings | cells | words


@pytest.mark.parametrize("text", ["![a](http://b/c.png)", "[a](javascript:b)", "<http://b>", "[a]\n\n[a]: http://b"])
def test_nothing_in_a_text_leads_out_of_the_page(text: str) -> None:
    assert Tags(markdown_html(text)).names == {"p"}
