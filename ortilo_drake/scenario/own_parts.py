"""Scenarios with parts that are not built in: a scenario's model with fields for the parts that its data names."""

import inspect
from functools import lru_cache
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, create_model

from ortilo_drake.model.parts import KINDS, Part, Sensor, find_part, find_sensor, known_kinds, known_sensors
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.scenario.link import Link


class SensorSettings(Frozen):
    """Base of the settings of a sensor of one's own.

    Attributes:
        link: how its messages reach the vehicle.
    """

    link: Link = Link()


def model_for(base: type[BaseModel], data: Any) -> type[BaseModel]:
    """Return the model that data of a scenario is checked by: base, or base with fields for the parts it names.

    Args:
        base: the scenario's model.
        data: what YAML or JSON holds.
    """
    if not isinstance(data, dict):
        return base
    listed = data.get("sensors")
    names = {name for name in listed if isinstance(name, str)} if isinstance(listed, list | tuple) else set()
    names |= {key for key in data if key not in base.model_fields}
    names -= {*SENSORS, *base.model_fields}
    own = {name: find_sensor(name) for name in sorted(names)}
    if names and not all(own.values()):
        own = {name: find_sensor(name) for name in known_sensors() if name not in SENSORS}  # an error then lists them
    sensors = tuple(sensor for sensor in own.values() if sensor is not None)
    parts = []
    for role in KINDS:
        group = data.get(role)
        kind = group.get("kind") if isinstance(group, dict) else None
        if isinstance(kind, str) and kind not in _built_in_kinds(base, role):
            found = find_part(role, kind)
            kinds = (kind,) if found else known_kinds(role)
            parts += [(role, part) for name in kinds if (part := find_part(role, name))]
    return _model(base, sensors, tuple(parts)) if sensors or parts else base


def model_of_all(base: type[BaseModel]) -> type[BaseModel]:
    """Return base with fields for every part that is registered: what any scenario may hold here."""
    sensors = tuple(s for name in known_sensors() if name not in SENSORS and (s := find_sensor(name)))
    parts = tuple((role, p) for role in KINDS for kind in known_kinds(role) if (p := find_part(role, kind)))
    return _model(base, sensors, parts)


@lru_cache(maxsize=256)
def _built_in_kinds(base: type[BaseModel], role: str) -> frozenset[str]:
    annotation: Any = base.model_fields[role].annotation
    return frozenset(
        kind
        for model in getattr(annotation, "__args__", (annotation,))
        for kind in getattr(model.model_fields["kind"].annotation, "__args__", ())
    )


@lru_cache(maxsize=64)
def _model(base: type[BaseModel], sensors: tuple[Sensor, ...], parts: tuple[tuple[str, Part], ...]) -> type[BaseModel]:
    fields: dict[str, Any] = {
        sensor.name: (sensor.settings, Field(sensor.settings(), description=_first_line(sensor.settings)))
        for sensor in sensors
    }
    names = (*SENSORS, *(sensor.name for sensor in sensors))
    fields["sensors"] = (tuple[Literal[names], ...], base.model_fields["sensors"].default)  # type: ignore[valid-type]
    for role in {role for role, _ in parts}:
        field: Any = base.model_fields[role].annotation
        for its_role, part in parts:
            field = field | part.settings if its_role == role else field
        fields[role] = (Annotated[field, Field(discriminator="kind")], base.model_fields[role].default)
    return create_model(base.__name__, __base__=base, __module__=base.__module__, __doc__=base.__doc__, **fields)


def _first_line(settings: type[BaseModel]) -> str:
    return (inspect.getdoc(settings) or "").partition("\n")[0]
