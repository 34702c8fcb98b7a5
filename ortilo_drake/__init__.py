"""A laboratory for indoor navigation with sensors that come and go, built on Drake.

    >>> import ortilo_drake as od
    >>> scenario = od.load_scenario("imu_uwb_yolo", seed=3, camera__kind="projected", uwb__link__loss=0.3)
    >>> scenario.seed, scenario.camera.kind, scenario.uwb.link.loss.probability
    (3, 'projected', 0.3)
    >>> flight = od.fly(scenario, planner={"kind": "hover", "duration": 0.5}, settle=0.0)  # the default path takes 40 s
    >>> flight.lost is None
    True

All public names are in ortilo_drake.api, which loads at the first use of one of them: Drake takes a second to load.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ortilo_drake.api import *  # noqa: F403 - it says which

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name.startswith("_") and name != "__all__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    api = import_module("ortilo_drake.api")
    if name != "__all__" and name not in api.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted({"__version__", *import_module("ortilo_drake.api").__all__})
