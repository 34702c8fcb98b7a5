"""A map's text with other numbers of its filter: the YAML read back has them, and the other lines stay."""

import difflib

import pytest
import yaml

from ortilo_drake.interop.recorded.map_edit import tuned_map_text, with_filter
from ortilo_drake.interop.recorded.map_file import load_map

HEAD = """\
# surveyed in May
ranges: {file: a.csv, time: t, values: [a, b, c]}
anchors: [[0, 0, 0], [1, 0, 0], [0, 1, 0]]  # by tape
"""
NEW = {"range_white": 0.0123, "acceleration": 1e-5}


@pytest.mark.parametrize(
    ("filter_text", "changed"),
    [
        ("filter: {range_white: 0.1, gate: 4.0}  # mine\nplanar: true\n", 1),
        ("filter:\n  gate: 4.0 # first\n  range_white: 0.1 # of the sheet\nplanar: true\n", 1),
        ("filter:\n  acceleration: 0.1\n  range_white: 0.1\n\n# end\nplanar: true\n", 2),
        ("filter: {}\n", 1),
        ("filter:\n    range_white: 0.1", 1),
        ("filter: {\n  range_white: 0.1,\n}\n", 2),
        ("planar: true\n", 0),
        ("planar: true\nimposed:\n  lost: 0.5\n# end\n", 0),
        ("", 0),
    ],
)
def test_only_the_numbers_change(filter_text, changed) -> None:
    text = HEAD + filter_text
    found = with_filter(text, NEW)
    expected = yaml.safe_load(text)
    expected["filter"] = expected.get("filter", {}) | NEW
    assert yaml.safe_load(found) == expected
    gone = [line for line in difflib.ndiff(text.splitlines(), found.splitlines()) if line.startswith("- ")]
    assert len(gone) <= changed
    assert [part for part in text.split() if part.startswith("#")] == [
        part for part in found.split() if part.startswith("#")
    ]


def test_a_map_in_json_stays_json() -> None:
    found = with_filter('{"planar": true, "filter": {"range_white": 0.1}}', NEW)
    assert yaml.safe_load(found) == {"planar": True, "filter": NEW}


def test_a_map_with_a_file_beside_it_still_finds_it_from_elsewhere(tmp_path) -> None:
    text = HEAD.replace("[[0, 0, 0], [1, 0, 0], [0, 1, 0]]", "tape.csv")
    (tmp_path / "tape.csv").write_text("id,x,y,z\na,0,0,0\nb,1,0,0\nc,0,1,0\n")
    (tmp_path / "MAP.yaml").write_text(text)
    (tmp_path / "out").mkdir()
    map_ = load_map(tmp_path / "MAP.yaml")
    for out in (tmp_path / "beside.yaml", tmp_path / "out" / "elsewhere.yaml"):
        out.write_text(tuned_map_text(tmp_path / "MAP.yaml", map_, NEW, out))
        assert load_map(out) == map_.model_copy(update={"filter": map_.filter.model_copy(update=NEW)})
    assert "# by tape" in (tmp_path / "beside.yaml").read_text()
