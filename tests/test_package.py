"""What is shipped belongs together: files in the package, weights and calibration, links of README and docs."""

import fnmatch
import hashlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import ortilo_drake
from ortilo_drake.onboard.detector.detector_network import OWN_CFG, OWN_CLASSES, OWN_NETWORK, OWN_ONNX
from ortilo_drake.scenario.camera import MeasuredErrors
from ortilo_drake.world.sensors.camera_calibration import load_calibration

PACKAGE = Path(ortilo_drake.__file__).parent
ROOT = PACKAGE.parent
LEFT_OUT = {".py", ".pyc", ".nbi", ".nbc"}


def test_every_file_that_is_no_program_is_packed() -> None:
    packed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    globs = [str(PACKAGE / Path(*name.split(".")[1:]) / glob) for name, rows in packed.items() for glob in rows]
    files = [path for path in PACKAGE.rglob("*.*") if path.is_file() and path.suffix not in LEFT_OUT]
    assert len(files) > 50
    assert [path for path in files if not any(fnmatch.fnmatch(str(path), glob) for glob in globs)] == []


def test_every_package_is_packed() -> None:
    """Found is a folder with an __init__.py in a folder that is found, a link to one included."""
    find = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]["find"]
    assert find == {"include": [f"{PACKAGE.name}*"], "namespaces": False}
    programs = [*PACKAGE.rglob("*.py"), *(PACKAGE / "diagrams").rglob("*.py")]
    folders = {folder for path in programs if "__pycache__" not in path.parts for folder in path.parents}
    inside = [folder for folder in folders if folder.is_relative_to(PACKAGE)]
    assert len(inside) > 50
    assert [folder for folder in inside if not (folder / "__init__.py").exists()] == []


def test_the_calibration_is_of_the_detector_that_is_shipped() -> None:
    digest = hashlib.sha256(OWN_ONNX.read_bytes()).hexdigest()
    assert load_calibration(MeasuredErrors()).source.detector == f"sha256 {digest[:16]}"


def test_the_weights_are_at_most_four_megabytes_and_have_a_name_for_each_class() -> None:
    assert OWN_NETWORK.stat().st_size + OWN_ONNX.stat().st_size < 4e6
    assert f"classes={len(OWN_CLASSES)}\n" in OWN_CFG.read_text()


def test_readme_and_pages_are_filled_in_and_their_links_lead_somewhere() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs/how_to").glob("*.md"))]
    assert len(pages) >= 15
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert "@@" not in text
        links = [link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
        made = {"reference/settings.md", "reference/commands.md", "reference/modules.md"}  # with the site
        assert [link for link in links if link not in made and not (page.parent / link).exists()] == [], page


def test_no_extra_is_loaded_with_the_package() -> None:
    """Who has none of them can import it, and no command waits for what it does not use."""
    names = "ortilo_drake.api, ortilo_drake.flight.engine, ortilo_drake.diagrams.closed_loop"
    code = f"import sys, {names}; print(*sys.modules)"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    extras = {"torch", "cv2", "onnxruntime", "mcap", "rosbags", "dask", "gtsam", "av", "rerun"}  # pandas loads pyarrow
    assert "numba" in printed.split()
    assert not extras & set(printed.split())
