"""Schema and table of the settings: every field has a meaning and a unit, the stored copy is what is printed."""

import json
import re
from dataclasses import replace
from typing import Any, Literal

import pytest
import yaml
from command_line import run
from pydantic import BaseModel

from ortilo_drake.commands import terminal
from ortilo_drake.model import parts
from ortilo_drake.model.parts import find_sensor, known_sensors
from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.scenario import SCENARIO_FOLDER, Scenario, load_scenario, scenario_names
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.scenario.schema import meanings, models_in, scenario_keys, scenario_schema


def is_ours(sensor: parts.Sensor) -> bool:
    return sensor.settings.__module__.startswith("ortilo_drake.")


OWN = tuple(sensor for sensor in map(find_sensor, known_sensors()) if sensor and is_ours(sensor))
OWN_PARTS = {
    (role, kind): part
    for role in parts.KINDS
    for kind in parts.known_kinds(role)
    if (part := parts.find_part(role, kind)) and part.settings.__module__.startswith("ortilo_drake.")
}
SETTINGS = (Scenario, *(sensor.settings for sensor in OWN), *(part.settings for part in OWN_PARTS.values()))
MODELS = list(dict.fromkeys(model for settings in SETTINGS for model in models_in(settings)))
NO_QUANTITY = {"seed"}


@pytest.fixture(autouse=True)
def no_parts_of_other_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only what the package itself registers: the stored schema is of that."""
    monkeypatch.setattr(parts, "_SENSORS", {sensor.name: sensor for sensor in OWN})
    monkeypatch.setattr(parts, "_PARTS", OWN_PARTS)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_every_field_has_a_meaning_and_every_meaning_a_field(model: type[BaseModel]) -> None:
    assert list(meanings(model)) == list(model.model_fields)
    assert all(meanings(model).values())


def test_only_a_kind_of_one_value_needs_no_meaning() -> None:
    class OfTwo(SensorSettings):
        kind: Literal["near", "far"] = "near"

    class OfAny(SensorSettings):
        kind: str = "near"

    assert [*meanings(OfTwo)] == [*meanings(OfAny)] == ["link"]


def test_every_number_has_a_unit() -> None:
    for key in scenario_keys():
        is_number = "number" in key.allowed or "integer" in key.allowed
        assert not is_number or key.unit or key.key in NO_QUANTITY, key.key


def test_every_setting_says_what_it_allows_and_no_group_hides_its_own() -> None:
    keys = scenario_keys()
    gaps = [key.key for key in keys if not key.allowed or key.allowed[0] == " " or "  " in key.allowed]
    assert gaps == []
    assert [key.key for key in keys if re.search(r"\bsee [A-Z]\w+|\.py\b", key.meaning)] == []
    listed = {key.key.rpartition(".")[2].removesuffix("[]") for key in keys}
    groups = {"vehicle", "arms", "exclude", "robust", "watch", "faults"}
    for model in MODELS:
        its = {name for name, field in model.model_fields.items() if not list(models_in(field.annotation))}
        assert its <= listed | groups, model
    assert {key.key for key in scenario_keys("vehicle.arms")} == {
        "vehicle.arms", "vehicle.arms[].angle", "vehicle.arms[].length", "vehicle.arms[].spin"
    }  # fmt: skip
    allowed = {key.key: key.allowed for key in scenario_keys("multilateration.exclude")}
    assert allowed["multilateration.exclude"] == "group or null"
    assert allowed["multilateration.exclude.least_ranges"] == "integer >= 5, <= 1000"


@pytest.mark.long
def test_the_keys_are_those_of_the_default_scenario() -> None:
    def leaves(data: Any, name: str = "") -> set[str]:
        if not isinstance(data, dict) or not data:
            return {name}
        return set().union(*(leaves(value, f"{name}.{key}" if name else key) for key, value in data.items()))

    listed = {key.key for key in scenario_keys()}
    assert leaves(Scenario().model_dump(mode="json")) <= listed
    assert leaves(load_scenario("flow").model_dump(mode="json")) <= listed
    default = {key.key: key.default for key in scenario_keys("camera")}
    assert (default["camera.width"], default["camera.link.rate"]) == ("320", "10.0")
    assert {key.default for key in scenario_keys("uwb.link.loss.mean_length")} == {"needed"}
    assert [key.unit for key in scenario_keys("servo.weights.control")] == ["1/N^2, 1/(N m)^2"]


@pytest.mark.long
def test_the_stored_schema_is_what_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("scenario", "schema") == 0
    printed = capsys.readouterr().out
    stored = (SCENARIO_FOLDER / "scenario.schema.json").read_text(encoding="utf-8")
    assert printed == stored, "ortilo scenario schema > diagrams/scenarios/scenario.schema.json"
    assert json.loads(printed) == scenario_schema()


@pytest.mark.long
def test_registered_parts_are_in_it_also_where_two_models_have_one_name(monkeypatch: pytest.MonkeyPatch) -> None:
    class Imu(SensorSettings):
        """A second one.

        Attributes:
            link: how its messages reach the vehicle.
            sd: noise [rad].
        """

        sd: float = 0.5

    class Still(Frozen):
        """A servo that does nothing."""

        kind: Literal["still"] = "still"

    second = replace(OWN[0], name="second_imu", settings=Imu)
    monkeypatch.setattr(parts, "_SENSORS", {"second_imu": second})
    monkeypatch.setattr(parts, "_PARTS", {("servo", "still"): parts.Part("still", Still, lambda scenario: None)})
    properties = scenario_schema()["properties"]
    assert properties["second_imu"]["description"] == "A second one."
    assert properties["sensors"]["items"]["enum"] == ["uwb", "camera", "imu", "second_imu"]
    assert [(key.key, key.unit, key.default) for key in scenario_keys("second_imu.sd")] == [
        ("second_imu.sd", "rad", "0.5")
    ]
    assert [key.allowed for key in scenario_keys("servo.kind")] == ["lq | still"]
    assert [key.key for key in scenario_keys("imu.angle_density")] == ["imu.angle_density"]


def matches(schema: dict[str, Any], place: dict[str, Any], data: Any) -> bool:
    """Whether data is of the shape that a JSON schema gives a place: the part of JSON Schema that ours uses."""
    if "$ref" in place:
        place = schema["$defs"][place["$ref"].rpartition("/")[2]]
    for union in ("anyOf", "oneOf"):
        if union in place and not any(matches(schema, part, data) for part in place[union]):
            return False
    if data not in place.get("enum", [place.get("const", data)]):
        return False
    types = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float), "null": type(None)}
    types["boolean"] = bool
    if "type" in place and not isinstance(data, types[place["type"]]):
        return False
    if isinstance(data, int | float):
        low, high = place.get("minimum", data), place.get("maximum", data)
        return low <= data <= high and place.get("exclusiveMinimum", -1e99) < data < place.get("exclusiveMaximum", 1e99)
    if isinstance(data, list) and "items" in place and place["items"] is not False:
        return all(matches(schema, place["items"], entry) for entry in data)
    if isinstance(data, dict) and "properties" in place:
        known = place["properties"]
        return set(data) <= set(known) and all(matches(schema, known[name], value) for name, value in data.items())
    return True


@pytest.mark.family
@pytest.mark.parametrize("name", scenario_names())
def test_ready_made_scenarios_name_the_schema_and_match_it(name: str) -> None:
    text = (SCENARIO_FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    assert text.startswith("# yaml-language-server: $schema=scenario.schema.json\n# ")
    schema = scenario_schema()
    assert matches(schema, schema, yaml.safe_load(text))
    assert matches(schema, schema, load_scenario(name).model_dump(mode="json"))


@pytest.mark.family
@pytest.mark.parametrize(
    "data", [{"uwb": {"link": {"loss": 1.3}}}, {"seeds": 3}, {"camera": {"kind": "drawn"}}, {"seed": -1}]
)
def test_the_schema_refuses_what_is_wrong(data: dict[str, Any]) -> None:
    schema = scenario_schema()
    assert not matches(schema, schema, data)
    assert matches(schema, schema, {"base": "nominal_imu_uwb", "uwb": {"link": {"loss": 0.3}}})


def test_keys_are_plain_in_a_pipe_and_a_table_on_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run("scenario", "keys", "uwb.link") == 0
    head, *rows = [line.split("\t") for line in capsys.readouterr().out.splitlines()]
    assert head == ["key", "allowed", "unit", "default", "meaning"]
    assert rows[0][:4] == ["uwb.link.rate", "number >= 0.001 or null", "Hz", "10.0"]
    assert all(row[0].startswith("uwb.link.") for row in rows)
    monkeypatch.setattr(terminal.out, "_force_terminal", True)
    assert run("scenario", "keys", "uwb.link.delay") == 0
    assert re.search(r"uwb\.link\.delay.*ticks", capsys.readouterr().out)


def test_an_unknown_prefix_is_refused_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("scenario", "keys", "uwb.lnk") == 2
    assert "uwb.lnk: no such setting, did you mean 'uwb.link'?" in capsys.readouterr().err
