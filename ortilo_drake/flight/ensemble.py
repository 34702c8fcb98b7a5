"""Many flights on worker processes; an interrupted run can be resumed.

A study keeps only a few figures of each flight, in one file for each scenario. A whole flight would take megabytes, and
its whole summary, with the Cramer-Rao floor, takes 50 times as long as the figures that a study needs.
"""

import gc
import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from types import GenericAlias
from typing import Any, Final, TypeVar

import xarray as xr

from ortilo_drake.flight.files import remove_stale
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.players import choose, kept_player
from ortilo_drake.flight.processes.program import program_digest
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.flight.saved_flight import FLIGHT, load_flight, save_flight, summary_in
from ortilo_drake.flight.store import keep_json, kept, kept_json
from ortilo_drake.flight.summary import Summary, summary_text
from ortilo_drake.model.parts import plugin_files
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector_network import own_backend
from ortilo_drake.scenario import Detector, Scenario


def flight_folder(out: Path, scenario: Scenario) -> Path:
    """Return the folder of a scenario's flights. Its name has a digest of all that determines them but the seed.

    The digest covers the scenario, the room, the camera's files, the user's plugins and the program itself. So a
    resumed run never mixes flights of different programs or settings.
    """
    text = json.dumps(scenario.model_dump(mode="json", exclude={"seed"}), sort_keys=True)
    everything = "\n".join(
        (text, scenario.load_room().model_dump_json(), _camera(scenario), program_digest(), _plugins())
    )
    return out / f"{scenario.name}-{hashlib.sha256(everything.encode()).hexdigest()[:8]}"


def _plugins() -> str:
    """Return a digest of the user's files that registered parts."""
    digest = hashlib.sha256()
    for file in plugin_files():
        digest.update(Path(file).read_bytes())
    return digest.hexdigest()


def _camera(scenario: Scenario) -> str:
    """Return a digest of the user's detector and calibration files, and of the backend that computes our network."""
    chosen, errors = scenario.detector, scenario.camera.errors
    files, backend = {"errors": errors.file} if errors.kind == "measured" else {}, ""
    if isinstance(chosen, Detector):  # _plugins covers a detector that a plugin registered
        beside = {"names": str(Path(chosen.cfg).with_suffix(".names"))} if chosen.cfg else {}
        files, backend = beside | chosen.files | files, own_backend(chosen.backend)
    digest = hashlib.sha256(backend.encode() if scenario.is_rendered else b"")
    for file in files.values():
        if Path(file).is_file():
            digest.update(Path(file).read_bytes())
    return digest.hexdigest()


def flight_file(out: Path, scenario: Scenario, seed: int) -> Path:
    """Return the path of the file of the flight with a seed."""
    return flight_folder(out, scenario) / f"seed_{seed:06d}.nc"


def fly_and_save(scenario_json: str, seed: int, file: str, player: str = "fastest") -> Summary:
    """Fly one seed, save the flight and return its summary. A worker runs this, so the arguments are plain data."""
    flight = kept_player(scenario_json, Path(file).parent.name, player).fly(seed)
    found = summary(flight)
    flight.attrs["summary"] = summary_text(found)
    save_flight(flight, Path(file))
    return found


def _finished(out: Path, scenario: Scenario, seed: int) -> Summary | None:
    """Return the summary of a saved flight; None if there is none; None and a warning if it is damaged or another's."""

    def read(data: bytes) -> Summary:
        found = summary_in(data)
        if (found.scenario, found.seed) != (scenario.name, seed):
            raise ValueError(f"is of {found.scenario}, seed {found.seed}")
        return found

    return kept(flight_file(out, scenario, seed), FLIGHT, read)


def fly_many(
    scenario: Scenario,
    seeds: Iterable[int],
    out: Path,
    workers: int = 1,
    progress: Callable[[Summary], None] | None = None,
    player: str = "fastest",
) -> list[Summary]:
    """Fly a scenario once for each seed and return the summaries in the order of the seeds.

    Flights already in the folder are not flown again, so an interrupted run continues where it stopped. A damaged
    flight is flown again, with a warning. Each flight is written as it ends. A flight depends on its scenario and seed
    alone, not on the number of workers. A worker that dies is replaced and its flight flown again. InputError if the
    player cannot fly the scenario, or a flight cannot be flown or written.

    Args:
        scenario: the scenario; its own seed is not used.
        seeds: the seeds.
        out: folder for the flights.
        workers: worker processes; 1 flies in this process.
        progress: called with each summary as it comes in.
        player: see players.choose; flights already in the folder stay, whichever player flew them.
    """
    seeds, player = list(seeds), choose(scenario, player)
    summaries: dict[int, Summary] = {}

    def take(seed: int, result: Summary) -> None:
        summaries[seed] = result
        if progress:
            progress(result)

    remove_stale(flight_folder(out, scenario))
    for seed in seeds:
        done = _finished(out, scenario, seed)
        if done is not None:
            take(seed, done)
    missing = [seed for seed in seeds if seed not in summaries]
    text = scenario.model_dump_json()
    jobs = [(text, seed, str(flight_file(out, scenario, seed)), player) for seed in missing]
    try:
        run_all(fly_and_save, jobs, workers, lambda number, result: take(missing[number], result))
    finally:
        kept_player.cache_clear()  # the files that a scenario names may have changed by the next call
        if scenario.is_rendered:
            gc.collect()  # frees a renderer in the thread that drew with it; EGL complains in any other
    return [summaries[seed] for seed in seeds]


def flights_of(scenario: Scenario, seeds: Iterable[int], out: Path) -> list[xr.Dataset]:
    """Return the saved flights with the given seeds; InputError if one is missing or no seed is given."""
    flights = [load_flight(flight_file(out, scenario, seed)) for seed in seeds]
    if not flights:
        raise InputError("flights: none asked for")
    return flights


AT_ONCE: Final = 2  # flights in one job of a worker: few, so that no worker waits long for another's last job
T = TypeVar("T")


def kept_file(out: Path, scenario: Scenario) -> Path:
    """Return the path of the file that keeps the figures of a scenario's flights; it is named like flight_folder."""
    folder = flight_folder(out, scenario)
    return folder.with_name(f"{folder.name}.kept")


def fly_kept(
    kind: type[T],
    fly: Callable[[str, list[int], str, str], list[T]],
    wanted: Sequence[tuple[Scenario, Iterable[int]]],
    out: Path,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
    at_once: int = AT_ONCE,
    player: str = "fastest",
) -> list[list[T]]:
    """Fly each scenario once for each of its seeds, and return the figures of each scenario in the order of its seeds.

    All flights go to the workers together. Flights whose figures are already kept are not flown again, so an
    interrupted run continues where it stopped. `kind` is the dataclass of a flight's figures, with the fields `seed`
    and `player`, which is set here. `fly`, an importable function, takes a scenario's JSON, seeds, the kept file's name
    and the player, and returns the figures of these flights. `wanted` pairs each scenario, whose own seed is not used,
    with its seeds. With 1 worker this process flies. `progress` is called with the number of flights that came in. A
    worker's job has `at_once` flights where the engine flies all scenarios, else AT_ONCE. `player` is as in fly_many.
    InputError if the player cannot fly a scenario, or a flight cannot be flown or its figures cannot be written.
    """
    players = [choose(scenario, player) for scenario, _ in wanted]
    at_once = at_once if set(players) <= {"engine"} else AT_ONCE
    asked = [(scenario, list(seeds), kept_file(out, scenario)) for scenario, seeds in wanted]
    rows = GenericAlias(list, (kind,))
    found = {file: {its.seed: its for its in kept_json(file, rows, file.name) or ()} for _, _, file in asked}
    jobs: list[tuple[str, list[int], str, str]] = []
    files: list[Path] = []  # of each job
    for (scenario, seeds, file), its_player in zip(asked, players, strict=True):
        missing = [seed for seed in seeds if seed not in found[file]]
        if progress and len(missing) < len(seeds):
            progress(len(seeds) - len(missing))
        text = scenario.model_dump_json()
        jobs += [(text, missing[k : k + at_once], file.name, its_player) for k in range(0, len(missing), at_once)]
        files += [file] * (len(jobs) - len(files))

    def take(number: int, flown: list[Any]) -> None:
        file = files[number]
        known = found[file]
        known.update({its.seed: replace(its, player=jobs[number][-1]) for its in flown})
        keep_json(file, [known[seed] for seed in sorted(known)], file.name)
        if progress:
            progress(len(flown))

    run_all(fly, jobs, workers, take)
    return [[found[file][seed] for seed in seeds] for _, seeds, file in asked]
