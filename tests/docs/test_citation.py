"""CITATION.cff and the README's BibTeX say the same, of this version."""

import re
from pathlib import Path

import yaml

import ortilo_drake as od

ROOT = Path(__file__).parents[2]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
README = (ROOT / "README.md").read_text(encoding="utf-8")


def entry(kind: str) -> dict[str, str]:
    """Return the fields of the README's BibTeX entry of a kind."""
    text = README[README.index(f"@{kind}{{") :].partition("\n}\n")[0]
    return {key: value.strip("{}") for key, value in re.findall(r"(\w+) += (.+?),?$", text, flags=re.MULTILINE)}


def test_the_software_is_this_version() -> None:
    found = entry("software")
    assert CITATION["version"] == od.__version__ == found["version"].removesuffix(", unreleased")
    assert found["title"] == CITATION["title"]
    assert found["author"] == CITATION["authors"][0]["name"]


def test_the_paper_has_its_authors() -> None:
    (paper,), found = CITATION["references"], entry("misc")
    assert found["title"] == paper["title"]
    names = [f"{one['family-names']}, {one['given-names']}" for one in paper["authors"]]
    assert found["author"].split(" and ") == names
    assert all(one["family-names"] in README.partition("## Two commands")[0] for one in paper["authors"])


def test_a_release_has_the_changelogs_date_and_what_is_not_released_has_none() -> None:
    newest = re.search(r"^## (\S+) - (\S+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert newest is not None
    version, released = newest.groups()
    assert version == CITATION["version"]
    assert str(CITATION.get("date-released", "unreleased")) == released
