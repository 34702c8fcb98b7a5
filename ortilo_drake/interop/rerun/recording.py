"""A flight as a recording for Rerun: one .rrd file, written whole or not at all."""

from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr

from ortilo_drake import __version__
from ortilo_drake.flight.files import write_bytes
from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.interop.rerun.series import all_series
from ortilo_drake.interop.rerun.sightings import Sightings
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.typed_yaml import InputError

if TYPE_CHECKING:
    import rerun as rr

SUFFIX = ".rrd"
APPLICATION = "ortilo-drake"


def check_recording(path: Path) -> None:
    """Refuse a recording with another suffix than .rrd, or without Rerun: InputError names the file or the package."""
    if path.suffix != SUFFIX:
        raise InputError(f"{path}: unknown kind of recording '{path.suffix}', give {SUFFIX}")
    check_installed("rerun", "rerun")


def recording_bytes(flight: xr.Dataset, seen: Sightings) -> bytes:
    """Return the content of an .rrd file of a flight with its pictures, boxes and ranges."""
    import rerun as rr

    recording = rr.RecordingStream(APPLICATION)
    memory = recording.memory_recording()
    try:
        _fill(recording, flight, seen)
    finally:  # also after Ctrl-C: Rerun complains on stderr about data that is never drained
        data: bytes = memory.drain_as_bytes()
    return data


def _fill(recording: "rr.RecordingStream", flight: xr.Dataset, seen: Sightings) -> None:
    import rerun as rr

    from ortilo_drake.interop.rerun.layout import default_layout
    from ortilo_drake.interop.rerun.vehicle_drawn import send_camera, send_room, send_series, send_vehicle

    scenario = scenario_of(flight)
    room = scenario.load_room()
    recording.send_blueprint(default_layout(room, scenario.sees_landmarks))
    recording.send_recording_name(f"{scenario.name}, seed {flight.attrs['seed']}")
    text = scenario.model_dump_json(indent=2)
    about = f"ortilo-drake {__version__}, seed {flight.attrs['seed']}, lost: {flight.attrs['lost']}\n\n{text}"
    recording.log("scenario", rr.TextDocument(about), static=True)
    send_room(recording, room)
    send_vehicle(recording, flight)
    send_camera(recording, scenario, room, seen)
    for path, series in all_series(flight, seen).items():
        send_series(recording, path, series)


def save_recording(flight: xr.Dataset, seen: Sightings, path: Path) -> None:
    """Write a flight as an .rrd file; InputError as in check_recording and flight.files.write_bytes."""
    check_recording(path)
    write_bytes(path, recording_bytes(flight, seen))
