from pathlib import Path
from time import sleep

import numpy as np
import pytest
from phantoms import box, packed, scanned

from napari_unpack.segmentation import score, segment
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.foreground.methods import ForegroundOptions, KnownScale
from napari_unpack.segmentation.foreground.thresholds import Levels
from napari_unpack.segmentation.learned import boundary_network
from napari_unpack.segmentation.learned.affinity_linkage import (
    LinkageThreshold,
    mean_affinity_linkage,
)
from napari_unpack.segmentation.learned.boundary_network import (
    BoundaryNetwork,
    Prediction,
    default_boundaries,
)
from napari_unpack.segmentation.learned.fragments import FragmentAffinities, measure_affinities
from napari_unpack.segmentation.learned.method import find_objects, oversegment
from napari_unpack.simulation import simulate_bag

SCALE = DensityScale(0.0, 200.0)


def silent(fraction, text):
    pass


def two_boxes():
    """Return boxes of one density, pressed together, one standing over the other's edge."""
    shape = (56, 56, 88)
    truth = np.zeros(shape, np.int32)
    truth[box(shape, (10, 12, 10), (40, 44, 44))] = 1
    truth[box(shape, (22, 6, 44), (46, 34, 76))] = 2
    return truth


@pytest.mark.parametrize("seed", [0, 1])
def test_packed_superquadrics_are_found(seed):
    truth, densities = packed(seed, (72, 80, 96), 8)
    result = score(truth, segment(scanned(truth, densities, seed=seed), method="learned").labels)
    assert result["f1"] >= 0.9
    assert result["voi"] <= 0.2


def test_the_network_says_the_same_twice():
    volume = scanned(two_boxes(), {1: 1000, 2: 1000})
    one, two = (default_boundaries().predict(volume, SCALE, silent) for _ in range(2))
    for a, b in zip(
        (one.foreground, one.next, one.far), (two.foreground, two.next, two.far), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_tiles_agree_with_the_whole():
    truth = two_boxes()
    volume = scanned(truth, {1: 1000, 2: 400})
    whole = default_boundaries().predict(volume, SCALE, silent)
    tiled = default_boundaries().predict(volume, SCALE, silent, tile=16)
    assert np.abs(whole.foreground.astype(int) - tiled.foreground).mean() < 5
    inside = truth > 0
    assert np.abs(whole.next.astype(int) - tiled.next)[:, inside].mean() < 5


class Echo:
    """A network that says what it is shown."""

    def __init__(self):
        self.shown = []

    def run(self, names, feed, options):
        cells = feed["cells"][0]
        self.shown.append(cells.shape[1:])
        said = np.zeros((boundary_network.CHANNELS, *cells.shape[1:]), np.uint8)
        said[:8] = np.rint(np.expm1(cells) * 100)
        return [said[None]]


def test_every_voxel_is_seen_once_and_in_its_place():
    volume = np.random.default_rng(0).integers(0, 250, (51, 54, 49)).astype(np.uint8)
    said = BoundaryNetwork(Echo()).predict(volume, DensityScale(0.0, 100.0), silent, tile=8)
    np.testing.assert_array_equal(said.foreground, volume)


def test_an_axis_is_cut_only_where_it_is_longer_than_what_a_middle_tile_sees():
    # Tiles of 8 cells see 8 more on both sides: 24 cells are one tile, 25 are four.
    network = Echo()
    volume = np.zeros((48, 50, 20), np.uint8)
    BoundaryNetwork(network).predict(volume, DensityScale(0.0, 100.0), silent, tile=8)
    assert [shape[0] for shape in network.shown] == [24] * 4
    assert [shape[1] for shape in network.shown] == [16, 24, 24, 16]
    assert [shape[2] for shape in network.shown] == [16] * 4


def test_a_damaged_or_foreign_network_is_refused(tmp_path):
    good = (
        Path(boundary_network.__file__).parents[1] / "weights" / "boundary_network.onnx"
    ).read_bytes()
    for content in (b"", good[: len(good) // 2], b"not a network"):
        path = tmp_path / "net.onnx"
        path.write_bytes(content)
        with pytest.raises(ValueError, match="not a boundary network"):
            BoundaryNetwork.load(path)
    with pytest.raises(FileNotFoundError):
        BoundaryNetwork.load(tmp_path / "none.onnx")


@pytest.mark.parametrize("shape", [(1, 1, 2), (3, 5, 4), (1, 40, 40)])
def test_tiny_and_flat_volumes_are_looked_at(shape):
    said = default_boundaries().predict(np.full(shape, np.nan), SCALE, silent)
    assert said.foreground.shape == shape
    assert said.next.shape == (3, *shape)


def test_cancelling_ends_the_run_of_a_tile():
    class Endless:
        """A network that runs until it is told to end, as onnxruntime does."""

        ended = False

        def run(self, names, feed, options):
            while not options.terminate:
                sleep(0.01)
            self.ended = True
            raise RuntimeError("terminated")

    def cancel(fraction, text):
        # While the tile runs, not before it.
        if fraction > 0:
            raise KeyboardInterrupt

    network = Endless()
    with pytest.raises(KeyboardInterrupt):
        BoundaryNetwork(network).predict(np.zeros((16, 16, 16)), SCALE, cancel)
    assert network.ended


def test_progress_is_told_and_raising_in_it_cancels():
    volume = scanned(two_boxes(), {1: 1000, 2: 1000})

    def cancel(fraction, text):
        if text.startswith("Predicting"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        segment(volume, progress=cancel, method="learned")


def test_fragments_join_by_the_mean_and_long_reaches_hold_apart():
    # 1 and 2 belong together; 3 leaks into 2, but from 1 it is far apart.
    ties = FragmentAffinities(
        np.array([[1, 2], [1, 3], [2, 3]]),
        np.array([[45.0, 45.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [6.0, 6.0, 0.0, 0.0]]),
        np.array([[50.0, 50.0, 0.0, 0.0], [0.0, 100.0, 0.0, 0.0], [10.0, 10.0, 0.0, 0.0]]),
    )
    sizes = np.array([0, 1000, 1000, 1000])
    owner = mean_affinity_linkage(ties, sizes, LinkageThreshold())
    assert owner[1] == owner[2] != owner[3]
    # Without what is known from afar, the leak decides.
    leak = FragmentAffinities(*(part[[0, 2]] for part in (ties.pairs, ties.sums, ties.counts)))
    owner = mean_affinity_linkage(leak, sizes, LinkageThreshold())
    assert owner[1] == owner[2] == owner[3]


def test_ties_are_what_counting_by_hand_gives():
    rng = np.random.default_rng(0)
    fragments = rng.integers(0, 4, (4, 5, 14)).astype(np.int32)
    far = rng.integers(0, 256, (12, 4, 5, 14)).astype(np.uint8)
    wanted: dict = {}
    for k, reach in enumerate(boundary_network.REACHES):
        for axis in range(3):
            for cell in np.ndindex(fragments.shape):
                other = tuple(c + reach * (a == axis) for a, c in enumerate(cell))
                if other[axis] >= fragments.shape[axis]:
                    continue
                a, b = sorted((int(fragments[cell]), int(fragments[other])))
                if a and a != b:
                    row = wanted.setdefault((a, b), np.zeros((2, 4)))
                    row[:, k] += far[(3 * k + axis, *cell)] / 255, 1
    ties = measure_affinities(fragments, far)
    assert [tuple(p) for p in ties.pairs.tolist()] == sorted(wanted)
    for pair, sums, counts in zip(ties.pairs.tolist(), ties.sums, ties.counts, strict=True):
        np.testing.assert_allclose(wanted[tuple(pair)], [sums, counts])
    np.testing.assert_array_equal(ties.touching, ties.counts[:, 0])


def test_the_bar_rises_with_size():
    assert LinkageThreshold().at(1000) == pytest.approx(0.25)
    assert LinkageThreshold().at(10_000) == pytest.approx(0.40)
    assert LinkageThreshold().at(1) == pytest.approx(0.05)
    assert LinkageThreshold().at(1e9) == pytest.approx(0.6)


class Says(BoundaryNetwork):
    """Predict that all voxels belong together, and of each how likely it is an object's."""

    def __init__(self, foreground):
        self.foreground = foreground

    def predict(self, density, scale, progress, tile=0):
        cells = tuple((n + 1) // 2 for n in density.shape)
        together = 3 * len(boundary_network.REACHES)
        return Prediction(
            np.rint(255 * self.foreground).astype(np.uint8),
            np.full((3, *density.shape), 255, np.uint8),
            np.full((together, *cells), 255, np.uint8),
        )


@pytest.mark.parametrize(("shell", "objects"), [(True, 1), (False, 2)])
def test_a_part_that_takes_in_what_the_network_doubts_is_the_bag_if_thin(shell, objects):
    shape = (40, 48, 56)
    block, sheet = box(shape, (6, 8, 8), (24, 40, 48)), box(shape, (31, 4, 4), (36, 44, 52))
    foreground = block.astype(float)
    # By its three middle layers 0.52, as a part; with the two beside them 0.31.
    foreground[32:35, 4:44, 4:52] = np.array([0.4, 0.75, 0.4])[:, None, None]
    density = np.where(block | sheet, 1000.0, 0.0)
    options = ForegroundOptions(shell=shell)
    labels = find_objects(density, (1.0,) * 3, silent, options, network=Says(foreground))
    assert labels[sheet].any() == (not shell)
    assert (labels[block] > 0).mean() > 0.9
    assert len(np.unique(labels)) == 1 + objects


@pytest.mark.parametrize("whole", [True, False])
def test_a_hard_case_is_no_object_but_in_a_block_it_may_be_a_carton(whole):
    shape = (64, 72, 80)
    case = box(shape, (4, 4, 4), (60, 68, 76)) & ~box(shape, (6, 6, 6), (58, 66, 74))
    things = [box(shape, (16, 12 + k, 20), (40, 20 + k, 60)) for k in (0, 14, 28, 40)]
    every = np.logical_or.reduce([case, *things])
    density = np.where(every, 1000.0, 0.0)
    known = None if whole else KnownScale(Levels(0.0, 1.0, 200.0, 300.0), 250.0)
    options = ForegroundOptions(known=known)
    found = oversegment(density, (1.0,) * 3, silent, options, Says(every.astype(float)))
    assert (found.parts[case] > 0).any() == (not whole)
    assert all((found.parts[thing] > 0).all() for thing in things)


def test_small_bags_are_found_well():
    results = []
    for seed in (1010, 1012):
        bag = simulate_bag(seed=seed, shape=(64, 72, 96), count=7)
        results.append(score(bag.labels, segment(bag.volume, bag.spacing).labels))
    mean = {name: np.mean([r[name] for r in results]) for name in ("f1", "voi", "count_error")}
    assert mean["f1"] >= 0.7
    assert mean["voi"] <= 0.4
    assert mean["count_error"] <= 0.15
