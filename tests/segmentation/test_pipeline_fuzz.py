"""Whatever is given to `segment` ends in objects or in a sentence, never in a hang."""

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from napari_unpack.segmentation import segment
from napari_unpack.segmentation.foreground.methods import FOREGROUND_METHODS

FEW = settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
# Every type compiles its own kernels; these meet all ways in which types are treated.
TYPES = (np.uint16, np.float16, np.float64, np.bool_)
EDGE = st.integers(1, 14)


def check(found, volume):
    """Assert what must hold for every result."""
    labels, table = np.asarray(found.labels), found.objects
    counts = np.bincount(labels.reshape(-1))[1:]
    assert labels.shape == volume.shape
    assert labels.min() >= 0
    assert table.index.tolist() == list(range(1, len(counts) + 1))
    assert table.voxels.tolist() == counts.tolist()
    assert table.confidence.between(0, 1).all()
    if volume.dtype.kind == "f":
        assert np.isfinite(table[["volume_mm3", "z", "y", "x"]].to_numpy()).all()


def attempt(volume, spacing=(1.0, 1.0, 1.0), **options):
    """Segment; return None where it was refused with a sentence."""
    try:
        found = segment(volume, spacing, **options)
    except (ValueError, TypeError) as error:
        said = str(error)
    else:
        check(found, volume)
        return found
    assert len(said) > 20
    return None


@st.composite
def volumes(draw):
    """Draw a volume: blocks of any values on a background of any value, with holes in it."""
    shape = (draw(EDGE), draw(EDGE), draw(EDGE))
    dtype = np.dtype(draw(st.sampled_from(TYPES)))
    values = arrays.from_dtype(dtype, allow_nan=dtype.kind == "f")
    volume = np.full(shape, draw(values))
    for _ in range(draw(st.integers(0, 4))):
        box = tuple(
            slice(a, a + draw(st.integers(1, 10)))
            for a in (draw(st.integers(0, n - 1)) for n in shape)
        )
        volume[box] = draw(values)
    return volume


@FEW
@given(volumes(), st.sampled_from(FOREGROUND_METHODS), st.sampled_from([40, 10**7]))
def test_any_volume_of_any_type(volume, way, working):
    with np.errstate(all="ignore"):
        attempt(volume, smallest=5.0, foreground=way, working=working)


@FEW
@given(
    st.lists(
        st.one_of(st.floats(), st.sampled_from([0.0, -1.0, 1e-6, 1e6])), min_size=0, max_size=4
    )
)
def test_any_spacing(spacing):
    volume = np.zeros((10, 11, 12))
    volume[2:8, 2:8, 2:8] = 1000
    good = len(spacing) == 3 and all(np.isfinite(s) and s > 0 for s in spacing)
    if not good:
        with pytest.raises(ValueError, match="spacing must be three positive"):
            segment(volume, spacing)


@FEW
@given(st.one_of(st.floats(), st.integers(-5, 5), st.text(max_size=8), st.none()))
@example(3.5e38)
@example(-3.5e38)
def test_any_foreground(way):
    volume = np.random.default_rng(0).normal(0, 5, (12, 12, 12))
    volume[2:10, 2:10, 2:10] += 100
    attempt(volume, foreground=way)


@pytest.mark.parametrize(
    ("shape", "working"), [((1, 40, 50), 10**7), ((40, 1, 50), 500), ((1, 1, 300), 10**7)]
)
@pytest.mark.parametrize("way", FOREGROUND_METHODS)
def test_flat_and_thin_volumes(shape, working, way):
    volume = np.random.default_rng(0).normal(0, 5, shape)
    volume[..., 10:30] += 1000
    attempt(volume, foreground=way, working=working, smallest=50.0)


def test_a_single_voxel_is_too_small_and_says_so():
    volume = np.random.default_rng(0).normal(0, 5, (20, 20, 20))
    volume[10, 10, 10] = 1000
    with pytest.raises(ValueError, match="smallest="):
        segment(volume)


def test_one_object_fills_the_volume_but_for_a_corner():
    volume = np.full((24, 24, 24), 1000.0)
    volume[:3, :3, :3] = 0
    volume += np.random.default_rng(0).normal(0, 5, volume.shape)
    found = attempt(volume)
    assert found is None or len(found.objects) <= 2


@pytest.mark.parametrize("value", [1e300, 1e38, -1e300])
@pytest.mark.parametrize("working", [2_000, 10**7])
def test_huge_values_do_no_harm(value, working):
    volume = np.random.default_rng(0).normal(0, 10, (24, 24, 24))
    volume[6:18, 6:18, 6:18] = 1000
    volume[0, 0, 0] = value
    with np.errstate(all="ignore"):
        attempt(volume, working=working)


@pytest.mark.parametrize("ndim", [0, 1, 2, 4])
def test_other_numbers_of_axes_are_refused(ndim):
    with pytest.raises(ValueError, match="3 axes"):
        segment(np.zeros((4,) * ndim))
