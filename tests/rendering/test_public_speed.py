"""The public functions cast through bricks, give what they gave without, and keep no array."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from napari_unpack import rendering
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cpu
from napari_unpack.rendering.backends import gl_driver

VIEW = View(direction=(0.5, 0.35, 1.0))


def bag() -> tuple[np.ndarray, np.ndarray]:
    """Return density and labels of some boxes, in arrays that nobody else has."""
    rng = np.random.default_rng(0)
    labels = np.zeros((40, 44, 50), np.uint16)
    for i in range(1, 12):
        low = rng.integers(0, 30, 3)
        labels[tuple(slice(a, a + n) for a, n in zip(low, rng.integers(4, 14, 3), strict=True))] = i
    return (labels * 90 + 20 + rng.integers(0, 9, labels.shape)).astype(np.uint16), labels


def backends() -> list[str]:
    return ["cpu", "gl"] if gl_driver().available() else ["cpu"]


def calls(volume: np.ndarray, labels: np.ndarray, backend: str) -> dict[str, object]:
    """Call every public function that casts, with rays at the voxel pitch."""
    at = {"view": VIEW, "size": (64, 64), "backend": backend}
    return {
        "render": rendering.render(volume, labels, **at),
        "ids": rendering.object_id_layers(labels, **at),
        "ratios": rendering.occlusion_ratios(labels, **at),
        "pick": rendering.pick(volume, labels, pixel=(30, 30), **at),
    }


@pytest.mark.parametrize("backend", backends())
def test_images_and_counts_take_bricks_and_are_the_same_without(backend, monkeypatch) -> None:
    given: dict[str, list[bool]] = {}
    drawing = cpu if backend == "cpu" else rendering.api.chosen("gl")

    def without_bricks(name: str) -> None:
        kept = getattr(drawing, name)
        place = {"tinted": 8, "id_layers": 4, "occlusion_counts": 3}[name]

        def cast(*args: object) -> object:
            given.setdefault(name, []).append(args[place] is not None)
            return kept(*args[:place], None, *args[place + 1 :])

        monkeypatch.setattr(drawing, name, cast)

    quick = calls(*bag(), backend)
    for name in ("tinted", "id_layers", "occlusion_counts"):
        without_bricks(name)
    slow = calls(*bag(), backend)
    # Layers of IDs alone are cast as fast without, on the CPU.
    assert given == {"tinted": [True], "id_layers": [backend == "gl"], "occlusion_counts": [True]}
    np.testing.assert_array_equal(quick["render"], slow["render"])
    np.testing.assert_array_equal(quick["ids"], slow["ids"])
    assert quick["ratios"] == slow["ratios"]
    assert quick["pick"] == slow["pick"]


@pytest.mark.parametrize("backend", backends())
def test_no_function_keeps_the_arrays_alive(backend) -> None:
    volume, labels = bag()
    calls(volume, labels, backend)
    left = weakref.ref(volume), weakref.ref(labels)
    del volume, labels
    gc.collect()
    assert [ref() for ref in left] == [None, None]
