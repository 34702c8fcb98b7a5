"""docs/how_to/own_room.md: its files are written, its commands run, and they print what stands there."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from command_line import run

DOCS = Path(__file__).parents[2] / "docs" / "how_to"
TEXT = (DOCS / "own_room.md").read_text()
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.]*yaml)")
BY_THE_CLOCK = "real-time factor"


@pytest.mark.long
def test_every_command_of_the_page_prints_what_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Word for word; numbers within 5 %, as another release of Drake may plan a slightly different path."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(DOCS.parent / "pictures" / "plan.png", tmp_path)
    for text, name in re.findall(r"```yaml\n(# (\w+\.yaml)\n.*?)```", TEXT, re.DOTALL):
        (tmp_path / name).write_text(text)
    blocks = re.findall(r"```console\n(.*?)```", TEXT, re.DOTALL)
    assert len(blocks) == TEXT.count("$ ortilo") >= 9
    for block in blocks:
        command, *expected = block.splitlines()
        capsys.readouterr()
        code = run(*shlex.split(command.removeprefix("$ ortilo ")))
        printed = capsys.readouterr()
        doubtful = 3 if "warning  " in block else 0
        assert code == (2 if "wrong.yaml" in command else doubtful), printed.err
        said = (printed.out + printed.err).rstrip("\n").splitlines()
        assert len(said) == len(expected), command
        for line, wanted in zip(said, expected, strict=True):
            if BY_THE_CLOCK in line:
                continue
            assert NUMBER.sub("#", line) == NUMBER.sub("#", wanted)
            found, numbers = ([float(number) for number in NUMBER.findall(words)] for words in (line, wanted))
            assert found == pytest.approx(numbers, rel=0.05, abs=1e-5), line


def test_its_links_lead_somewhere() -> None:
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXT) if "://" not in link]
    assert len(links) >= 4
    assert [link for link in links if not (DOCS / link).exists()] == []
