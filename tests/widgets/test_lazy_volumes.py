"""Image layers whose data are still on disk."""

from __future__ import annotations

import dask.array
import numpy as np
import pytest

from napari_unpack.widgets import layer_inputs
from napari_unpack.widgets.layer_inputs import Volume, in_memory
from napari_unpack.widgets.session_builder import build

MM = (1.0, 1.0, 1.0)


class _Far:
    shape = (2048, 2048, 2048)
    dtype = np.dtype(np.uint16)

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise AssertionError("read")


def test_a_dask_volume_is_prepared_like_the_array_it_stands_for(
    bag: tuple[np.ndarray, np.ndarray],
) -> None:
    volume, _ = bag
    noisy = volume + np.random.default_rng(0).integers(0, 20, volume.shape, np.uint16)
    settings = {"smallest": 100.0, "shell": False}
    labels = []
    for data in (noisy, dask.array.from_array(noisy, chunks=(16, 16, 16))):
        ready = build(Volume(data, MM, "bag"), None, {}, settings, lambda fraction, text: None)
        assert ready.is_found
        labels.append(ready.labels)
        np.testing.assert_array_equal(ready.session.volume, noisy)
    np.testing.assert_array_equal(*labels)


def test_a_volume_larger_than_memory_says_what_to_do_and_is_not_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(layer_inputs, "total_memory", lambda: 16e9)
    far = Volume(_Far(), MM, "scan")
    with pytest.raises(ValueError, match=r"'scan' \(2048 x 2048 x 2048\) needs about 120 GB"):
        in_memory(far)
    whole = np.zeros((2, 2, 2))
    monkeypatch.setattr(layer_inputs, "total_memory", lambda: 1.0)
    assert in_memory(Volume(whole, MM, "here")) is whole
