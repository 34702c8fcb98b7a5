"""The detector in a thread of its own: pictures in, and detections messages out when they are ready."""

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Scenario


class DetectorThread:
    """Looks at one picture at a time of a rendered camera, outside of Python's lock.

    Of those that come meanwhile it keeps the newest, and counts the others as skipped. InputError if the detector's
    files are wrong.
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
        """Give it a picture (height, width, 4), uint8, taken at a stamp [s]."""
        looked_at = [job for job in self._jobs if not job.cancel()]
        self.skipped += len(self._jobs) - len(looked_at)
        self._jobs = [*looked_at, self._pool.submit(self._message, stamp, image)]

    def _message(self, stamp: float, image: np.ndarray) -> np.ndarray:
        return detections_message(stamp, *self._detect(image[..., :3]))

    def newest(self) -> np.ndarray | None:
        """Return the newest detections message, each only once; None if there is none."""
        ready = [job for job in self._jobs if job.done()]
        self._jobs = [job for job in self._jobs if job not in ready]
        return ready[-1].result() if ready else None
