"""Looks and endings of the files of figures; the contrast is WCAG's, the files are read by others' readers."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from command_line import run
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import ortilo_drake
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.views.palette import BLUE, GREEN, ORANGE, PURPLE, SKY
from ortilo_drake.views.pictures import save_picture
from ortilo_drake.views.themes import Theme, add_title, balanced, broken_name, dark, themed


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
