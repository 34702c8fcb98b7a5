"""Mutation testing: is there a test that fails when one operator, number or decision of the code is changed?

Cosmic Ray makes the mutants, in copies of the working tree. The modules, the tests that a module's mutants are tried
with, and the mutants that are not worth a try stand in mutants.toml. A mutant is tried in a fork of a process that has
the libraries loaded, with numba's compiler off for the module and for all that imports it; what the module itself
imports is no mutant's and stays compiled, in a cache of the copy's own.

A run draws places in the code with a seed and one mutant at each of them, and keeps what it finds in
out/mutants/session.sqlite, a session of Cosmic Ray: an interrupted run goes on where it was, and a repeated one tries
again what survived and what stands in a module that has changed. Usage: make mutants, or

    python scripts/mutants.py [--count 400] [--seed 12] [--workers 2] [--only 'ortilo_drake/onboard/estimator/*.py']
"""

import argparse
import difflib
import hashlib
import importlib
import multiprocessing
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import hypothesis
import numba
import pytest
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import use_mutation
from cosmic_ray.plugins import get_operator, operator_names
from cosmic_ray.work_db import use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkItem, WorkResult

ROOT = Path(__file__).resolve().parents[1]
PLAN = tomllib.loads((ROOT / "scripts/mutants.toml").read_text())
OUT = ROOT / "out/mutants"
FORK = multiprocessing.get_context("fork")


def modules(only: str) -> list[Path]:
    """Return the modules of the plan, relative to the root."""
    found = {path.relative_to(ROOT) for pattern in PLAN["modules"] for path in ROOT.glob(pattern)}
    return sorted(path for path in found if path.match(only) and path.name != "__init__.py")


def draw(paths: list[Path], count: int, seed: int) -> list[WorkItem]:
    """Return one mutant at each of so many places."""
    refused = re.compile("core/(" + "|".join(PLAN["skip-operators"]) + ")")
    names = [name for name in operator_names() if not refused.fullmatch(name)]
    operators = {name: get_operator(name)() for name in names if not get_operator(name).arguments()}
    places: dict[tuple[Path, tuple[int, int]], list[MutationSpec]] = {}
    for path in paths:
        nodes, lines = list(ast_nodes(get_ast_from_path(path))), path.read_text().splitlines()
        for name, operator in operators.items():
            positions = (position for node in nodes for position in operator.mutation_positions(node))
            for occurrence, (start, end) in enumerate(positions):
                if not lines[start[0] - 1].strip().startswith(tuple(PLAN["skip-lines"])):
                    places.setdefault((path, start), []).append(MutationSpec(path, name, occurrence, start, end))
    drawn = sorted(places, key=lambda place: digest(seed, *place))[:count]
    chosen = [min(places[place], key=lambda m: digest(seed, m.operator_name, m.occurrence)) for place in sorted(drawn)]
    return [
        WorkItem.single(digest(m.module_path, m.module_path.read_text(), m.operator_name, m.occurrence), m)
        for m in chosen
    ]


def digest(*of: object) -> str:
    """Return what stands for some values: as good as drawn at random, and the same whatever else is drawn."""
    return hashlib.sha256(repr(of).encode()).hexdigest()


def enter_a_copy(folder: str) -> None:
    """Copy the working tree into a folder and work there; load what the tests load of libraries."""
    copy = Path(tempfile.mkdtemp(dir=folder))
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], capture_output=True, text=True, check=True
    )
    for name in filter(os.path.lexists, listed.stdout.splitlines()):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(name, copy / name, follow_symlinks=False)
    os.chdir(copy)
    os.environ["PYTHONPATH"] = sys.path[0] = str(copy)
    sys.dont_write_bytecode = True  # Python does not notice two changes of a file within a second
    numba.config.CACHE_DIR = str(copy / ".numba")
    for name in PLAN["libraries"]:
        importlib.import_module(name)
    # One example that fails is enough: none is made smaller.
    examples = {"max_examples": 40, "phases": [hypothesis.Phase.explicit, hypothesis.Phase.generate]}
    hypothesis.settings.register_profile("mutants", deadline=None, derandomize=True, **examples)


def plain_njit(*signature: Any, **options: Any) -> Callable:
    """Stand in for numba.njit: compile what is not ours, which numba calls itself, and leave ours as it is."""
    if signature and callable(signature[0]):
        return plain_njit()(signature[0])
    compiled = numba.core.decorators.njit(*signature, **options)
    return lambda function: function if function.__module__.startswith("ortilo_drake") else compiled(function)


def run_tests(module: Path, log: Path, seconds: int) -> None:
    """Try a module's tests, in a process of their own, which ends with pytest's exit status or when its time is up."""
    os.setsid()  # with what the tests start
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    with log.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    name = module.relative_to("ortilo_drake").as_posix()
    tests = PLAN["tests"].get(name) or [f"tests/{module.parts[1]}/test_{module.stem}.py"]
    plain = ["-x", "-q", "-o", "addopts=", "-p", "no:cacheprovider", "-p", "xdist.plugin", "-p", "pytest_timeout"]
    examples = ["-p", "_hypothesis_pytestplugin", "--hypothesis-profile=mutants"]
    # Compiled code does not warn, and what is loaded cannot be rewritten.
    quiet = ["-W", "ignore::RuntimeWarning", "-W", "ignore::pytest.PytestAssertRewriteWarning"]
    try:
        status = int(pytest.main([*plain, *examples, *quiet, *tests]))
    except BaseException as error:  # also what pytest lets through
        print(error)
        status = 1
    os._exit(status)


def outcome(module: Path, seconds: int) -> tuple[str, str]:
    """Return "survived", "killed" or "timeout" (of processor time, not the clock's), and what the tests said."""
    log = Path("tests.log").absolute()
    process = FORK.Process(target=run_tests, args=(module, log, seconds))
    process.start()
    process.join(60.0 * seconds)  # who waits for ever spends none
    if process.exitcode is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
    timeout = process.exitcode in (-signal.SIGKILL, -signal.SIGXCPU)
    return "timeout" if timeout else "killed" if process.exitcode else "survived", log.read_text()


def try_mutants(module: Path, items: list[WorkItem], session: str) -> None:
    """Try the mutants of one module, after its tests without any, and put what comes of them into the session."""
    worker = os.getppid()
    for name in [*PLAN["compiled"], *re.findall(r"^from (ortilo_drake\S*) import", module.read_text(), re.MULTILINE)]:
        importlib.import_module(name)
    numba.njit = plain_njit
    found, said = outcome(module, 600)
    if found != "survived":
        sys.exit(f"{module}: its tests do not pass without a mutant ({found}):\n{said[-3000:]}")
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    print(f"{module}: {len(items)} mutants, {seconds:.0f} s without one", file=sys.stderr)
    for (mutation,), item in ((item.mutations, item) for item in items):
        operator = get_operator(mutation.operator_name)(**mutation.operator_args)
        with use_mutation(module, operator, mutation.occurrence) as (before, after):
            found, said = outcome(module, int(2.0 * seconds) + 20)
        diff = difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=0)
        test = TestOutcome.SURVIVED if found == "survived" else TestOutcome.KILLED
        result = WorkResult(WorkerOutcome.NORMAL, f"{found}\n{said[-2000:]}", test, "\n".join(list(diff)[3:]))
        with use_db(session) as database:
            database.set_result(item.job_id, result)
        if os.getppid() != worker:
            sys.exit("the run was ended")


def try_module(items: list[WorkItem], session: str, starter: int) -> None:
    """Try a module's mutants in a process that has loaded what this module imports.

    Raises:
        RuntimeError: if that process fails.
    """
    module = items[0].mutations[0].module_path
    process = FORK.Process(target=try_mutants, args=(module, items, session))
    process.start()
    while process.exitcode is None:
        process.join(5.0)
        if os.getppid() != starter:  # killed: so end as well, and the next fork will see it
            os._exit(1)
    if process.exitcode != 0:
        raise RuntimeError(f"{module}: not tried to the end")


def report(done: list[tuple[WorkItem, WorkResult]]) -> str:
    """Return the score by module and the survivors, as Markdown."""
    scores: dict[str, Counter[str]] = {}
    survivors = []
    for item, result in sorted(
        done, key=lambda pair: (pair[0].mutations[0].module_path, pair[0].mutations[0].start_pos)
    ):
        (mutation,) = item.mutations
        found = result.output.split("\n")[0]
        scores.setdefault(str(mutation.module_path), Counter())[found] += 1
        if found == "survived":
            survivors.append(f"{mutation.module_path}:{mutation.start_pos[0]}\n\n```diff\n{result.diff}\n```\n")
    scores["all"] = sum(scores.values(), Counter())
    rows = ["| module | mutants | killed | by time | survived | score |", "|---|---|---|---|---|---|"]
    for name, score in scores.items():
        n, lived = score.total(), score["survived"]
        rows.append(f"| {name} | {n} | {n - lived} | {score['timeout']} | {lived} | {(n - lived) / max(n, 1):.1%} |")
    return "\n".join([*rows, "", *survivors])


def main() -> None:
    """Draw the mutants, or go on with a session; report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=12)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="*", help="modules, as a pattern")
    chosen = parser.parse_args()
    os.chdir(ROOT)
    os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    items = draw(modules(chosen.only), chosen.count, chosen.seed)
    OUT.mkdir(parents=True, exist_ok=True)
    with use_db(str(OUT / "session.sqlite")) as database:
        known = {item.job_id for item in database.work_items}
        database.add_work_items(item for item in items if item.job_id not in known)
        killed = {name for name, result in database.results if result.test_outcome == TestOutcome.KILLED}
    pending: dict[Path, list[WorkItem]] = {}
    for item in items:
        if item.job_id not in killed:
            pending.setdefault(item.mutations[0].module_path, []).append(item)
    left = sum(map(len, pending.values()))
    print(f"{len(items)} mutants, {len(items) - left} killed before", file=sys.stderr)
    spawn = multiprocessing.get_context("spawn")
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(chosen.workers, spawn, enter_a_copy, (folder,)) as workers,
    ):
        modules_left = sorted(pending.values(), key=len, reverse=True)
        jobs = [workers.submit(try_module, at, str(OUT / "session.sqlite"), os.getpid()) for at in modules_left]
    failed = [str(job.exception()) for job in jobs if job.exception()]
    drawn = {item.job_id for item in items}
    with use_db(str(OUT / "session.sqlite")) as database:
        done = [(item, result) for item, result in database.completed_work_items if item.job_id in drawn]
    (OUT / "report.md").write_text(report(done))
    print((OUT / "report.md").read_text())
    sys.exit("\n".join(failed) or None)


if __name__ == "__main__":
    main()
