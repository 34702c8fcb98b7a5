"""Examples in docstrings run and give what they say; what `help` shows as code is an example, so it is run too."""

import ast
import doctest
import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = [file for folder in ("ortilo_drake", "diagrams") for file in sorted((ROOT / folder).rglob("*.py"))]
OUR_CALL = re.compile(r"\bod\.\w+\(")


def docstrings(file: Path) -> list[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return [text for node in ast.walk(tree) if isinstance(node, kinds) and (text := ast.get_docstring(node))]


def module_of(file: Path) -> str:
    parts = file.relative_to(ROOT).with_suffix("").parts
    parts = parts if parts[0] == "ortilo_drake" else ("ortilo_drake", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def has_examples(file: Path) -> bool:
    """Say whether one of its docstrings has; a file without the sign anywhere is not parsed."""
    return ">>>" in file.read_text(encoding="utf-8") and any(">>>" in text for text in docstrings(file))


WITH_EXAMPLES = [file for file in FILES if has_examples(file)]


@pytest.mark.family("ortilo_drake.scenario.load")  # the others fly or linearise
@pytest.mark.parametrize("module", sorted({module_of(file) for file in WITH_EXAMPLES}))
def test_examples_give_what_they_say(module: str) -> None:
    results = doctest.testmod(import_module(module))
    assert results.attempted > 0
    assert results.failed == 0


@pytest.mark.long
def test_a_docstring_that_shows_a_call_shows_it_as_an_example() -> None:
    """Code without >>> would be run by nobody: one of these called fly with a setting that there is not."""
    for file in FILES:
        for text in docstrings(file):
            for line in re.sub(r"`[^`]*`", "", text).splitlines():
                if OUR_CALL.search(line):
                    assert line.lstrip().startswith((">>> ", "... ")), f"{file}: {line}"
