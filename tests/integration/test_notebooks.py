"""The notebooks: one course, stored without outputs, each runs from top to bottom."""

import re
from pathlib import Path
from types import ModuleType

import nbformat
import pytest
from module_of import module_of

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
each_notebook = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def runner() -> ModuleType:
    return script("run_notebooks")


def script(name: str) -> ModuleType:
    return module_of(ROOT / f"scripts/{name}.py")


def code_cells(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_there_are_notebooks():
    assert FOLDER / "01_fly_the_paper.ipynb" in NOTEBOOKS


@each_notebook
def test_is_valid_and_stored_without_outputs(path: Path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    with_results = [cell.id for cell in code_cells(notebook) if cell.outputs or cell.execution_count is not None]
    assert with_results == []


@each_notebook
def test_is_a_part_of_the_course(path: Path):
    """It has a question, an answer, its place, what was learnt, and two exercises with folded solutions that run."""
    notebook = nbformat.read(path, as_version=4)
    number = NOTEBOOKS.index(path)
    title = notebook.cells[0].source
    assert f"*Part {number + 1} of {len(NOTEBOOKS)}. " in title
    beside = [NOTEBOOKS[i].name for i in (number - 1, number + 1) if 0 <= i < len(NOTEBOOKS)]
    assert re.findall(r"\]\((\w+\.ipynb)\)", title) == beside
    assert title.index("Needed:") < title.index("**Question.**") < title.index("**Answer.**")
    assert sum(cell.source.startswith("## What was learnt") for cell in notebook.cells) == 1
    ids = [cell.id for cell in notebook.cells]
    assert ids.index("learnt") < ids.index("exercise-1")
    for k in (1, 2):
        exercise, solution = ids.index(f"exercise-{k}"), ids.index(f"solution-{k}")
        assert solution == exercise + 1
        assert f"**{k}.** " in notebook.cells[exercise].source
        assert "<details><summary>Solution</summary>" in notebook.cells[exercise].source
        assert notebook.cells[solution].cell_type == "code"
        assert notebook.cells[solution].metadata["tags"] == ["hide-input"]


@each_notebook
def test_has_the_colours_of_the_palette_alone(path: Path):
    code = "\n".join(cell.source for cell in code_cells(nbformat.read(path, as_version=4)))
    assert re.findall(r"#[0-9A-Fa-f]{6}\b|tab:\w+", code) == []
    assert "from ortilo_drake.views.palette import" in code


@pytest.mark.notebook
@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=pytest.mark.egl if path.stem.startswith("02") else ()) for path in NOTEBOOKS],
    ids=lambda path: path.stem,
)
def test_runs_from_top_to_bottom(path: Path):
    """It keeps what it writes in a folder of its own, and removes it; what it shows is kept for the site."""
    notebooks = runner()
    notebook = notebooks.run(path)  # raises at the first cell that fails, and of files that are left
    assert all(cell.execution_count for cell in code_cells(notebook))
    warned = [output.text for cell in code_cells(notebook) for output in cell.outputs if output.get("name") == "stderr"]
    assert warned == []
    notebooks.keep(path, notebook)


def small_notebook(source: str) -> nbformat.NotebookNode:
    cell = nbformat.v4.new_code_cell(source, id="only")
    return nbformat.v4.new_notebook(cells=[cell])


def test_a_kept_run_is_of_its_cells_alone_and_has_no_widgets(tmp_path: Path):
    notebooks = runner()
    path, kept = tmp_path / "a.ipynb", tmp_path / "kept"
    notebook = small_notebook("1 + 1")
    nbformat.write(notebook, path)
    ran = nbformat.from_dict(notebook)
    view = {"application/vnd.jupyter.widget-view+json": {}, "text/plain": "interactive(...)"}
    ran.cells[0].outputs = [
        nbformat.v4.new_output("execute_result", {"text/plain": "2"}, execution_count=1),
        nbformat.v4.new_output("display_data", view),
    ]
    ran.metadata["widgets"] = {}
    file = notebooks.keep(path, ran, kept)
    assert file == notebooks.kept_file(path, kept)
    found = nbformat.read(file, as_version=4)
    assert [output.data["text/plain"] for output in found.cells[0].outputs] == ["2"]
    assert "widgets" not in found.metadata

    nbformat.write(small_notebook("1 + 2"), path)  # other cells: that run is not theirs, and goes with the next
    assert not notebooks.kept_file(path, kept).exists()
    notebooks.keep(path, small_notebook("1 + 2"), kept)
    assert list(kept.iterdir()) == [notebooks.kept_file(path, kept)]


@each_notebook
def test_the_copy_for_students_has_the_exercises_and_no_solution(path: Path) -> None:
    whole = nbformat.read(path, as_version=4)
    copy = script("make_exercises").without_solutions(nbformat.read(path, as_version=4))
    nbformat.validate(copy)
    changed = [(old, new) for old, new in zip(whole.cells, copy.cells, strict=True) if old.source != new.source]
    assert [old.cell_type for old, _ in changed] == ["markdown", "code"] * 2
    assert not any("Solution" in cell.source for cell in copy.cells)
    assert [new.source for _, new in changed][1::2] == ["# your solution\n"] * 2
