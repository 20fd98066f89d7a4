"""What a session keeps of its rays: fewer casts, the same counts."""

from __future__ import annotations

import numpy as np
import pytest

import napari_unpack.rendering
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cast_occlusion
from napari_unpack.session.ray_queries import RenderingQueries

MM = np.ones(3)


def test_rays_are_cast_once_a_direction_while_objects_leave(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    labels = np.random.default_rng(3).integers(0, 5, (3, 4, 5)).astype(np.uint16)
    labels = np.ascontiguousarray(np.kron(labels, np.ones((6, 6, 6), np.uint16)))
    casts: list[object] = []
    real = napari_unpack.rendering.cast_runs

    def counted(*arguments, known, **options):
        runs = real(*arguments, known=known, **options)
        casts.extend([runs] if runs is not known else [])
        return runs

    monkeypatch.setattr(napari_unpack.rendering, "cast_runs", counted)
    queries = RenderingQueries(labels, MM)
    cameras = [View(d).camera(labels.shape, MM) for d in ((0.2, 1, 0.1), (1, 0.3, 0.2))]
    hidden_casts = [((), 1), ((2,), 1), ((2, 4), 1), ((4,), 1), ((), 1)]
    for camera, before in zip(cameras, (0, 1), strict=True):
        for hidden, new in hidden_casts:
            visible = np.ones(5, bool)
            visible[[0, *hidden]] = False
            counts = queries.occlusion_counts(camera, visible, (24, 25), "cpu")
            anew = cast_occlusion(labels, MM, camera, visible, (24, 25), backend="cpu")
            for name in ("ids", "samples", "occluded_hits", "exact_samples", "blocks"):
                np.testing.assert_array_equal(getattr(counts, name), getattr(anew, name))
            assert len(casts) == before + new
    # Somebody comes back whom the last rays did not see.
    few, all_of_them = np.array([False, True, True, False, False]), np.array([False] + 4 * [True])
    queries.occlusion_counts(cameras[0], few, (24, 25), "cpu")
    queries.occlusion_counts(cameras[0], all_of_them, (24, 25), "cpu")
    assert len(casts) == 4
