"""`ortilo report` of hostile files: their names and texts are text on the page, and nothing outside is on it."""

import html
import json
import os
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ortilo_drake.commands.report import report
from ortilo_drake.model.input_error import InputError
from ortilo_drake.views.page.report_page import markdown_html, report_page
from ortilo_drake.views.page.written_kinds import KINDS, Kind


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
