"""Simulated nuclei: whole, touching, seen as light, and the same for one seed."""

from typing import Any

import cc3d
import numpy as np
import pytest

from napari_unpack.simulation.nuclei import RADIUS, Nuclei, simulate_nuclei


@pytest.fixture(scope="module")
def made() -> Nuclei:
    return simulate_nuclei(seed=3)


def test_every_nucleus_is_one_piece_of_about_its_size(made: Nuclei) -> None:
    ids, counts = np.unique(made.labels[made.labels > 0], return_counts=True)
    assert ids.tolist() == list(range(1, 61))
    assert cc3d.connected_components(made.labels, connectivity=6).max() == 60
    volumes = counts * np.prod(made.spacing)
    ball = 4 / 3 * np.pi * RADIUS**3
    assert np.median(volumes) == pytest.approx(ball, rel=0.2)
    # Half axes are 0.75 to 1.25 of radii of 0.85 to 1.15; neighbours may take a part.
    assert volumes.min() > 0.1 * ball
    assert volumes.max() < (1.25 * 1.15) ** 3 * ball


def test_some_nuclei_touch(made: Nuclei) -> None:
    pairs = set()
    for axis in range(3):
        a = np.moveaxis(made.labels, axis, 0)[:-1]
        b = np.moveaxis(made.labels, axis, 0)[1:]
        meet = (a != b) & (a > 0) & (b > 0)
        pairs |= {frozenset(pair) for pair in zip(a[meet].tolist(), b[meet].tolist(), strict=True)}
    assert 5 < len(pairs) < 60


def test_nuclei_are_bright_and_those_in_the_depth_less_so(made: Nuclei) -> None:
    inside = made.labels > 0
    assert made.volume[inside].mean() > 5 * made.volume[~inside].mean()
    near, deep = made.volume[:20][inside[:20]], made.volume[-20:][inside[-20:]]
    assert deep.mean() < 0.9 * near.mean()


def test_one_seed_is_one_embryo_and_another_another() -> None:
    small = {"shape": (24, 48, 48), "count": 5}
    first, again, other = (simulate_nuclei(seed, **small) for seed in (1, 1, 2))
    assert (first.volume == again.volume).all()
    assert (first.labels == again.labels).all()
    assert (first.labels != other.labels).any()


def test_a_volume_without_room_is_refused() -> None:
    with pytest.raises(ValueError, match="holds no nucleus"):
        simulate_nuclei(shape=(4, 4, 4))


@pytest.mark.parametrize("count", [-3, 0, 2**16])
def test_a_number_of_nuclei_that_cannot_be_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match=f"count must be from 1 to 65535, got {count}"):
        simulate_nuclei(shape=(24, 48, 48), count=count)


@pytest.mark.parametrize("spacing", [(np.nan, 1, 1), (0, 1, 1), 1.0])
def test_a_spacing_that_is_none_is_refused(spacing: Any) -> None:
    with pytest.raises(ValueError, match="spacing must be three positive numbers"):
        simulate_nuclei(shape=(24, 48, 48), count=1, spacing=spacing)
