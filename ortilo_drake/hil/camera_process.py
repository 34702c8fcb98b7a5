"""The camera in a process of its own, so that drawing, 15 ms a picture, holds up no tick of the world."""

import multiprocessing
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.hil.packets import encode_picture, lane
from ortilo_drake.hil.transport import open_lcm
from ortilo_drake.scenario import Scenario


class CameraProcess:
    """Draws and sends pictures on request; a context manager.

    Args:
        scenario: the scenario, whose camera renders.
        url: the bus.
    """

    def __init__(self, scenario: Scenario, url: str):
        spawn = multiprocessing.get_context("spawn")
        self._jobs, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_draw, args=(scenario.model_dump_json(), url, theirs), daemon=True)

    def __enter__(self) -> "CameraProcess":
        self._process.start()
        return self

    def __exit__(self, *error: Any) -> None:
        try:
            self._jobs.send(None)
        except OSError:
            return  # it has gone already
        self._process.join(5.0)

    def wait_until_ready(self) -> None:
        """Return once it has drawn a first picture."""
        self._jobs.recv()

    def shoot(self, session: int, tick: int, stamp: float, x: np.ndarray) -> None:
        """Have a picture drawn as seen from the state x (12) at a stamp [s], and sent as of a tick."""
        self._jobs.send((session, tick, stamp, x))


def _draw(scenario_json: str, url: str, jobs: Connection) -> None:
    scenario = Scenario.model_validate_json(scenario_json)
    diagram = make_rendered_camera(scenario.load_room(), scenario.rendered_camera.width)
    context, lcm = diagram.CreateDefaultContext(), open_lcm(url)
    state, image = diagram.GetInputPort("state"), diagram.GetOutputPort("color_image")
    state.FixValue(context, np.zeros(12))
    image.Eval(context)
    try:
        jobs.send("ready")
        while (job := jobs.recv()) is not None:
            session, tick, stamp, x = job
            state.FixValue(context, x)
            pixels = np.array(image.Eval(context).data)
            lcm.Publish(lane("image", tick), encode_picture(session, tick, stamp, pixels))
    except (EOFError, KeyboardInterrupt, BrokenPipeError):
        return
