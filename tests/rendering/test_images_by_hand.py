"""8 x 8 x 8 voxels through the public functions, with numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

import napari_unpack as nu
from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.geometry.transforms import Pose
from napari_unpack.rendering import cast_ids


def test_equation_1_from_the_volume_to_the_edges_of_the_graph() -> None:
    # Looking along +x with one ray a voxel column: row = y, column = z (right is +z).
    #   1: y 0-1, z 0-1, x 0    in front, pixels (0-1, 0-1)
    #   2: y 0-1, z 4-5, x 7    in front on its pixels (0-1, 4-5)
    #   3: y 1-6, z 1, x 4      behind 1 on pixel (1, 1), in front on (2-6, 1)
    #   4: y 6-7, z 6-7, x 2    in front, pixels (6-7, 6-7)
    # Nearest pixels in the first layer: 1-2: (0, 1)-(0, 4), 3. 1-3: (1, 1)-(2, 1), 1.
    # 2-3: (1, 4)-(2, 1), sqrt(10) = 3.16. 2-4: (1, 5)-(6, 6), sqrt(26) = 5.10.
    # 3-4: (6, 1)-(6, 6), 5. 1-4: (1, 1)-(6, 6), sqrt(50) = 7.07.
    # The second layer holds 3 on pixel (1, 1), behind 1: 1-3 are 0 apart, 2-3 are
    # (1, 4)-(1, 1), 3 apart; nothing else changes.
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[0:2, 0:2, 0] = 1
    labels[4:6, 0:2, 7] = 2
    labels[1, 1:7, 4] = 3
    labels[6:8, 6:8, 2] = 4
    view = nu.View(direction=(0, 0, 1), height=8.0)
    ids = nu.object_id_layers(labels, view=view, layers=2, size=(8, 8), backend="cpu")
    assert ids[:, 1].tolist() == [[1, 1, 0, 0, 2, 2, 0, 0], [0, 3, 0, 0, 0, 0, 0, 0]]
    assert ids[0, 6].tolist() == [0, 3, 0, 0, 0, 0, 4, 4]

    def edges(distance: float, layers: int) -> set[tuple[int, int]]:
        return {(min(e), max(e)) for e in nu.interference(ids, distance, layers).edges}

    assert edges(0, 1) == set()
    assert edges(1, 1) == {(1, 3)}
    assert edges(3, 1) == {(1, 2), (1, 3)}
    assert edges(3.2, 1) == {(1, 2), (1, 3), (2, 3)}
    assert edges(5, 1) == {(1, 2), (1, 3), (2, 3), (3, 4)}
    assert edges(5.1, 1) == {(1, 2), (1, 3), (2, 3), (3, 4), (2, 4)}
    assert edges(7.08, 1) == {(1, 2), (1, 3), (2, 3), (3, 4), (2, 4), (1, 4)}
    assert edges(0, 2) == {(1, 3)}
    assert edges(2.9, 2) == {(1, 3)}
    assert edges(3, 2) == {(1, 2), (1, 3), (2, 3)}


@pytest.mark.parametrize(
    ("definition", "ratio_of_2", "ratio_of_3"),
    [("eq2", 3 / 8, 0.0), ("first_hit", 1 / 2, 0.0), ("exact", 3 / 8, 1 / 3)],
)
def test_equation_2_from_the_volume_to_the_ratios(definition, ratio_of_2, ratio_of_3) -> None:
    # Looking along +x, voxels of 2 x 1 x 1 mm, two rays a voxel along z and one along y.
    #   1: z 2, y 2, x 0: in front of 2 on one column.
    #   2: z 2-3, y 2, x 3-5 and, on z 3 only, x 6-7: columns of 3 and 5 samples, 8 in all;
    #      the 3 on column z 2 lie behind 1: eq. 2 gives 3/8; one column of two is hidden: 1/2.
    #   3: z 5, y 2, x 1-2 and x 7, with 4 between at x 4: 1 of its 3 samples behind another
    #      object, on a ray where it is first.
    # Twice the rays along z double all counts and change no ratio.
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[2, 2, 0] = 1
    labels[2:4, 2, 3:6] = 2
    labels[3, 2, 6:8] = 2
    labels[5, 2, [1, 2, 7]] = 3
    labels[5, 2, 4] = 4
    view = nu.View(direction=(0, 0, 1), height=8.0)
    found = nu.occlusion_ratios(
        labels, (2, 1, 1), view, definition, size=(8, 16), step=1.0, backend="cpu"
    )
    assert found == pytest.approx({1: 0.0, 2: ratio_of_2, 3: ratio_of_3, 4: 1.0})


def test_equations_3_and_4_from_the_volume_to_the_picture() -> None:
    # Voxels of 2 x 1 x 1 mm: the bag is 16 x 8 x 8 mm, its middle (7, 3.5, 3.5). Looking along
    # +x, camera space is (towards, down, right) = (-(x - 3.5), y - 3.5, z - 7).
    # The object fills z 2-3, y 4-5, x 1-2: o = (2.5, 4.5, 1.5) voxels, (5, 4.5, 1.5) mm,
    # V M o = (2, 1, -2). It shall go to u = (6, -1, 4): world (7 + 4, 3.5 - 1, 3.5 - 6)
    # = (11, 2.5, -2.5), voxels (5.5, 2.5, -2.5): t = (5.5 - 2.5, 2.5 - 4.5, -2.5 - 1.5).
    labels = np.zeros((8, 8, 8), np.uint16)
    labels[2:4, 4:6, 1:3] = 1
    spacing = (2.0, 1.0, 1.0)
    camera = nu.View(direction=(0, 0, 1), height=16.0).camera(labels.shape, spacing)
    u = np.array([6.0, -1.0, 4.0])
    moved = Pose(u, camera.rotation).world_from_world((5, 4.5, 1.5), camera)
    np.testing.assert_allclose(moved[:3, 3] / spacing, (3, -2, -4), atol=1e-12)
    # 16 x 16 pixels of 1 mm, the middle at 7.5: u is at row 6.5, column 11.5. The object is
    # 2 mm high and 4 mm wide: rows 6-7, columns 10-13.
    picture = cast_ids(
        labels, spacing, camera, np.array([False, True]), (16, 16),
        voxel_from_world=voxel_from_world(spacing) @ np.linalg.inv(moved), backend="cpu",
    )[0]  # fmt: skip
    rows, cols = np.nonzero(picture)
    assert sorted(set(rows.tolist())) == [6, 7]
    assert sorted(set(cols.tolist())) == [10, 11, 12, 13]
    assert len(rows) == 8
