"""What several tests of whole commands share."""

from pathlib import Path
from typing import Any

import pytest
from command_line import run


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Any:
    """Return a function that runs `ortilo`, holds it to the rules for bad input and returns its one line."""

    def refuse(*words: str) -> str:
        monkeypatch.chdir(tmp_path)
        before = sorted(tmp_path.rglob("*"))
        assert run(*words) == 2
        printed = capsys.readouterr()
        assert printed.out == ""
        lines = printed.err.splitlines()
        assert len(lines) == 1, printed.err
        assert lines[0].startswith("ortilo: ")
        assert len(lines[0]) < 500
        assert sorted(tmp_path.rglob("*")) == before
        return lines[0]

    return refuse
