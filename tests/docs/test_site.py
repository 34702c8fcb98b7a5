"""The documentation site: it builds without a warning, holds every command and setting, and names what exists."""

import ast
import html
import importlib
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote

import pytest
import typer
from mcap.reader import make_reader
from module_of import module_of

from ortilo_drake.commands.app import app
from ortilo_drake.flight.engine import Engine
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.rerun.recording import save_recording
from ortilo_drake.interop.rerun.sightings import SightingsRecorder
from ortilo_drake.interop.ros.ros_messages import LATCHED
from ortilo_drake.scenario import load_scenario

ROOT = Path(__file__).parents[2]
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/how_to").glob("*.md"))]
EXTRA = ("sphinx", "myst_nb", "pydata_sphinx_theme")

KEYS = "from ortilo_drake.scenario.schema import scenario_keys; print(*(key.key for key in scenario_keys()))"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    missing = [name for name in EXTRA if find_spec(name) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} missing: pip install 'ortilo-drake[docs]'")
    folder = tmp_path_factory.mktemp("site")
    paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = ["-q", "-W", "--keep-going", "-b", "html", "-d", str(folder / "doctrees"), "docs", str(folder / "html")]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *words],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def text_of(page: Path) -> str:
    return html.unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8")))


@pytest.mark.long
def test_every_setting_stands_in_the_site(site: Path) -> None:
    """In a process of its own, as other tests of this one register sensors."""
    text = text_of(site / "reference/settings.html")
    said = subprocess.run([sys.executable, "-c", KEYS], capture_output=True, text=True, check=True).stdout
    keys = said.split()
    assert len(keys) > 200
    assert [key for key in keys if key not in text] == []


@pytest.mark.long
def test_every_command_and_option_stands_in_the_site(site: Path) -> None:
    text = text_of(site / "reference/commands.html")
    groups = [("ortilo", typer.main.get_command(app))]
    for name, command in groups:
        assert name in text
        groups += [(f"{name} {its}", part) for its, part in getattr(command, "commands", {}).items()]
        assert [o for p in command.params for o in p.opts if o.startswith("--") and o not in text] == []
    assert len(groups) > 20


@pytest.mark.long
def test_functions_have_pages_and_equations_are_drawn_by_the_browser_alone(site: Path) -> None:
    paper = (site / "paper.html").read_text(encoding="utf-8")
    assert paper.count('<math xmlns="http://www.w3.org/1998/Math/MathML" display="block"') >= 10
    assert re.search(r'href="[^"]*ortilo_drake\.onboard\.estimator\.intermittent_filter\.intermittent_step"', paper)
    for page in ("index", "paper", "results", "reference/settings", "notebooks/01_fly_the_paper"):
        text = (site / f"{page}.html").read_text(encoding="utf-8")
        assert re.findall(r'<(?:script|link|img)[^>]+(?:src|href)="(?:https?:)?//', text) == [], page


@pytest.mark.long
def test_a_field_stands_in_the_site_with_the_sentence_below_it(site: Path) -> None:
    """Those of NamedTuples too, whose fields Sphinx takes for documented where they have no sentence."""
    shown = 0
    for file in sorted((ROOT / "ortilo_drake").rglob("*.py")):
        module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        written = [node for node in ast.parse(file.read_text(encoding="utf-8")).body if isinstance(node, ast.ClassDef)]
        pairs = [pair for its in written if its.name[0] != "_" for pair in pairwise(its.body)]
        fields = [
            text.value.value
            for field, text in pairs
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        ]
        own = site / f"reference/modules/{module}.html"
        if fields and own.exists():  # ortilo_drake.codegen has none
            page = plain(text_of(own))
            assert [field for field in fields if plain(field) not in page] == [], module
            assert "Alias for field" not in page
            shown += len(fields)
    assert shown > 700


@pytest.mark.long
def test_the_reference_prints_what_one_types(site: Path) -> None:
    """A dash in place of --set cannot be copied; a type's bounds and a default's address hide its name."""
    python, commands = text_of(site / "reference/python.html"), text_of(site / "reference/commands.html")
    assert "progress: Callable[[int], None] = ..." in python
    assert re.findall(r"Annotated\[|FieldInfo|<factory>|~\w+\.\w+", python) == []
    assert "With --map" in commands
    assert re.findall(r"\u2013\w+", commands) == []
    assert re.findall(r"\w+\u2026|\w+\.\.\.$", commands, re.MULTILINE) == []  # cut sentences


@pytest.mark.long
def test_links_within_the_site_lead_somewhere(site: Path) -> None:
    """Also those of tables and notebooks, and to headings."""
    pages = [page for page in site.rglob("*.html") if not {"_static", "_modules"} & set(page.parts)]
    marks = {page: set(re.findall(r'\bid="([^"]+)"', page.read_text(encoding="utf-8"))) for page in pages}
    dead, seen = [], 0
    for page in pages:
        for link in set(re.findall(r'(?:href|src)="(?!\w+:)([^"]+)"', page.read_text(encoding="utf-8"))):
            path, _, mark = unquote(html.unescape(link)).partition("#")
            target = (page.parent / path.partition("?")[0]).resolve() if path else page
            seen += 1
            if not target.exists() or (mark and mark not in marks.get(target, {mark})):
                dead.append((page.name, link))
    assert dead == []
    assert seen > 10_000


def test_equations_and_drawings_are_marked_as_such() -> None:
    """Else an equation stands with its braces, and a drawing breaks at the edge of a phone."""
    marks = 0
    for page in [*PAGES, ROOT / "README.md"]:
        text = page.read_text(encoding="utf-8")
        drawn = re.findall(r"^ *(```.*?^) *```", text, re.MULTILINE | re.DOTALL)
        assert [block for block in drawn if "+--" in block and not block.startswith("```text")] == [], page
        text = re.sub(r"^ *```.*?^ *```|^    .*?$", "", text, flags=re.MULTILINE | re.DOTALL)
        words = re.sub(r"\$\$.+?\$\$|`[^`]+`|\$[^$]+\$|\]\([^)]+\)", "", text, flags=re.DOTALL)
        assert re.findall(r"\w+_\{.*|\w+\^[-{\d].*", words) == [], page
        marks += text.count("$$")
    assert marks > 20


def plain(text: str) -> str:
    """Leave out what Sphinx sets in its own way: spaces, quotes, dashes and dots."""
    return re.sub(r"\W", "", text)


@pytest.fixture(scope="module")
def site_pages() -> ModuleType:
    return module_of(ROOT / "docs/site_pages.py")


@pytest.fixture(scope="module")
def tick(site_pages: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the page How a tick goes shows, as a build of the site makes it."""
    folder = tmp_path_factory.mktemp("tick")
    site_pages.write_tick(folder)
    return folder


def test_the_page_of_a_module_that_is_gone_goes_with_those_that_name_it(site_pages: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "a/b").mkdir(parents=True)
    (tmp_path / "a/b/here.py").touch()
    pages = tmp_path / "pages"
    pages.mkdir()
    for name in ("a", "a.b", "a.b.here", "a.b.gone", "a.c", "a.c.gone"):
        (pages / f"{name}.rst").touch()
    site_pages.drop_gone(pages, tmp_path)
    assert [page.stem for page in pages.iterdir()] == ["a.b.here"]


@pytest.mark.long
def test_the_tick_that_the_site_shows_is_the_one_that_flies(tick: Path) -> None:
    flying = Engine(load_scenario("paper_imu_uwb"))._player._fly.py_func.__code__.co_filename
    assert (tick / "paper_imu_uwb.py").read_text(encoding="utf-8") == Path(flying).read_text(encoding="utf-8")


@pytest.mark.long
def test_the_page_explains_every_line_of_a_tick_in_its_order(tick: Path) -> None:
    lines = (tick / "paper_imu_uwb.py").read_text(encoding="utf-8").partition("def fly")[2].splitlines()
    flown = [re.match(r" +(\w+_(?:out|step)(?=\()|trace(?=\[)|return k$)", line) for line in lines]
    calls = list(dict.fromkeys(found.group(1) for found in flown if found))  # the trace has several lines
    page = (ROOT / "docs/tick.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+(?: k)?)(?:\[\.\.\.\])?` \|", page, re.MULTILINE) == calls
    assert len(calls) == 16
    (begin,) = re.findall(r"`(N \+ \d+)`", page)
    assert f"{begin}, " in "\n".join(lines)
    boxes = re.findall(r"^ *\d+ (\w+) ", (tick / "paper_imu_uwb.txt").read_text(encoding="utf-8"), re.MULTILINE)
    assert boxes == [call.rpartition("_")[0] for call in calls if "_" in call and call != "figures_out"]


def test_functions_that_the_pages_name_exist() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    named = re.findall(r"\{py:(\w+)\}`~?([\w.]+)`", text)
    assert len(named) > 15
    for kind, name in named:
        if kind == "mod":
            assert find_spec(name) is not None
            continue
        module, _, attribute = name.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute), name


def test_the_tests_that_stand_for_a_claim_exist_and_every_row_has_one() -> None:
    text = (ROOT / "docs/how_we_know.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| ") and not line.startswith("| claim")]
    assert len(rows) > 25
    for row in rows:
        files = re.findall(r"`([a-z/]+/test_\w+\.py)`", row)
        assert files or "mutants.md" in row, row
        assert [file for file in files if not (ROOT / "tests" / file).exists()] == []


@pytest.mark.long
def test_types_of_other_projects_link_to_their_pages(site: Path) -> None:
    page = (site / "reference/modules/ortilo_drake.world.vehicle.failsafe.html").read_text(encoding="utf-8")
    assert re.search(r'href="https://drake\.mit\.edu/pydrake/[^"]+#pydrake\.systems\.framework\.LeafSystem"', page)


def test_every_name_of_the_inventory_of_drake_is_there() -> None:
    lines = (ROOT / "docs/inventories/drake.txt").read_text(encoding="utf-8").splitlines()[3:]
    assert len(lines) > 50
    for line in lines:
        name, kind, page = line.split()
        module = page.removesuffix(".html")
        found = getattr(importlib.import_module(module), name.removeprefix(f"{module}."))
        assert isinstance(found, type) == (kind == "class"), name


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
