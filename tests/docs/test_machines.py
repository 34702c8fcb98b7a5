"""What is typed on other machines: Docker, a dev container, WSL2's shell."""

import json
import re
import shlex
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/how_to/machines.md"


@pytest.mark.parametrize("file", [PAGE, ROOT / "Dockerfile"])
def test_out_is_made_before_docker_makes_it_as_root(file: Path) -> None:
    before, run, _ = file.read_text(encoding="utf-8").partition("docker run ")
    assert run
    assert "mkdir -p out" in before


def test_a_dev_container_runs_the_checkout_and_not_the_images_copy() -> None:
    container = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text(encoding="utf-8"))
    first, _, others = container["remoteEnv"]["PATH"].partition(":")
    assert (first, others) == ("${containerWorkspaceFolder}/.venv/bin", "${containerEnv:PATH}")


def test_the_shell_of_wsl_hands_a_page_on_by_its_name() -> None:
    commands = re.findall(r"`(explorer\.exe [^`]+)`", PAGE.read_text(encoding="utf-8"))
    assert commands
    for command in commands:
        assert shlex.split(command)[1:] == ["$(wslpath -w out/flight.html)"]


def test_nothing_on_the_page_is_typed_as_root() -> None:
    """As it says: nothing needs root but missing system libraries."""
    assert "sudo" not in PAGE.read_text(encoding="utf-8")
