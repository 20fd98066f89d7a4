"""Lengths and volumes as people are told them."""

import numpy as np
import pytest

from napari_unpack.geometry.length_unit import MICRO, MM, LengthUnit, density_text


def test_volumes_of_bags_are_in_cubic_centimetres_and_small_ones_in_what_they_are() -> None:
    bag, small = MM.volume_unit(25_000.0), MM.volume_unit(900.0)
    assert (bag.name, bag.text(25_000.0), bag.text(320.0)) == ("cm³", "25.0", "0.32")
    assert (small.name, small.text(900.0), small.text(0.0123)) == ("mm³", "900", "0.012")


def test_numbers_of_a_file_may_be_read_as_micrometres_or_converted() -> None:
    read, converted = LengthUnit(MICRO), LengthUnit(MICRO, 1000.0)
    assert read.edges([30.0, 6.2]) == "30 × 6"
    assert converted.edges([0.0302, 0.0062]) == "30 × 6"
    assert read.volume_unit(90.0).name == converted.volume_unit(90e-9).name == "µm³"
    assert converted.volume_unit(90e-9).text(90e-9) == "90.0"
    assert (read.true_mm, converted.true_mm, MM.true_mm) == (0.001, 1.0, 1.0)


def test_a_greek_mu_is_the_micro_sign() -> None:
    greek = LengthUnit("\N{GREEK SMALL LETTER MU}m", 1000.0)
    assert greek == LengthUnit("\N{MICRO SIGN}m", 1000.0)


def test_a_volume_in_voxels_is_their_number() -> None:
    spacing = (2.5, 0.3, 0.7)
    unit = LengthUnit.voxels(spacing)
    assert unit.volume_unit(0.0).text(1234 * float(np.prod(spacing))) == "1234"
    assert unit.edges([1.0]) == f"{1 / np.prod(spacing) ** (1 / 3):.1f}"


def test_small_lengths_keep_two_digits_of_the_longest() -> None:
    lengths = [31.4, 3.14, 0.314, 0.0314, 0.00314, 0.000314]
    told = ["31", "3.1", "0.31", "0.031", "0.0031", "0.00031"]
    assert [MM.edges([mm]) for mm in lengths] == told
    assert MM.edges([0.0012, 0.0003]) == "0.0012 × 0.0003"
    assert MM.edges([0.0]) == "0.000"
    # What is thin beside the longest is not told as nothing.
    assert MM.edges([42.0, 30.0, 0.4]) == "42 × 30 × 0.4"
    assert MM.edges([1200.0, 0.5, 0.00003, 0.0]) == "1200 × 0.5 × 0.00003 × 0"
    assert LengthUnit(MICRO, 1000.0).edges([0.03, 0.0004]) == "30 × 0.4"
    assert MM.edges([float("inf")]) == "inf"


def test_densities_of_scans_scaled_to_small_numbers_keep_two_digits() -> None:
    densities = [1500.4, 10.0, 9.87, 0.508, 0.031, 0.0, -1000.0, -0.25]
    told = ["1500", "10", "9.9", "0.51", "0.031", "0", "-1000", "-0.25"]
    assert [density_text(density) for density in densities] == told


def test_other_units_are_refused() -> None:
    with pytest.raises(ValueError, match="unit must be one of mm, µm, voxels, got 'inch'"):
        LengthUnit("inch")
    with pytest.raises(ValueError, match="per_mm must be a positive number, got 0"):
        LengthUnit("mm", 0)
