import numpy as np
import pytest
from phantoms import scanned

from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.segmentation.postprocessing.cables import gather_cables

SHAPE = (60, 64, 64)
# Cloth is matter here: its median lies four knees above air.
SCALE = DensityScale(0.0, 50.0)
CLOTH, WIRE, AIR = 200.0, 2500.0, 0.0


def coil(turns=5, radius=16.0, thread=1.3):
    """Return the mask of a helix along z about the middle of the volume."""
    t = np.linspace(0, 1, 4000)
    angle = 2 * np.pi * turns * t
    path = np.stack([8 + 44 * t, 32 + radius * np.sin(angle), 32 + radius * np.cos(angle)])
    grid = np.round(path).astype(int)
    mask = np.zeros(SHAPE, bool)
    reach = 2
    for z, y, x in np.unique(grid.T, axis=0):
        window = tuple(slice(c - reach, c + reach + 1) for c in (z, y, x))
        near = sum((g - reach) ** 2 for g in np.indices((5, 5, 5))) <= thread**2
        mask[window] |= near
    return mask


def scan(materials, seed=0):
    """Return the density of a volume of material numbers: 0 air, 1 cloth, 2 wire, 3 steel."""
    densities = {1: CLOTH, 2: WIRE, 3: 20000.0}
    present = {name: densities[name] for name in densities if name <= materials.max()}
    return scanned(materials, present, noise=10, seed=seed)


def cloth():
    mask = np.zeros(SHAPE, bool)
    mask[30:58, 4:60, 4:60] = True
    return mask


def test_a_coil_half_of_which_went_with_cloth_becomes_one_object():
    wire, around = coil(), cloth()
    volume = scan(np.where(wire, 2, np.where(around, 1, 0)))
    found = np.where(around, 2, np.where(wire, 1, 0)).astype(np.int32)
    before = (found[wire] == 1).mean()
    result = gather_cables(found, volume, SCALE)
    assert before < 0.6
    assert (result[wire] == 1).mean() > 0.85
    assert (result[around & ~wire] == 2).mean() > 0.9


def test_strands_that_nobody_has_go_with_their_coil():
    wire = coil()
    found = np.where(wire & (np.arange(SHAPE[0]) < 34)[:, None, None], 1, 0).astype(np.int32)
    result = gather_cables(found, scan(np.where(wire, 2, 0)), SCALE)
    assert (result[wire] == 1).mean() > 0.9
    assert (result[~wire] == 1).sum() < 0.8 * wire.sum()


@pytest.mark.parametrize("thing", ["rim", "steel", "cloth alone"])
def test_what_is_no_wire_stays_as_it_is(thing):
    grid = np.indices(SHAPE)
    radius = np.hypot(grid[1] - 32, grid[2] - 32)
    if thing == "rim":
        # A can of one material with a thick rim, which is a thread: it is the can's.
        can = (np.abs(radius - 18) <= 1) & (grid[0] > 10) & (grid[0] < 50)
        rim = (np.hypot(radius - 18, grid[0] - 50) <= 2) | (
            np.hypot(radius - 18, grid[0] - 10) <= 2
        )
        filling = (radius < 17) & (grid[0] > 10) & (grid[0] < 50)
        materials = np.where(can | rim, 2, np.where(filling, 1, 0))
        found = (materials > 0).astype(np.int32)
    elif thing == "steel":
        wire, around = coil(), cloth()
        materials = np.where(wire, 3, np.where(around, 1, 0))
        found = np.where(around, 2, np.where(wire, 1, 0)).astype(np.int32)
    else:
        materials, found = cloth().astype(int), cloth().astype(np.int32)
    np.testing.assert_array_equal(gather_cables(found, scan(materials), SCALE), found)


def test_bad_input_changes_nothing():
    empty = np.zeros((4, 4, 4), np.int32)
    np.testing.assert_array_equal(gather_cables(empty, np.full((4, 4, 4), np.nan)), empty)
    full = np.ones((1, 5, 9), np.int32)
    np.testing.assert_array_equal(gather_cables(full, np.arange(45.0).reshape(1, 5, 9)), full)


def test_a_strand_that_goes_on_in_the_coil_beside_it_joins_it():
    wire = coil()
    # From the fourth turn on the network took it for another thing.
    found = np.where(wire, np.where(np.arange(SHAPE[0]) < 36, 1, 2)[:, None, None], 0)
    result = gather_cables(found.astype(np.int32), scan(np.where(wire, 2, 0)), SCALE)
    assert (result[wire] == 1).mean() > 0.95


def test_a_cord_that_lies_beside_a_coil_stays_a_cord():
    z, y, x = np.indices(SHAPE)
    cord = (np.hypot(y - 32, x - 53) <= 1.3) & (z > 4) & (z < 56)
    wire = coil(radius=16.0) & ~cord
    volume = scan(np.where(wire | cord, 2, 0))
    found = np.where(cord, 2, np.where(wire, 1, 0)).astype(np.int32)
    result = gather_cables(found, volume, SCALE)
    assert (result[cord] == 2).mean() > 0.9
    assert (result[wire] == 1).mean() > 0.9
