"""The input of `ortilo tune --fly`: a scenario, settings and their ranges, the number of flights."""

from typing import Annotated, Any, Final

from pydantic import Field, model_validator

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.maps.sweep import Name, OverScenario, Range

FEWEST: Final = 2  # settings that CMA-ES can search


class Search(OverScenario):
    """A search file.

    Attributes:
        axes: by setting the range to search. A setting that is several numbers, such as servo.weights.position, is
            multiplied by what lies in its range.
        flights: by which each candidate is weighed, seeds from `seed` on.
        judge: flights by which start and result are compared, seeds after those.
        evaluations: candidates at most.
        seed: of the first flight, and of the search.
    """

    axes: Annotated[dict[Name, Range], Field(min_length=FEWEST, max_length=20)]
    flights: Annotated[int, Field(ge=2, le=100_000)] = 50
    judge: Annotated[int, Field(ge=2, le=100_000)] = 400
    evaluations: Annotated[int, Field(ge=1, le=100_000)] = 200
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0

    @model_validator(mode="after")
    def _searches_numbers(self) -> "Search":
        for key, axis in self.axes.items():
            if axis.whole:
                raise ValueError(f"axes.{key}.whole: true: must be false, only numbers that go on evenly are searched")
        return self


def base_of(search: Search) -> Scenario:
    """Return the scenario as it is without the search."""
    return load_scenario(search.scenario, tuple(search.settings.items()))


def setting_in(data: Any, key: str) -> Any:
    """Return a scenario's setting by its dotted key, None where it has none."""
    for word in key.split("."):
        data = data.get(word) if isinstance(data, dict) else None
    return data


def settings_at(search: Search, values: tuple[float, ...], source: str) -> dict[str, Any]:
    """Return the settings that a candidate's values stand for; InputError if one is neither a number nor several."""
    data, found = base_of(search).model_dump(mode="json"), {}
    for key, value in zip(search.axes, values, strict=True):
        now = setting_in(data, key)
        several = isinstance(now, list) and len(now) > 0
        if not all(n is None or type(n) in (float, int) for n in (now if several else [now])):
            raise InputError(f"{source}: axes.{key}: is {now!r} in the scenario: must be a number, or several")
        # Where there is none yet, the scenario says whether there may be one.
        found[key] = [number * value for number in now] if several else value
    return found
