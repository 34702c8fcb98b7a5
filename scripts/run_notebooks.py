"""Run the notebooks and keep them with their outputs, for the site: `make docs NOTEBOOKS=1`.

The name of a kept run holds a digest of the cells that were run. What is there already is not run again,
so what was ended is continued. A notebook in the repository has no outputs.

    python scripts/run_notebooks.py [NOTEBOOK ...]
"""

import hashlib
import sys
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
NOTEBOOKS = ROOT / "notebooks"
KEPT = ROOT / "out/notebooks"
_WIDGET = "application/vnd.jupyter.widget-view+json"  # needs a running kernel, and scripts from elsewhere on a page


def kept_file(path: Path, folder: Path = KEPT) -> Path:
    """Return where a run of the notebook as it is now is kept."""
    cells = nbformat.read(path, as_version=4).cells
    text = "\0".join(f"{cell.cell_type} {cell.id} {cell.metadata.get('tags')}\n{cell.source}" for cell in cells)
    return folder / f"{path.stem}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.ipynb"


def run(path: Path) -> nbformat.NotebookNode:
    """Run a notebook in an empty folder and return it with its outputs.

    Raises:
        CellExecutionError: at the first cell that fails.
        ValueError: if it leaves files.
    """
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
        if left := sorted(file.name for file in Path(folder).iterdir()):
            raise ValueError(f"{path.name}: leaves {', '.join(left)}")
    return notebook


def keep(path: Path, notebook: nbformat.NotebookNode, folder: Path = KEPT) -> Path:
    """Keep a run of a notebook, without widgets, in place of those of older cells; return its file."""
    notebook = nbformat.from_dict(notebook)
    notebook.metadata.pop("widgets", None)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.metadata.pop("execution", None)
            cell.outputs = [output for output in cell.outputs if _WIDGET not in output.get("data", {})]
    file = kept_file(path, folder)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob(f"{path.stem}-*.ipynb"):
        if old != file:
            old.unlink(missing_ok=True)
    part = file.with_suffix(".part")
    nbformat.write(notebook, part)
    part.replace(file)  # whole or not at all
    return file


def main(paths: list[Path]) -> None:
    """Run each notebook that has no run of its present cells."""
    for number, path in enumerate(paths, start=1):
        if kept_file(path).exists():
            print(f"{path.name}: there already")
            continue
        print(f"{path.name}: running, {number} of {len(paths)}", flush=True)
        started = time.perf_counter()
        keep(path, run(path))
        print(f"{path.name}: {time.perf_counter() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]] or sorted(NOTEBOOKS.glob("*.ipynb")))
