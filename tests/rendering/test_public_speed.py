"""The public functions cast through bricks, as fast as they can, and keep no array."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable
from statistics import median
from time import process_time
from typing import Any

import numpy as np
import pytest

from napari_unpack import rendering
from napari_unpack.appearance import TransferFunction
from napari_unpack.geometry.shading import Shading
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cpu
from napari_unpack.rendering.backends import gl_driver

VIEW = View(direction=(0.5, 0.35, 1.0))
LARGE, MM = (512, 512), (1.0, 1.0, 1.0)


def bag() -> tuple[np.ndarray, np.ndarray]:
    """Return density and labels of some boxes, in arrays that nobody else has."""
    rng = np.random.default_rng(0)
    labels = np.zeros((40, 44, 50), np.uint16)
    for i in range(1, 12):
        low = rng.integers(0, 30, 3)
        labels[tuple(slice(a, a + n) for a, n in zip(low, rng.integers(4, 14, 3), strict=True))] = i
    return (labels * 90 + 20 + rng.integers(0, 9, labels.shape)).astype(np.uint16), labels


def large_bag() -> tuple[np.ndarray, np.ndarray, Any]:
    """Return density and labels of many boxes in haze, and what shows them half transparent."""
    rng, shape = np.random.default_rng(0), (128, 128, 192)
    labels = np.zeros(shape, np.uint16)
    for i in range(1, 40):
        low = [rng.integers(0, n - 44) for n in shape]
        labels[tuple(slice(a, a + rng.integers(16, 44)) for a in low)] = i
    volume = (labels * 90 + 20 + rng.integers(0, 9, shape)).astype(np.uint16)
    look = TransferFunction([(0, 0.0), (100, 0.0), (600, 0.03), (4095, 0.03)])
    return volume, labels, look


def pairs_of(name: str) -> tuple[Callable[[], object], Callable[[], object]]:
    """Return a public function with the cast within it, on arrays of which nothing is kept."""
    volume, labels, look = large_bag()
    camera, shown = VIEW.camera(labels.shape, MM), np.arange(40) > 0
    at = {"view": VIEW, "size": LARGE, "backend": "cpu"}
    if name == "render":
        # Given its bricks: making them is part of what the public function adds.
        bricks, white = cpu.Bricks.of(labels, volume), np.ones((40, 4), np.float32)
        how = {"shading": Shading(), "bricks": bricks, "backend": "cpu"}
        return (
            lambda: rendering.render(volume[:], labels[:], transfer_function=look, **at),
            lambda: rendering.cast_tinted(
                volume[:], labels[:], MM, camera, look, white, LARGE, **how
            ),
        )
    # These take no longer than to look at every voxel once, as any first call must.
    if name == "ids":
        return (
            lambda: rendering.object_id_layers(labels[:], **at),
            lambda: rendering.cast_ids(
                labels[:], MM, camera, shown, LARGE, layers=2, bricks=cpu.Bricks.of(labels),
                backend="cpu",
            ),
        )  # fmt: skip
    return (
        lambda: rendering.occlusion_ratios(labels[:], **at),
        lambda: rendering.cast_occlusion(
            labels[:], MM, camera, shown, LARGE, bricks=cpu.Bricks.of(labels), backend="cpu"
        ),
    )


def seconds(work: Callable[[], object]) -> float:
    """Measure the processor time of all cores, of which other work takes none."""
    begun = process_time()
    work()
    return process_time() - begun


@pytest.mark.parametrize("name", ["render", "ids", "ratios"])
def test_a_first_call_takes_little_longer_than_its_cast_from_an_oblique_view(name: str) -> None:
    public, cast = pairs_of(name)
    seconds(public), seconds(cast)
    ratios = [seconds(public) / seconds(cast) for _ in range(7)]
    assert median(ratios) <= 1.3, ratios


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
