"""Registered parts: a scenario's model, extended by fields for the parts that its data names, and the parts' boxes."""

import inspect
from functools import lru_cache
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, Field, create_model

from ortilo_drake.loop.element import Box
from ortilo_drake.model.parts import KINDS, Part, Sensor, find_part, find_sensor, known_kinds, own_sensors
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import Frozen, InputError
from ortilo_drake.scenario.faults import MAX_FAULTS
from ortilo_drake.scenario.link import Link


class SensorSettings(Frozen):
    """Base of the settings of a sensor of your own."""

    link: Link = Link()
    """rate and delivery of the sensor's messages."""


def model_for(base: type[BaseModel], data: Any) -> type[BaseModel]:
    """Return the model that checks a scenario's data: `base`, or `base` with fields for the parts that data names."""
    if not isinstance(data, dict):
        return base
    listed = data.get("sensors")
    names = {name for name in listed if isinstance(name, str)} if isinstance(listed, list | tuple) else set()
    names |= {key for key in data if key not in base.model_fields}
    names -= {*SENSORS, *base.model_fields}
    sensors = tuple(sensor for name in sorted(names) if (sensor := find_sensor(name)))
    if len(sensors) < len(names):
        sensors = own_sensors()  # the error message then lists all
    parts = []
    for role in _roles(base):
        its = data.get("faults") if role == "fault" else [data.get(role)]
        groups = [group for group in its if isinstance(group, dict)] if isinstance(its, list | tuple) else []
        for kind in dict.fromkeys(kind for group in groups if isinstance(kind := group.get("kind"), str)):
            if kind not in _known_kinds(base, role):
                kinds = (kind,) if find_part(role, kind) else known_kinds(role)
                parts += [(role, part) for name in kinds if (part := find_part(role, name))]
    parts = list(dict.fromkeys(parts))
    return _model(base, sensors, tuple(parts)) if sensors or parts else base


def model_of_all(base: type[BaseModel]) -> type[BaseModel]:
    """Return `base` with a field for every registered part."""
    parts = tuple((role, p) for role in _roles(base) for kind in known_kinds(role) if (p := find_part(role, kind)))
    return _model(base, own_sensors(), parts)


def _roles(base: type[BaseModel]) -> list[str]:
    """Return the roles of parts in a model; the onboard half's model has no faults."""
    return [role for role in KINDS if role != "fault" or "faults" in base.model_fields]


def _settings_of(base: type[BaseModel], role: str) -> Any:
    """Return the settings, or their union, of the parts of a role that a model knows."""
    if role == "fault":
        return get_args(get_args(base.model_fields["faults"].annotation)[0])[0]  # in tuple[Annotated[union, ...], ...]
    return base.model_fields[role].annotation


@lru_cache(maxsize=256)
def _known_kinds(base: type[BaseModel], role: str) -> frozenset[str]:
    annotation = _settings_of(base, role)
    return frozenset(
        kind
        for model in getattr(annotation, "__args__", (annotation,))
        for kind in getattr(model.model_fields["kind"].annotation, "__args__", ())
    )


@lru_cache(maxsize=64)
def _model(base: type[BaseModel], sensors: tuple[Sensor, ...], parts: tuple[tuple[str, Part], ...]) -> type[BaseModel]:
    fields: dict[str, Any] = {
        sensor.name: (sensor.settings, Field(sensor.settings(), description=first.partition("\n")[0]))
        for sensor, first in ((sensor, inspect.getdoc(sensor.settings) or "") for sensor in sensors)
    }
    names = (*SENSORS, *(sensor.name for sensor in sensors))
    fields["sensors"] = (tuple[Literal[names], ...], base.model_fields["sensors"].default)  # type: ignore[valid-type]
    for role in {role for role, _ in parts}:
        field = _settings_of(base, role)
        for its_role, part in parts:
            field = field | part.settings if its_role == role else field
        one: Any = Annotated[field, Field(discriminator="kind")]
        if role == "fault":
            fields["faults"] = (Annotated[tuple[one, ...], Field(max_length=MAX_FAULTS)], ())
        else:
            fields[role] = (one, base.model_fields[role].default)
    return create_model(base.__name__, __base__=base, __module__=base.__module__, __doc__=base.__doc__, **fields)


def box_of(part: Part, whose: str, *arguments: Any) -> Box:
    """Return the box that a part makes of its arguments; InputError, which begins with `whose`, if it makes none."""
    assert part.box is not None  # register_part ensures it
    try:
        made = part.box(*arguments)
    except Exception as error:  # a user's function may raise anything; a ValueError of od.box names the value itself
        said = f"{error}" if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise InputError(f"{whose}: {said}") from error
    if not isinstance(made, Box):
        raise InputError(f"{whose}: its box returns {made!r}: must return an od.box")
    return made
