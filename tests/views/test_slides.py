"""Slides: every figure that a command draws is 16:9, its words large enough for a room and none cut or over another."""

import ast
import re
from collections.abc import Callable
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from command_line import run
from made_up_summaries import made_up_summary
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

import ortilo_drake
from ortilo_drake.flight.intervals import Middle
from ortilo_drake.hil.real_time.latency_figure import latency_figure
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.consistency.consistency_figures import nees_figure, tuning_figure, whiteness_figure
from ortilo_drake.studies.faults.catalogue import NAMES
from ortilo_drake.studies.faults.fault_flights import FaultRow, FaultStudy, Phase
from ortilo_drake.studies.faults.fault_report import fault_figure
from ortilo_drake.studies.maps.map_figure import map_figure
from ortilo_drake.studies.maps.map_flights import Map, MapPoint
from ortilo_drake.studies.maps.map_report import MapTheory
from ortilo_drake.studies.maps.sweep import Sweep, points_of
from ortilo_drake.studies.paper_tables.error_figure import error_figure
from ortilo_drake.studies.predict.predicted import Figures, Predicted
from ortilo_drake.studies.predict.predicted_report import predicted_figure
from ortilo_drake.studies.recorded.filtered import Estimate
from ortilo_drake.studies.recorded.reacquired import Innovations
from ortilo_drake.studies.recorded.recorded_figure import motion_figure
from ortilo_drake.studies.recorded.recorded_report import WITH_IMU
from ortilo_drake.studies.recorded.replayed import Replayed
from ortilo_drake.studies.recorded.scores import Scores
from ortilo_drake.studies.rooms.coverage import Along, Case, Coverage, OverFloor
from ortilo_drake.studies.rooms.coverage_figure import coverage_figure
from ortilo_drake.studies.rooms.planned_floor import Stretch
from ortilo_drake.studies.sensitivity.mismatches import TOGETHER, known_mismatches
from ortilo_drake.studies.sensitivity.sensitivity_flights import Limit, Sensitivity
from ortilo_drake.studies.sensitivity.sensitivity_report import sensitivity_figure
from ortilo_drake.studies.tube.tube import nominal_flight
from ortilo_drake.studies.tube.tube_figures import ChanceGrid, bursts_figure, plan_figure, rates_figure
from ortilo_drake.studies.tube.tube_flights import Flown
from ortilo_drake.studies.tube.tube_map import MarginMap, without_blackouts
from ortilo_drake.training.network.train import losses_figure
from ortilo_drake.views.blackout_figures import draw_availability, draw_blackout_errors
from ortilo_drake.views.figures import arrival_figure, flight_figure, trajectory_figure
from ortilo_drake.views.palette import BLUE, GREEN, ORANGE, PURPLE, SKY
from ortilo_drake.views.pictures import save_picture
from ortilo_drake.views.room_plan import save_plan
from ortilo_drake.views.themes import Theme, add_title, balanced, broken_name, dark, themed

LEAST = 18.0  # height of the letters [px]
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}"
NAMED = ("nominal_imu_uwb", "nominal_imu_uwb_yolo")
MIDDLE = Middle(1.0, (0.9, 1.1), 1.0, (0.9, 1.1))
T = np.arange(0.0, 60.0, 0.5)
SENSORS = ("uwb", "camera", "imu")
WHITE = SimpleNamespace(lag_arrivals=SimpleNamespace(r=[[0.1] * 3] * 20, band=[0.05] * 20, p_value=1e-20))
Flights = dict[str, list[xr.Dataset]]


@pytest.fixture(scope="module")
def flights(flown: Callable[..., xr.Dataset]) -> Flights:
    return {name: [flown(name, (SHORT, "camera.kind=projected"), seed) for seed in range(2)] for name in NAMED}


def firsts(flights: Flights) -> dict[str, xr.Dataset]:
    return {name: rows[0] for name, rows in flights.items()}


def of_tuning(_: Flights, path: Path) -> Path:
    number = SimpleNamespace(before=1.0, after=1.5, standard_error=0.1, robust_error=None, stays=None)
    names = [f"estimator.V.imu.{i}" for i in range(3)] + [f"servo.W.{i}" for i in range(8)]
    found = SimpleNamespace(mean=3.1, interval=(2.5, 3.5))
    nees, nis = (dict.fromkeys(of, found) for of in (("all", "start", "blackout", "after", "clear"), SENSORS))
    both = SimpleNamespace(nees=nees, nis=nis)
    numbers = dict.fromkeys((*names, "multilateration.noise.fraction"), number)
    fitted = {"numbers": numbers, "before": both, "after": both, "scenario": "imu_uwb", "flights": [1, 2]}
    return tuning_figure(cast("Any", SimpleNamespace(**fitted)), path)


def of_faults(_: Flights, path: Path) -> Path:
    names = (f"{kind}imu_uwb_yolo" for kind in ("nominal_", "", "robust_", "tight_"))
    scenarios = {name: (k != 2, k < 2, k == 1) for k, name in enumerate(names)}
    good, bad = (Phase(0.1, ratio, 3.0, (2.0, 4.0), MIDDLE, MIDDLE) for ratio in (1.0, 8.4))
    rows = [
        FaultRow(fault, name, 200, 157 * (k == 0), (0.0, 1.0), good, (bad, good, None)[k % 3], good, 1.0, *passed)
        for fault in NAMES
        for k, (name, passed) in enumerate(scenarios.items())
    ]
    return fault_figure(FaultStudy([*scenarios], 200, 22.0, 5.0, [0] * 4, rows, "engine"), path)


def of_map(axes: dict[str, list[float]]) -> Callable[[Flights, Path], Path]:
    def draw(_: Flights, path: Path) -> Path:
        of = validate(Sweep, {"scenario": "imu_uwb", "axes": axes, "flights": 1000}, "sweep")
        points = points_of(of)
        rms = np.geomspace(0.02, 0.4, len(points))
        rows = [
            MapPoint(p, 1000, 60 * i, 0.0, 0.9, r, None, r, None, 0.9 * r, 2.0 * r, 1.0, None, 3.0, None, {})
            for i, (p, r) in enumerate(zip(points, rms, strict=True))
        ]
        drawn = map_figure(
            Map(of, rows, "engine"), path, MapTheory(0.8 * rms, np.linspace(0.0, 0.9, len(rms)), 3.2, None)
        )
        assert drawn is not None
        return drawn

    return draw


def of_motion(_: Flights, path: Path) -> Path:
    way = np.column_stack([np.cos(0.1 * T) * 4.0, np.sin(0.1 * T) * 3.0, 1.5 + 0.0 * T])
    P = np.eye(3) * np.where((T > 20.0) & (T < 30.0), 9.0, 1e-3)[:, np.newaxis, np.newaxis]
    error = np.where((T > 25.0) & (T < 30.0), 1.8, 0.02)[:, np.newaxis]
    run = Innovations(np.full(len(T), 0.1), np.full(len(T), 0.01), np.ones(len(T), dtype=bool))
    estimate = Estimate(T, way + error, P, np.eye(3), run, T, [])
    others = ("smoothed", "not calibrated (biases online)", "50% of the ranges lost")
    names = [WITH_IMU, *(f"{WITH_IMU}, {of}" for of in others)]
    anchors = ((-5.0, -5.0, 0.3), (5.0, -5.0, 2.5), (5.0, 5.0, 0.3), (-5.0, 5.0, 2.5))
    scores = Scores(None, None, None, None, None, 1.0, 0.0, 0.9)
    told: Any = {"name": "flight", "rows": dict.fromkeys(names, scores), "rejected": {}, "notes": []}
    found = Replayed(anchors=anchors, judged_from=18.0, **told)
    return motion_figure(found, dict.fromkeys(names, (estimate, way)), 0.3, path)


def of_sensitivity(_: Flights, path: Path) -> Path:
    limits = [Limit(m.name, 2.0 * m.careful, (1.5 * m.careful, 3.0 * m.careful)) for m in known_mismatches()]
    return sensitivity_figure(Sensitivity(NAMED[1], [], [*limits, Limit(TOGETHER, 2.0, (1.0, None))], "engine"), path)


A = np.geomspace(0.01, 1.0, 5)
MARGINS = MarginMap(A, A, np.add.outer(A, A) - 1.0, np.add.outer(A, A) - 0.5)
CHANCE = ChanceGrid(A, A, np.full((5, 5), 0.001) + 0.01 * (np.add.outer(A, A) < 0.5))
RESULTS: Any = [
    SimpleNamespace(at=at, holds=holds, contained=0.991, lost=3 * (not holds), flights=1000)
    for at, holds in (((0.1, 0.1), True), ((0.02, 0.3), False), ((1.0, 1.0), True))
]


def of_plans(_: Flights, path: Path) -> Path:
    scenario = without_blackouts(load_scenario(NAMED[1], ("camera.kind=projected", SHORT)))
    nominal = nominal_flight(scenario)
    deviation = np.zeros((len(nominal.time), 3))
    some = [Flown(1, deviation, None), Flown(2, deviation, 2.0)]
    return plan_figure(scenario, nominal, {(0.1, 0.1): some, (0.02, 0.3): some}, path)


def of_coverage(sensors: tuple[str, ...]) -> Callable[[Flights, Path], Path]:
    def draw(_: Flights, path: Path) -> Path:
        room = load_scenario("imu_uwb").load_room()
        n, x, y = len(T), np.linspace(-1.5, 29.0, 60), np.linspace(-4.3, 4.5, 20)
        p = np.column_stack([np.linspace(0.0, 20.0, n), np.zeros(n), np.full(n, 1.5)])
        headings = np.arange(24) * np.pi / 12.0 - np.pi
        seen, maps = np.arange(n) % 5, np.add.outer(np.arange(20), np.arange(60)) % 12
        floor = {name: 0.01 + 0.1 * k + 0.001 * T for k, name in enumerate(("all", *sensors))}
        along = Along(T, T / 3.0, p, np.ones(n), seen, 2.0 + 0.0 * T, seen, headings, np.tile(seen, (24, 1)).T, floor)
        over = OverFloor(1.5, x, y, maps > 0, maps, 1.0 + 0.5 * maps, headings[:8] * 3.0 + np.pi, np.array([maps] * 8))
        answer = "From 9.9 to 10.1 m of the way (29.8 to 31.3 s), where even the best estimator errs by 0.36 m; camera "
        answer += "measures nothing there; imu matters most, without it the error is 4.9 m. From 30.9 s on three sigma "
        answer += "of the floor reach a wall."
        cases = dict.fromkeys(floor, Case(0.3, 30.0, 10.0, 30.9))
        worst = Stretch(59, 62, 0.3, "imu", 4.9, ()), (29.8, 31.3)
        found = Coverage("imu_uwb", room.name, answer, *worst, cases, along, over)
        return coverage_figure(found, room, path)

    return draw


def of_prediction(_: Flights, path: Path) -> Path:
    one = Figures(0.1, 3.0, 1.0, 0.01)
    return predicted_figure([Predicted(f"flight_{k}", one, (one,) * 9, (one,) * 9) for k in range(6)], path)


def of_errors(_: Flights, path: Path) -> Path:
    many = [made_up_summary((0.01 * k, 0.02, 0.03), lost="tumbled" if k == 5 else None) for k in range(1, 9)]
    return error_figure({"imu_uwb": many, "imu_uwb_yolo": many, "tight_imu_uwb_yolo": many}, path)


DRAWN: dict[str, Callable[[Flights, Path], Path]] = {
    "flight_figure": lambda flights, path: flight_figure(flights[NAMED[1]][0], path),
    "trajectory_figure": trajectory_figure,
    "arrival_figure": lambda flights, path: arrival_figure(firsts(flights), path),
    "error_figure": of_errors,
    "nees_figure": nees_figure,
    "whiteness_figure": lambda _, path: whiteness_figure(
        dict.fromkeys(NAMED, cast("Any", SimpleNamespace(whiteness=dict.fromkeys(SENSORS, WHITE)))), path
    ),
    "tuning_figure": of_tuning,
    "fault_figure": of_faults,
    "map_figure": of_map({"uwb.link.rate": [2.0, 3.0, 5.0, 10.0], "uwb.link.loss": [0.0, 0.3, 0.6, 0.9]}),
    "map_figure, one axis": of_map({"uwb.link.loss": [0.0, 0.3, 0.6, 0.9]}),
    "motion_figure": of_motion,
    "sensitivity_figure": of_sensitivity,
    "rates_figure": lambda _, path: rates_figure(("uwb", "camera"), MARGINS, CHANCE, RESULTS, path),
    "bursts_figure": lambda _, path: bursts_figure(("uwb", "camera"), MARGINS, CHANCE, RESULTS, path),
    "plan_figure": of_plans,
    "save_plan": lambda _, path: save_plan(load_scenario("imu_uwb").load_room(), None, path),
    "coverage_figure": of_coverage(("uwb", "camera", "imu")),
    "coverage_figure, no camera": of_coverage(("uwb", "imu")),
    "predicted_figure": of_prediction,
    "latency_figure": lambda _, path: latency_figure(np.geomspace(1.0, 30.0, 900), 1.0 / 30.0, path),
    "losses_figure": lambda _, path: losses_figure(
        [{"loss": 4 / k, "box": 1 / k, "object": 2 / k, "class": 1 / k} for k in range(1, 30)], path
    ),
    "plot_blackouts": lambda flights, path: save_picture(draw_blackout_errors(firsts(flights)), path),
    "plot_availability": lambda flights, path: save_picture(draw_availability(flights[NAMED[1]][0]), path),
}


def words(figure: Figure, monkeypatch: pytest.MonkeyPatch) -> list[tuple[Text, Any]]:
    """Return what is written on a figure and where, what lies outside of an axis' limits left out."""
    written: dict[int, Text] = {}
    draw = Text.draw

    def note(self: Text, *rest: Any, **more: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            written[id(self)] = self
        draw(self, *rest, **more)

    renderer = FigureCanvasAgg(figure).get_renderer()
    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", note)
        figure.draw(renderer)
    return [(text, Text.get_window_extent(text, renderer)) for text in written.values()]


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are written from now on."""
    made: list[Figure] = []
    save = Figure.savefig

    def note(self: Figure, *rest: Any, **more: Any) -> None:
        made.append(self)
        save(self, *rest, **more)

    monkeypatch.setattr(Figure, "savefig", note)
    return made


@pytest.mark.family("flight_figure")
@pytest.mark.parametrize("name", DRAWN)
def test_a_slide_is_16_to_9_and_its_words_are_large_whole_and_apart(
    name: str, flights: Flights, tmp_path: Path, saved: list[Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    with themed(Theme.slides), Image.open(DRAWN[name](flights, tmp_path / "slide.png")) as picture:
        assert picture.size == (1920, 1080)
    figure = saved[-1]
    figure.set_dpi(200)
    found = words(figure, monkeypatch)
    assert len(found) > 5
    for text, box in found:
        assert float(text.get_fontsize()) * 200 / 72 >= LEAST, text
        assert -1.0 <= box.x0 < box.x1 <= 1921.0, text
        assert -1.0 <= box.y0 < box.y1 <= 1081.0, text
    for title in (figure.get_suptitle(), *(axes.get_title(loc) for axes in figure.axes for loc in ("left", "center"))):
        assert "\n" not in title
    level = [(text, box) for text, box in found if text.get_rotation() % 90.0 == 0.0]
    for (one, a), (other, b) in combinations(level, 2):
        over = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert min(over) < 4.0, f"{one} over {other}"


def test_coverage_shows_no_landmarks_without_a_camera_nor_an_imu_alone(tmp_path: Path, saved: list[Figure]) -> None:
    of_coverage(("uwb", "imu"))({}, tmp_path / "a.png")
    (figure,) = saved
    assert not any("landmark" in axes.get_title() for axes in figure.axes)
    named = [name for axes in figure.axes for name in axes.get_legend_handles_labels()[1]]
    assert named == ["all sensors", "without imu", "three sigma of the floor reach a wall", "worst stretch"]
    assert "three sigma of the floor reach a wall" in " ".join(figure.get_supxlabel().split())


def test_a_bar_of_anchors_in_sight_names_the_most_that_are_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At most 11 are in sight on the made-up floor."""
    made: list[Figure] = []
    monkeypatch.setattr(
        "ortilo_drake.studies.rooms.coverage_figure.save_picture", lambda figure, path: made.append(figure)
    )
    with themed(Theme.slides):
        of_coverage(("uwb", "imu"))({}, tmp_path / "a.png")
    (anchors,) = (axes.images[0] for axes in made[0].axes if "anchors" in axes.get_title())
    assert anchors.colorbar is not None
    assert max(anchors.colorbar.get_ticks()) == 11


def test_a_slide_of_a_recording_shows_the_filter_and_its_smoother_alone(
    tmp_path: Path, drawn_figures: list[Figure]
) -> None:
    of_motion({}, tmp_path / "page.png")
    with themed(Theme.slides):
        of_motion({}, tmp_path / "slide.png")
    page, slide = ([text.get_text() for text in figure.legends[0].get_texts()] for figure in drawn_figures)
    assert len(page) == 4
    assert slide == ["with IMU (90%)", "with IMU, smoothed (90%)"]
    assert [len(figure.axes) for figure in drawn_figures] == [7, 5]


def test_all_figures_that_are_written_are_looked_at() -> None:
    writing = set()
    for file in Path(ortilo_drake.__file__).parent.glob("**/*.py"):
        text = file.read_text()
        for node in ast.walk(ast.parse(text)) if re.search("save_picture|figure_to", text) else ():
            if isinstance(node, ast.FunctionDef):
                calls = (call.func for call in ast.walk(node) if isinstance(call, ast.Call))
                if any(isinstance(call, ast.Name) and call.id in ("save_picture", "figure_to") for call in calls):
                    writing.add(node.name)
    assert writing - {"figure_to"} == {name.partition(",")[0] for name in DRAWN if "plot_" not in name}


def drawn() -> Figure:
    figure = Figure(figsize=(4.0, 2.0), dpi=100, layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot([0.0, 1.0], [0.0, 1.0], "k", label="truth")
    left.fill_between([0.0, 1.0], 0.0, 1.0, color=SKY, alpha=0.3)
    left.set_xlabel("x [m]")
    left.legend()
    right.pcolormesh(np.eye(2))
    right.text(1.0, 1.0, "0.5", color="k")
    return figure


def luminance(color: object) -> float:
    """The relative luminance of WCAG 2."""
    parts = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(color)]  # type: ignore[arg-type]
    return float(np.dot([0.2126, 0.7152, 0.0722], parts))


@pytest.mark.parametrize("color", ["k", "0.3", "#333333", BLUE, ORANGE, GREEN, PURPLE, "#0B3C6F", "#882255"])
def test_each_colour_of_ours_stands_out_on_the_dark_ground(color: str) -> None:
    line, ground = luminance(dark(color)[:3]), luminance(dark("white")[:3])
    assert (line + 0.05) / (ground + 0.05) > 3.0  # WCAG's least of graphics


def test_a_dark_figure_is_dark_but_for_its_map(tmp_path: Path) -> None:
    figure = drawn()
    left, right = figure.axes
    with themed(Theme.dark):
        pixels = np.asarray(Image.open(save_picture(figure, tmp_path / "dark.png")).convert("L"))
    assert np.median(pixels[:, :200]) < 40 < 200 < pixels[:, :200].max()
    assert right.texts[0].get_color() == "k"
    assert left.xaxis.label.get_color()[:3] == dark("k")[:3]
    assert left.lines[0].get_color()[:3] == dark("k")[:3]
    light = np.asarray(Image.open(save_picture(drawn(), tmp_path / "light.png")).convert("L"))
    assert np.median(light[:, :200]) > 240


def test_slides_and_print_have_their_sizes(tmp_path: Path) -> None:
    for theme, width in ((Theme.light, 400), (Theme.dark, 400), (Theme.slides, 1920), (Theme.print, 1200)):
        with themed(theme), Image.open(save_picture(drawn(), tmp_path / f"{theme}.png")) as picture:
            assert picture.width == width, theme


def test_a_caption_fits_below_a_slide_in_lines_alike(tmp_path: Path) -> None:
    figure = Figure(figsize=(11.0, 3.0), dpi=100, layout="constrained")
    figure.subplots()
    with themed(Theme.slides):
        add_title(figure, "a title", "what the caption says of the figure " * 6 + "and no more.")
        save_picture(figure, tmp_path / "slide.png")
    figure.draw_without_rendering()
    (caption,) = (text for text in figure.texts if "caption" in text.get_text())
    box, lines = caption.get_window_extent(), caption.get_text().splitlines()
    assert figure.bbox.x0 < box.x0 < box.x1 < figure.bbox.x1
    assert box.y1 < figure.axes[0].bbox.y0
    assert len(lines) == 2
    assert len(lines[1]) > 0.8 * len(lines[0])


@pytest.mark.parametrize("title", ["Which loss? 30 % costs $5, $_", "a long title " * 30])
def test_a_title_of_ones_own_replaces_the_figures_and_fits_a_slide(title: str, tmp_path: Path) -> None:
    figure = drawn()
    add_title(figure, "the figure's own")
    with themed(Theme.slides, title):
        words = "".join(ElementTree.parse(save_picture(figure, tmp_path / "slide.svg")).getroot().itertext())
    assert " ".join(title.split()) in " ".join(words.split())
    assert "the figure's own" not in words
    top, axes = figure.texts[0].get_window_extent(), [axes.get_tightbbox() for axes in figure.axes]
    assert figure.bbox.x0 < top.x0 < top.x1 < figure.bbox.x1
    assert top.y1 < figure.bbox.y1
    assert all(box is not None and box.y1 <= top.y0 for box in axes)


def test_names_are_broken_after_underscores_and_texts_into_even_lines() -> None:
    assert broken_name("robust_imu_uwb_yolo", 13) == "robust_imu_\nuwb_yolo"
    assert broken_name("nominal_imu_uwb", 13) == "nominal_\nimu_uwb"
    assert broken_name("tight_imu_uwb", 13) == "tight_imu_uwb"
    assert broken_name("gust", 13) == "gust"
    assert balanced("one two three four five six seven", 30) == "one two three four\nfive six seven"


def test_no_label_is_longer_than_its_axis_on_a_slide(tmp_path: Path) -> None:
    figure = Figure(figsize=(10.0, 5.0), dpi=100, layout="constrained")
    for axes in figure.subplots(2, 2).flat:
        axes.set(
            xlabel="share of the messages that arrive, of all that were sent [-]", ylabel="error of the estimate [m]"
        )
    with themed(Theme.slides):
        save_picture(figure, tmp_path / "slide.png")
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.yaxis.label.get_window_extent().height < axes.bbox.height
        assert axes.xaxis.label.get_window_extent().width < axes.bbox.width
        assert " ".join(axes.get_ylabel().split()) == "error of the estimate [m]"


def test_svg_and_pdf_are_read_and_are_the_same_each_time(tmp_path: Path) -> None:
    svg, pdf = (save_picture(drawn(), tmp_path / name).read_bytes() for name in ("a.svg", "a.PDF"))
    assert ElementTree.fromstring(svg).tag == "{http://www.w3.org/2000/svg}svg"
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    said = [text.text for text in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]
    assert {"x [m]", "truth", "0.5"} <= set(said)  # text, no outlines
    assert b"/FontFile2" in pdf  # the whole TrueType font, not drawn glyphs
    assert b"/Type3" not in pdf
    assert svg == save_picture(drawn(), tmp_path / "b.svg").read_bytes()
    assert pdf == save_picture(drawn(), tmp_path / "b.pdf").read_bytes()


def test_a_command_writes_its_figures_in_the_format_asked_for(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep.yaml"
    sweep.write_text(
        "scenario: nominal_imu_uwb\nsettings: {planner: {kind: hover, duration: 1.0}}\n"
        "axes: {uwb.link.loss: [0.0, 0.5]}\nflights: 1\n"
    )
    for ending, start in (("svg", b"<?xml"), ("pdf", b"%PDF-"), ("png", b"\x89PNG")):
        assert run("--figures", ending, "map", str(sweep), "--workers", "1", "--out", str(tmp_path / ending)) == 0
        (figure,) = (tmp_path / ending).glob(f"map.{ending}")
        assert figure.read_bytes().startswith(start)


def test_no_command_names_the_format_of_a_figure_in_its_folder() -> None:
    """`--figures` holds for every command: each has the file's name from figure_file."""
    package = Path(ortilo_drake.__file__).parent
    for file in [*package.glob("commands/**/*.py"), *package.glob("studies/**/*.py")]:
        assert not re.search(r'/ f?"[^"]*\.(png|svg|pdf)"', file.read_text()), file


def test_an_unknown_ending_is_refused_before_anything_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"map\.frog: .*\.png, \.svg, \.pdf"):
        save_picture(drawn(), Path("map.frog"))
    for words in (
        ("fly", "--png"),
        ("hil", "check", "--png"),
        ("room", "show", "none.yaml", "--png"),
        ("diagram", "--svg"),
    ):
        assert run(*words, "map.frog") == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1, said
        assert "map.frog" in said
