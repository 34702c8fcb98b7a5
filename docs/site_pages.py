"""Pages that the program writes of itself: its settings, its commands, its notebooks, a tick."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
_SETTINGS: Final = """# Settings

Every setting of a scenario, made from the models that check it: {count} in all. A file sets them as YAML, the command
line as `--set uwb.link.loss=0.3`, Python as `uwb__link__loss=0.3`. `[]` stands for the entries of a list. What a group
offers depends on its `kind`, which then stands before the meaning. In the terminal: `ortilo scenario keys uwb.link`.
"""
# In a process of its own: the site is built without compiled functions.
_TICK: Final = """
import json
from ortilo_drake.flight.engine import Engine
from ortilo_drake.scenario import load_scenario
from ortilo_drake.views.wiring_text import wiring_of
from ortilo_drake.views.wiring_picture import wiring_picture
from ortilo_drake.views.wiring_text import wiring_text

scenario = load_scenario("paper_imu_uwb")
wiring = wiring_of(scenario)
print(json.dumps({"svg": wiring_picture(wiring, 1), "txt": wiring_text(wiring, 2), "py": Engine(scenario).text}))
"""


def write_pages(folder: Path) -> None:
    """Write the pages below a folder that are made at each build; what is unchanged is left alone, what is gone goes.

    Args:
        folder: the site's source.
    """
    _write(folder / "reference/settings.md", settings_page())
    _write(folder / "reference/commands.md", commands_page())
    write_tick(folder / "made")
    (folder / "notebooks").mkdir(exist_ok=True)
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        _write(folder / "notebooks" / notebook.name, with_outputs(notebook).read_text(encoding="utf-8"))
    for copy in (folder / "notebooks").glob("*.ipynb"):
        if not (ROOT / "notebooks" / copy.name).exists():
            copy.unlink()
    drop_gone(folder / "reference/modules", ROOT)


def drop_gone(pages: Path, root: Path) -> None:
    """Drop autosummary's pages of modules that are gone, and of their packages, whose pages name them."""
    for page in sorted(pages.glob("*.rst")):
        module = root.joinpath(*page.stem.split("."))
        if not (module.is_dir() or module.with_name(f"{module.name}.py").exists()):
            page.unlink(missing_ok=True)
            page.with_name(f"{page.stem.rpartition('.')[0]}.rst").unlink(missing_ok=True)


def write_tick(folder: Path) -> None:
    """Write what the page How a tick goes shows of paper_imu_uwb: block diagram, order of boxes, generated source."""
    compiled = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"}
    paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    words = [sys.executable, "-c", _TICK]
    done = subprocess.run(words, env=compiled | {"PYTHONPATH": paths}, check=True, stdout=subprocess.PIPE, text=True)
    folder.mkdir(exist_ok=True)
    for ending, text in json.loads(done.stdout).items():
        _write(folder / f"paper_imu_uwb.{ending}", text)


def show_code(app: Any, doctree: Any) -> None:
    """Let links to the package's files open their pages in the site, which else would download the files."""
    from docutils import nodes  # the tests read this module without Sphinx
    from sphinx.addnodes import download_reference

    for link in list(doctree.findall(download_reference)):
        page = Path(app.env.doc2path(link["refdoc"]))
        file = (page.parent / link["reftarget"]).resolve()
        if file.suffix == ".py" and file.is_relative_to(ROOT / "ortilo_drake"):
            code = "../" * link["refdoc"].count("/") + f"_modules/{file.relative_to(ROOT).with_suffix('.html')}"
            link.replace_self(nodes.reference("", link.astext(), internal=True, refuri=code))


def with_outputs(notebook: Path) -> Path:
    """Return the kept run of a notebook's very cells (scripts/run_notebooks.py), else the notebook itself."""
    sys.path.append(str(ROOT / "scripts"))
    try:
        from run_notebooks import kept_file
    except ModuleNotFoundError:  # nbclient is with what the tests need, and the site can be built without that
        return notebook
    finally:
        sys.path.remove(str(ROOT / "scripts"))
    kept = kept_file(notebook)
    return kept if kept.exists() else notebook


def settings_page() -> str:
    """Return every setting as tables in Markdown, one a group."""
    from ortilo_drake.scenario.schema import scenario_keys

    keys = scenario_keys()
    parts = [_SETTINGS.format(count=len(keys))]
    for group in sorted({_group(key.key) for key in keys}):
        rows = [key for key in keys if _group(key.key) == group]
        parts.append(f"\n## {f'`{group}`' if group else 'Of the whole scenario'}\n")
        parts.append("| setting | allowed | unit | default | what it decides |\n|---|---|---|---|---|")
        for key in rows:
            meaning = f"`{key.kind}`: {key.meaning}" if key.kind else key.meaning
            cells = (f"`{key.key}`", key.allowed, key.unit, f"`{key.default}`", meaning)
            parts.append("| " + " | ".join(_cell(cell) for cell in cells) + " |")
    return "\n".join(parts) + "\n"


def commands_page() -> str:
    """Return the help of every command in Markdown, as Typer writes it."""
    import typer
    from typer.cli import get_docs_for_click

    from ortilo_drake.commands.app import app

    command = typer.main.get_command(app)
    for group in (command, *command.commands.values()):
        for part in getattr(group, "commands", {}).values():
            part.short_help = (part.help or "").partition("\n\n")[0]  # else lists cut it at 45 letters
    text = get_docs_for_click(obj=command, ctx=command.context_class(command), name="ortilo")
    text = re.sub(r"^\* `--help`: .*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^\*\*(Usage|Arguments|Options|Commands)\*\*:", r"*\1*", text, flags=re.MULTILINE)
    text = re.sub(r"^\*Options\*\n\n(?!\*)", "", text, flags=re.MULTILINE)  # of a group, which had --help alone
    return re.sub("^# `ortilo`", "# Commands", text)


def _group(key: str) -> str:
    """Return the first name of a dotted key, '' where there is no other."""
    return key.partition(".")[0].removesuffix("[]") if "." in key else ""


def _cell(text: str) -> str:
    return text.replace("|", r"\|").replace("$", r"\$").replace("\n", " ")


def _write(file: Path, text: str) -> None:
    if not file.exists() or file.read_text(encoding="utf-8") != text:
        file.write_text(text, encoding="utf-8")
