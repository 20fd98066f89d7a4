import cc3d
import numpy as np
import pytest

from napari_unpack.simulation.catalogue import BUILDERS, KINDS
from napari_unpack.simulation.planning import plan
from napari_unpack.simulation.rasterizing import rasterize

CUBE = np.ones(3)
MODELLED = [kind for kind in KINDS if kind.build is not None]


def raster_of(build, seed, length, wall=1.6):
    thing = build(np.random.default_rng(seed), length, wall)
    return rasterize(thing.clay, np.eye(3), CUBE)


@pytest.mark.parametrize("kind", MODELLED, ids=lambda kind: kind.name)
def test_every_kind_is_one_piece_as_long_as_was_asked(kind):
    for seed in (0, 1):
        raster = raster_of(kind.build, seed, 64.0)
        _, pieces = cc3d.connected_components(raster.inside, connectivity=26, return_N=True)
        assert pieces == 1
        used = np.nonzero(raster.inside)
        assert 0.8 * 64 < max(np.ptp(axis) + 1 for axis in used) < 1.12 * 64


@pytest.mark.parametrize("kind", MODELLED, ids=lambda kind: kind.name)
def test_the_paint_lies_within_the_object(kind):
    raster = raster_of(kind.build, 0, 48.0)
    stray = raster.density[~raster.inside].sum()
    assert stray < 0.25 * raster.density.sum()
    assert raster.grams > 0


def test_all_kinds_are_packed_sooner_or_later():
    packed = {
        order.kind.name
        for seed in range(12)
        for order in plan(np.random.default_rng(seed), 30, (60, 60, 60), CUBE)
    }
    assert packed == {kind.name for kind in KINDS}


@pytest.mark.parametrize("count", [1, 2, 7, 30])
def test_a_plan_counts_what_containers_hold(count):
    orders = plan(np.random.default_rng(3), count, (60, 60, 60), CUBE)
    assert sum(1 + order.inside for order in orders) == count


def test_a_bottle_is_one_object_of_water_and_air_above_it():
    seed = next(s for s in range(50) if _name(BUILDERS["bottle"], s) == "water bottle")
    raster = raster_of(BUILDERS["bottle"], seed, 100.0)
    middle = raster.inside.shape[0] // 2, raster.inside.shape[2] * 7 // 10
    column = raster.density[middle[0], :, middle[1]]
    inside = raster.inside[middle[0], :, middle[1]]
    rows = np.flatnonzero(inside)
    assert (np.diff(rows) == 1).all()
    core = column[rows[3] : rows[-1] - 3]
    air, water = core < 50, np.abs(core - 1000) < 1
    assert air.sum() >= 3
    assert water.sum() >= 8
    assert np.flatnonzero(air).max() < np.flatnonzero(water).min()


def test_water_stays_level_however_the_bottle_is_turned():
    from napari_unpack.simulation.clay import turned

    seed = next(s for s in range(50) if _name(BUILDERS["bottle"], s) == "water bottle")
    thing = BUILDERS["bottle"](np.random.default_rng(seed), 80.0, 1.6)
    raster = rasterize(thing.clay, turned("z", 30.0), CUBE)
    water = np.abs(raster.density - 1000) < 1
    air = raster.inside & (raster.density < 5)
    shore = water & (np.roll(air, 1, 1) | np.roll(air, 2, 1))
    assert shore.sum() > 300
    assert np.ptp(np.nonzero(shore)[1]) <= 1


def test_a_boot_is_open_and_its_shaft_is_not_part_of_it():
    raster = raster_of(BUILDERS["boot"], 0, 100.0)
    opening = raster.inside[raster.inside.shape[0] // 2, 12]
    leather = np.flatnonzero(opening)
    gap = np.diff(leather).max()
    assert gap > 20


def test_a_closed_carton_owns_the_air_inside():
    for seed in range(40):
        thing = BUILDERS["carton"](np.random.default_rng(seed), 60.0, 1.6)
        if thing.room is not None:
            break
    raster = rasterize(thing.clay, np.eye(3), CUBE)
    middle = tuple(n // 2 for n in raster.inside.shape)
    assert raster.inside[middle]
    assert raster.density[middle] < 5


def test_edges_are_antialiased():
    raster = raster_of(BUILDERS["ball"], 0, 60.0)
    partial = (raster.density > 50) & (raster.density < 800)
    assert partial.sum() > 1000


def _name(build, seed):
    return build(np.random.default_rng(seed), 50.0, 1.6).name
