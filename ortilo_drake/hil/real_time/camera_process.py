"""The camera in its own process, and the detector in its own thread, so that neither delays a tick of its half.

Drawing a picture takes 15 ms. The detector takes pictures and returns detections messages when they are ready.
"""

import multiprocessing
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import Synchronized
from typing import Any

import numpy as np

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.packets import Outbox, encode_picture
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Scenario


class CameraProcess:
    """A process that draws the pictures of a rendered camera on request and sends them on a bus; a context manager.

    Of several waiting requests it draws only the newest.
    """

    def __init__(self, scenario: Scenario, url: str, key: bytes):
        spawn = multiprocessing.get_context("spawn")
        self._jobs, self._child_end = spawn.Pipe()
        self._skipped: Synchronized[int] = spawn.Value("q", 0)
        text = scenario.model_dump_json()
        self._process = spawn.Process(target=_draw, args=(text, url, key, self._child_end, self._skipped), daemon=True)

    def __enter__(self) -> "CameraProcess":
        self._process.start()
        self._child_end.close()  # while this end is open here, this process cannot notice that the child has ended
        return self

    def __exit__(self, *error: Any) -> None:
        try:
            self._jobs.send(None)
        except OSError:
            return  # the process has ended already
        self._process.join(5.0)

    @property
    def skipped(self) -> int:
        """The number of pictures that were requested but not drawn."""
        return self._skipped.value

    def wait_until_ready(self) -> None:
        """Return once the process has drawn a first picture; InputError with the reason if it cannot."""
        try:
            error = self._jobs.recv()
        except EOFError:
            self._process.join(5.0)
            error = f"its process ended with code {self._process.exitcode}"
        if error:
            raise InputError(f"camera: {error}")

    def shoot(self, session: int, tick: int, stamp: float, x: np.ndarray) -> None:
        """Request a picture from the true state x (12) at a stamp [s], to be sent as a packet of a tick.

        If the process has ended, the flight goes on without pictures.
        """
        try:
            self._jobs.send((session, tick, stamp, x))
        except OSError:
            with self._skipped.get_lock():
                self._skipped.value += 1


def _draw(scenario_json: str, url: str, key: bytes, jobs: Connection, skipped: "Synchronized[int]") -> None:
    try:
        scenario = Scenario.model_validate_json(scenario_json)
        diagram = make_rendered_camera(scenario.load_room(), scenario.camera.width)
        context, bus = diagram.CreateDefaultContext(), Bus(url, key, hears=False)
    except InputError as error:
        jobs.send(str(error))
        return
    state, image = diagram.GetInputPort("state"), diagram.GetOutputPort("color_image")
    state.FixValue(context, np.zeros(12))
    image.Eval(context)
    try:
        with bus:
            jobs.send("")
            while (job := jobs.recv()) is not None:
                while jobs.poll():
                    newer = jobs.recv()
                    if newer is None:
                        return
                    job = newer
                    with skipped.get_lock():
                        skipped.value += 1
                session, tick, stamp, x = job
                state.FixValue(context, x)
                pixels = np.array(image.Eval(context).data)
                Outbox(bus, session).send("image", encode_picture(session, tick, stamp, pixels))
    except (EOFError, KeyboardInterrupt, BrokenPipeError):
        return


class DetectorThread:
    """A thread that detects landmarks in one picture at a time of a rendered camera, outside of Python's lock.

    Of the pictures that come meanwhile it keeps the newest and counts the others as skipped. InputError if the
    detector's files are wrong.
    """

    def __init__(self, scenario: Scenario):
        room = scenario.load_room()
        camera = room.camera.scaled_to(scenario.camera.width)
        self._detect = load_detector(scenario.detector, room, (camera.width, camera.height))
        self._pool = ThreadPoolExecutor(1)
        self._jobs: list[Future[np.ndarray]] = []
        self.skipped = 0
        self.look(0.0, np.zeros((camera.height, camera.width, 4), dtype=np.uint8))  # the first picture takes longer
        self._jobs.pop().result()

    def look(self, stamp: float, image: np.ndarray) -> None:
        """Give the detector a picture (height, width, 4), uint8, taken at a stamp [s]."""
        looked_at = [job for job in self._jobs if not job.cancel()]
        self.skipped += len(self._jobs) - len(looked_at)
        self._jobs = [*looked_at, self._pool.submit(self._message, stamp, image)]

    def _message(self, stamp: float, image: np.ndarray) -> np.ndarray:
        return detections_message(stamp, *self._detect(image[..., :3]))

    def newest(self) -> np.ndarray | None:
        """Return the newest detections message that is ready, each only once; None if there is none."""
        ready = [job for job in self._jobs if job.done()]
        self._jobs = [job for job in self._jobs if job not in ready]
        return ready[-1].result() if ready else None
