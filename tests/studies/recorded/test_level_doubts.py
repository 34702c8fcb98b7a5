"""A body that begins on its side, or leans, by SciPy's rotations."""

import numpy as np
import pytest
from made_up_motion import BAG_MAP, as_map
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Start
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.interop.recorded.units import axes_matrix
from ortilo_drake.studies.recorded.level_doubts import lean_warning, level_doubts

MAP = as_map(BAG_MAP.replace("axes: frd", "axes: flu"))
RESTING = {"position": (0.0, 0.0, 0.0), "heading": 0.0}
ROLLED = Rotation.from_euler("x", 90, degrees=True).as_matrix()
PITCHED = Rotation.from_euler("y", -90, degrees=True).as_matrix()


@pytest.mark.parametrize(
    ("R", "how", "axes"),
    [
        (ROLLED, "rolled by 90", "[x, -z, y]"),
        (PITCHED, "pitched by -90", "[-z, y, x]"),
        (ROLLED.T, "rolled by -90", "[x, z, -y]"),
    ],
)
def test_an_imu_that_lies_on_its_side_is_told_with_the_axes_that_make_it_level(R, how, axes) -> None:
    imu = Imu(np.arange(0.0, 2.0, 0.01), np.zeros((200, 3)), np.tile(R.T @ [0.0, 0.0, 9.81], (200, 1)), None)
    resting = MAP.model_copy(update={"start": Start(**RESTING)})
    (said,) = level_doubts(imu, resting)
    assert f"the body lies {how} degrees: is `axes` right? imu: {{axes: {axes}}} makes it level" in said
    f = axes_matrix(tuple(axes[1:-1].split(", ")), "axes") @ imu.force[0]  # the map's own reading of that list
    np.testing.assert_allclose(f, [0.0, 0.0, 9.81], atol=1e-12)
    assert level_doubts(imu, MAP) == []  # nothing says that it rests
    assert level_doubts(imu, resting.model_copy(update={"start": Start(**RESTING, tilted=True)})) == []


@pytest.mark.parametrize(("degrees", "told"), [(28.0, False), (32.0, True), (44.0, True)])
def test_a_tilt_that_no_exchange_of_axes_mends_is_told_without_one(degrees, told) -> None:
    f = Rotation.from_euler("xy", [3.0, degrees], degrees=True).inv().apply([0.0, 0.0, 9.81])
    imu = Imu(np.arange(0.0, 2.0, 0.01), np.zeros((200, 3)), np.tile(f, (200, 1)), None)
    said = level_doubts(imu, MAP.model_copy(update={"start": Start(**RESTING)}))
    assert bool(said) == told
    assert not any("makes it level" in line for line in said)


@pytest.mark.parametrize(("degrees", "told"), [(8.3, False), (11.0, False), (13.0, True), (20.0, True)])
def test_a_body_that_leans_at_its_start_is_warned_of(degrees, told) -> None:
    """The recorded flights begin within 8.3 degrees."""
    f = Rotation.from_euler("x", degrees, degrees=True).inv().apply([0.0, 0.0, 9.81])
    imu, start = Imu(np.arange(0.0, 2.0, 0.01), np.zeros((200, 3)), np.tile(f, (200, 1)), None), Start(**RESTING)
    said = lean_warning(imu, MAP.model_copy(update={"start": start}))
    assert bool(said) == told
    assert (f"rolled by {degrees:.0f} degrees" in said) == told
    assert lean_warning(imu, MAP) == ""
    assert lean_warning(imu, MAP.model_copy(update={"start": start.model_copy(update={"tilted": True})})) == ""
