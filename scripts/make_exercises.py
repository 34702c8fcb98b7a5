"""Copy the notebooks without the solutions of their exercises, for students: `make exercises`.

A solution is the folded text of an exercise and the hidden code cell that follows it.

    python scripts/make_exercises.py [FOLDER]       # out/exercises by default
"""

import re
import sys
from pathlib import Path

import nbformat

ROOT = Path(__file__).parents[1]
SOLUTION = re.compile(r"\s*<details><summary>Solution</summary>.*?</details>", re.DOTALL)


def without_solutions(notebook: nbformat.NotebookNode) -> nbformat.NotebookNode:
    """Replace in a notebook each solution's code by an empty cell, and remove its text; return the notebook."""
    solved = False
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source, count = SOLUTION.subn("", cell.source)
            solved = count > 0
        elif solved:
            cell.source, cell.metadata = "# your solution\n", nbformat.NotebookNode()
            solved = False
    return notebook


def main(folder: Path) -> None:
    """Write the copies into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        nbformat.write(without_solutions(nbformat.read(path, as_version=4)), folder / path.name)
    print(f"exercises: {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "out/exercises")
