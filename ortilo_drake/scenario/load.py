"""Scenarios by name or from files, with settings laid over them."""

from __future__ import annotations  # help() shows types by their names

import os
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ortilo_drake.model.input_files import exists, read_text
from ortilo_drake.model.inputs.calibration_file import read_calibration
from ortilo_drake.model.inputs.problems import shown
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import DEEPEST, InputError, nearest, parse_yaml, validate
from ortilo_drake.model.vehicle import Vehicle, load_vehicle
from ortilo_drake.scenario.noise_file import load_noise
from ortilo_drake.scenario.onboard import Detector
from ortilo_drake.scenario.plain import plain_value
from ortilo_drake.scenario.planner import GcsPlanner, WaypointPlanner, read_waypoints
from ortilo_drake.scenario.scenario import Scenario

SCENARIO_FOLDER = Path(__file__).parents[1] / "diagrams" / "scenarios"
Setting = str | tuple[str, Any]  # 'key.key=value' with the value in YAML, or 'key.key' and the value as plain data
PROJECTED: Setting = ("camera.kind", "projected")  # boxes are computed, no pictures are drawn
Settings = str | Mapping[str, Any] | Iterable[Setting]


def scenario_names() -> list[str]:
    """Return the names of the ready-made scenarios."""
    return sorted(path.stem for path in SCENARIO_FOLDER.glob("*.yaml"))


def resolve(name_or_file: str | Path, field: str) -> Path:
    """Return the file of a scenario; InputError, beginning with `field`, if no scenario has this name."""
    if not isinstance(name_or_file, str | Path):
        raise InputError(f"{field}: {shown(name_or_file)}: must be a ready-made one's name or a .yaml file")
    path = Path(name_or_file)
    if path.suffix in (".yaml", ".yml"):
        return path
    if str(name_or_file) in scenario_names():
        return SCENARIO_FOLDER / f"{name_or_file}.yaml"
    name, known = str(name_or_file), scenario_names()
    given = repr(name) if len(name) <= 100 else f"{name[:100]!r}..."
    alike = ", ".join(get_close_matches(name[:100], known, n=4, cutoff=0.0))
    raise InputError(
        f"{field}: {given} is unknown{nearest(name[:100], known)}: give a .yaml file or a ready-made one, "
        f"such as {alike}; `ortilo scenario list` prints all {len(known)}"
    )


def parsed(setting: Setting) -> tuple[str, Any, str]:
    """Return the key of a setting, its value, and the setting's name in error messages."""
    if not isinstance(setting, str):
        return *setting, setting[0]
    key, equals, text = setting.partition("=")
    shown = "--set " + (repr(setting) if len(setting) <= 100 else f"{setting[:100]!r}...")
    if not equals:
        raise InputError(f"{shown}: must read key.key=value")
    return key, parse_yaml(text, shown), shown


def _set_field(data: dict[str, Any], setting: Setting) -> None:
    key, value, shown = parsed(setting)
    if not all(key.split(".")) or key.count(".") > DEEPEST:
        raise InputError(f"{shown}: must read key.key=value")
    *parents, last = key.split(".")
    for parent in parents:
        child = data.get(parent)
        if child is None:
            child = data[parent] = {}
        if not isinstance(child, dict):
            raise InputError(f"{shown}: '{parent}' is not a group of settings")
        data = child
    if last == "kind" and data.get("kind") != value and parents not in _ONE_MODEL:
        data.clear()  # the new kind has other settings
    data[last] = value


_MOST_BASES = 32  # longest chain of files, each the base of the one before
_ONE_MODEL = (["camera"], ["uwb"])  # groups with the same settings in both kinds: a new kind keeps them

# Settings that name files, and their values without a file.
_FILES = {
    ("room",): "ortilo",
    ("planner", "file"): None,
    ("detector", "cfg"): None,
    ("detector", "weights"): None,
    ("detector", "onnx"): None,
    ("detector", "names"): None,
    ("camera", "errors", "file"): "rendered",
}


def _with_read_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the settings with the contents of vehicle, calibration and range-error files in place of their names."""
    name, camera, uwb = data.get("vehicle"), data.get("camera"), data.get("uwb")
    if isinstance(name, str):
        data = data | {"vehicle": load_vehicle(folder / name).model_dump(mode="json")}
    if isinstance(camera, dict) and isinstance(file := camera.get("calibration"), str):
        data = data | {"camera": camera | {"calibration": read_calibration(folder / file)}}
    if isinstance(uwb, dict) and isinstance(file := uwb.get("file"), str):
        fitted = load_noise(file, "uwb.file", folder).uwb.model_dump(mode="json")
        data = data | {"uwb": uwb | {"file": None, "fitted": fitted}}
    return data


def _settings_in(path: Path, source: str, above: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the settings of a file, laid over the settings of its base, which may have a base too."""
    data = parse_yaml(read_text(path), source)
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise InputError(f"{source}: must hold settings by name, not {type(data).__name__}")
    no_scenarios = data.keys() - {*Scenario.model_fields, "base"}
    for part, fields in (("vehicle", Vehicle.model_fields), ("room", Room.model_fields)):
        if no_scenarios and data.keys() <= {*fields, "name"}:
            raise InputError(
                f"{source}: is a {part}, not a scenario: ortilo fly imu_uwb --set {part}={source} flies it"
            )
    data = _with_read_files(data, path.parent)
    base = data.pop("base", None)
    if base is None:
        return data
    if not isinstance(base, str):
        raise InputError(f"{source}: base: {base!r}: must be a ready-made scenario's name or a .yaml file")
    file = path.parent / resolve(base, f"{source}: base")  # a ready-made scenario's path is absolute
    if not exists(file):
        raise InputError(f"{source}: base: {base}: no such file")
    above = (*above, os.path.realpath(path))
    if os.path.realpath(file) in above:
        raise InputError(f"{source}: base: {base}: leads back to itself")
    if len(above) > _MOST_BASES:
        raise InputError(f"{source}: base: {base}: must be at most {_MOST_BASES} files on one another")
    below = _settings_in(file, base, above)
    below.pop("name", None)
    for *groups, last in _FILES:
        group: Any = below
        for name in groups:
            group = group.get(name) if isinstance(group, dict) else None
        if isinstance(group, dict) and isinstance(group.get(last), str) and group[last] != _FILES[(*groups, last)]:
            group[last] = os.path.realpath(file.parent / group[last])
    return _merged(below, data)


def files_of(name_or_file: str | Path, field: str) -> list[Path]:
    """Return the file of a scenario, the file of its base, and so on."""
    found = [resolve(name_or_file, field)]
    while len(found) <= _MOST_BASES:
        data = parse_yaml(read_text(found[-1]), str(found[-1]))
        base = data.get("base") if isinstance(data, dict) else None
        if not isinstance(base, str):
            break
        found.append(found[-1].parent / resolve(base, f"{found[-1]}: base"))
    return found


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """Return the settings `above` laid over `below`, group by group; a group of another kind replaces the one below."""
    merged = dict(below)
    for key, value in above.items():
        under = merged.get(key)
        if isinstance(under, dict) and isinstance(value, dict):
            same = [key] in _ONE_MODEL or value.get("kind") in (None, under.get("kind"))
            value = _merged(under, value) if same else value
        merged[key] = value
    return merged


def as_settings(settings: Settings, changes: Mapping[str, Any]) -> list[Setting]:
    """Return the settings and changes of load_scenario as one list, in order; InputError if one is no setting."""
    if not isinstance(settings, str | Mapping | Iterable):
        raise InputError(
            f"settings: {settings!r}: must be 'key.key=value', several of these, or a dict of values by key"
        )
    given = [settings] if isinstance(settings, str) else list(getattr(settings, "items", lambda: settings)())
    for one in given:
        if not isinstance(one, str) and not (isinstance(one, tuple) and len(one) == 2 and isinstance(one[0], str)):
            raise InputError(f"settings: {one!r}: must be 'key.key=value', or a key and its value")
    given += [(key.replace("__", "."), value) for key, value in changes.items()]
    return [one if isinstance(one, str) else (one[0], plain_value(*one)) for one in given]


def load_scenario(
    scenario: str | Path | Scenario, settings: Settings = (), seed: int | None = None, **changes: Any
) -> Scenario:
    """Return a scenario, given by name, by file or as a Scenario, with settings laid over it.

    Settings are given as on the command line, by keyword, or both; keywords win:

        >>> import ortilo_drake as od
        >>> lossy = od.load_scenario("imu_uwb", "uwb.link.loss=0.3")
        >>> lossy == od.load_scenario("imu_uwb", uwb__link__loss=0.3)
        True
        >>> lossy.uwb.link.loss.probability
        0.3

    A file may name another as its `base` and then holds only the differences. Paths in a base are relative to the
    base's folder. Paths in settings laid over a scenario are relative to the working folder, over a file of your own to
    the file's folder. An InputError names file, field, value and what is allowed.

    Args:
        scenario: a ready-made scenario's name, the path of a .yaml file, or a Scenario.
        settings: 'uwb.link.loss=0.3' with the value in YAML, several of these, or values by key in a dict. A changed
            'kind' drops the settings of the former kind.
        seed: the seed of all noise; None keeps the scenario's own.
        changes: more settings by keyword, two underscores for a dot: `uwb__link__loss=0.3`. Values as in YAML, paths,
            NumPy numbers and arrays, or settings of a scenario such as `scenario.uwb`.
    """
    given = as_settings(settings, changes)
    seed = plain_value("seed", seed)
    if isinstance(scenario, Scenario):  # with another room, that room's start and goal replace the scenario's
        found = _relative_to(Path.cwd(), _laid_over(scenario, given, seed, scenario.name, Path.cwd()))
        return _along_the_rooms_way(found, _WAY if found.room == scenario.room else _set_of_way(given))
    path = resolve(scenario, "scenario")
    source = str(path) if path != SCENARIO_FOLDER / path.name else path.stem
    data = _settings_in(path, source)
    data.setdefault("name", path.stem)
    # The ready-made scenarios name no files: paths laid over them are relative to the working folder.
    folder = Path.cwd() if path.parent == SCENARIO_FOLDER else path.parent
    valid = validate(Scenario, data, source)
    found = _relative_to(folder, _laid_over(valid, given, seed, source, folder))
    return _along_the_rooms_way(found, _WAY & valid.planner.model_fields_set | _set_of_way(given))


def _laid_over(
    scenario: Scenario, settings: Sequence[Setting], seed: int | None, source: str, folder: Path
) -> Scenario:
    if not settings and seed is None:
        return scenario
    data = scenario.model_dump(mode="json")  # with all defaults, so that each setting finds its group
    for setting in settings:
        _set_field(data, setting)
        data = _with_read_files(data, folder)
    if seed is not None:
        data["seed"] = seed
    return validate(Scenario, data, source)


_WAY = {"start", "goal"}


def _set_of_way(settings: Sequence[Setting]) -> set[str]:
    """Return the names 'start' and 'goal', as far as the settings give them."""
    given: set[str] = set()
    for key, value, _ in map(parsed, settings):
        words = [key.removeprefix("planner.")] if key.startswith("planner.") else value if key == "planner" else ()
        given |= _WAY & set(words) if isinstance(words, list | dict) else set()
    return given


def _along_the_rooms_way(scenario: Scenario, given: set[str]) -> Scenario:
    """Return the scenario with its room's start and goal, as far as the room has them and `given` does not."""
    room = scenario.load_room()
    if not isinstance(scenario.planner, GcsPlanner):
        return scenario
    own = {name: point for name in _WAY - given if (point := getattr(room, name)) is not None}
    return scenario.model_copy(update={"planner": scenario.planner.model_copy(update=own)}) if own else scenario


def _relative_to(folder: Path, scenario: Scenario) -> Scenario:
    """Return the scenario with absolute paths, relative to `folder`, and with its waypoint file read."""
    changes: dict[str, Any] = {}

    def absolute(name: str) -> str:
        return os.path.realpath(folder / name)

    if scenario.room != "ortilo":
        changes["room"] = absolute(scenario.room)
    if isinstance(scenario.planner, WaypointPlanner) and scenario.planner.file is not None:
        points = read_waypoints(Path(absolute(scenario.planner.file)))
        rows = tuple(tuple(row) for row in points.tolist())
        changes["planner"] = scenario.planner.model_copy(update={"file": None, "points": rows})
    if isinstance(scenario.detector, Detector) and scenario.detector.files:
        files = {key: absolute(path) for key, path in scenario.detector.files.items()}
        changes["detector"] = scenario.detector.model_copy(update=files)
    errors = scenario.camera.errors
    if errors.kind == "measured" and errors.file != "rendered":
        errors = errors.model_copy(update={"file": absolute(errors.file)})
        changes["camera"] = scenario.camera.model_copy(update={"errors": errors})
    return scenario.model_copy(update=changes) if changes else scenario


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """Return the same scenario with another seed."""
    return validate(Scenario, scenario.model_dump(mode="json") | {"seed": seed}, scenario.name)
