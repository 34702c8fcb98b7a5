"""NumPy's .npz files: those that are packed are refused, whatever they unpack to."""

import io

import numpy as np
import pytest

from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.input_files import arrays_of
from ortilo_drake.training.pictures.sets import load_frames


def packed(save, *arrays: np.ndarray, **named: np.ndarray) -> io.BytesIO:
    file = io.BytesIO()
    save(file, *arrays, **named)
    file.seek(0)
    return file


def test_arrays_come_back() -> None:
    with arrays_of(packed(np.savez, a=np.arange(3), b=np.array(2.5))) as found:
        np.testing.assert_array_equal(found["a"], [0, 1, 2])
        assert float(found["b"]) == 2.5


def test_packed_arrays_are_refused() -> None:
    with pytest.raises(ValueError, match=r"a\.npy is packed"), arrays_of(packed(np.savez_compressed, a=np.zeros(9))):
        pass
    with pytest.raises(ValueError, match="holds one array"), arrays_of(packed(np.save, np.zeros(9))):
        pass


@pytest.mark.long
def test_a_shard_that_unpacks_to_much_more_is_refused_in_one_line(tmp_path) -> None:
    images = np.zeros((1, 4000, 4000, 3), np.uint8)
    (tmp_path / "0.npz").write_bytes(packed(np.savez_compressed, images=images, labels=images).getvalue())
    assert (tmp_path / "0.npz").stat().st_size < 2**18
    with pytest.raises(InputError, match=r"0\.npz: not a shard of rendered pictures: .*images\.npy is packed"):
        load_frames(tmp_path)
