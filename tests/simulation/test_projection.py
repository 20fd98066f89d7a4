"""The scanner that counts photons: water is water, metal makes streaks, noise follows the dose."""

import numpy as np
import pytest

from napari_unpack import simulate_bag
from napari_unpack.simulation.projection import (
    ENERGIES,
    REFERENCE,
    WATER,
    ProjectionScanner,
    photoelectric_share,
)
from napari_unpack.simulation.tomography import ParallelBeam

SIDE = 96
Y, X = np.indices((SIDE, SIDE)) - (SIDE - 1) / 2
CORE = Y**2 + X**2 < 24**2


def cylinder(metal: bool = False, slices: int = 2) -> np.ndarray:
    """Water of 34 mm radius; with metal, two steel rods of 3.5 mm left and right."""
    plane = np.where(Y**2 + X**2 < 34**2, 1000.0, 0.0)
    if metal:
        for middle in (-18, 18):
            plane[Y**2 + (X - middle) ** 2 < 3.5**2] = 32000.0
    return np.repeat(plane[None], slices, axis=0).astype(np.float32)


def scanned(volume: np.ndarray, seed: int = 0, **settings: float) -> np.ndarray:
    return ProjectionScanner(**settings).scan(volume, np.random.default_rng(seed)).astype(float)


def test_water_is_water_from_rim_to_centre() -> None:
    found = scanned(cylinder(), photons=1e8)
    # Within 2 CT numbers everywhere but at the edge: hardening is corrected for water.
    assert found[:, CORE].mean() == pytest.approx(1000, abs=1)
    assert np.abs(found[:, CORE] - 1000).max() < 12
    middle = found[:, Y**2 + X**2 < 8**2].mean()
    rim = found[:, (Y**2 + X**2 > 20**2) & (Y**2 + X**2 < 28**2)].mean()
    assert rim - middle == pytest.approx(0, abs=2)
    assert found[:, Y**2 + X**2 > 40**2].mean() < 5


def test_metal_makes_a_dark_band_and_streaks() -> None:
    plain, streaked = scanned(cylinder()), scanned(cylinder(metal=True))
    between = (np.abs(Y) < 2) & (np.abs(X) < 12)
    assert streaked[:, between].mean() < plain[:, between].mean() - 100
    far = CORE & (np.abs(Y) > 8)
    assert streaked[:, far].std() > 1.3 * plain[:, far].std()


def test_noise_falls_with_the_root_of_the_dose() -> None:
    settings = {"electronic": 0.0}
    noise = [
        scanned(cylinder(slices=6), photons=dose, **settings)[:, CORE].std()
        for dose in (2000, 8000, 32000)
    ]
    assert noise[0] / noise[1] == pytest.approx(2, rel=0.1)
    assert noise[1] / noise[2] == pytest.approx(2, rel=0.1)


def test_a_seed_gives_one_scan_whatever_the_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", "1")
    one = scanned(cylinder(), seed=3)
    monkeypatch.setenv("NAPARI_UNPACK_THREADS", "3")
    assert np.array_equal(one, scanned(cylinder(), seed=3))
    assert not np.array_equal(one, scanned(cylinder(), seed=4))


def test_attenuation_by_energy_is_that_of_aluminium_and_steel() -> None:
    # CT numbers + 1000 at 60 and 80 keV against 70 (element tables of NIST).
    water = {60.0: 0.0206, 70.0: WATER[REFERENCE], 80.0: 0.01837}
    for value, at_60, at_80 in ((3221, 3644, 2966), (32000, 46100 / 33300 * 32000, 24513)):
        share = float(photoelectric_share(np.float32([value]))[0])
        for energy, wanted in ((60.0, at_60), (80.0, at_80)):
            growth = (ENERGIES[REFERENCE] / energy) ** 3 * water[70.0] / water[energy]
            assert value * (1 - share + share * growth) == pytest.approx(wanted, rel=0.02)
    assert photoelectric_share(np.float32([0, 500, 1000, 1299])).max() == 0


def test_a_disc_projects_to_its_chords_and_back() -> None:
    spacing = (0.5, 1.0)
    y, x = (np.indices((160, 80)) - np.array([79.5, 39.5])[:, None, None]) * np.array(spacing)[
        :, None, None
    ]
    disc = (y**2 + x**2 < 25**2).astype(np.float32)
    beam = ParallelBeam.around((160, 80), spacing)
    lines = beam.project(disc)
    s = (np.arange(beam.detectors) - (beam.detectors - 1) / 2) * beam.pitch
    chords = 2 * np.sqrt(np.maximum(25**2 - s**2, 0))
    # Each end of a chord lies within a pixel.
    assert np.abs(lines - chords)[:, np.abs(s) < 22].max() < 2
    inner = np.abs(s) < 22
    assert lines.mean(axis=0)[inner] == pytest.approx(chords[inner], abs=0.3)
    back = beam.reconstruct(lines, disc.shape)
    inside = y**2 + x**2 < 20**2
    assert back[inside].mean() == pytest.approx(1, abs=0.003)
    assert back[inside].std() < 0.02


def test_a_bag_scanned_by_rays_has_the_truth_of_one_scanned_plainly() -> None:
    size, count = (24, 64, 64), 4
    plain = simulate_bag(seed=5, shape=size, count=count)
    rays = simulate_bag(seed=5, shape=size, count=count, fidelity="projection")
    assert np.array_equal(plain.labels, rays.labels)
    assert rays.volume.dtype == np.uint16
    inside = plain.labels > 0
    assert np.corrcoef(plain.volume[inside], rays.volume[inside])[0, 1] > 0.8


@pytest.mark.parametrize(
    "settings", [{"photons": 0.0}, {"electronic": -1.0}, {"views": 0}, {"thickness": np.nan}]
)
def test_settings_that_cannot_be_are_named(settings: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(settings))):
        ProjectionScanner(**settings)
    with pytest.raises(ValueError, match="fidelity"):
        simulate_bag(fidelity="perfect")
