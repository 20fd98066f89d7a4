"""Colours for those who confuse red and green, judged by two published simulations."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from skimage.color import rgb2lab

from napari_unpack.appearance import (
    assign_hues,
    color_classes,
    perceptual_to_rgb,
    safe_to_rgb,
    tints_of,
)

# Linear RGB: Machado et al. 2009, severity 1; Vienot et al. 1999.
MACHADO = {
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
}
VIENOT = {
    "protan": [[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]],
    "deutan": [[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]],
}
EYES = [*MACHADO.values(), *VIENOT.values()]


def seen(srgb: np.ndarray, matrix: list[list[float]]) -> np.ndarray:
    """CIELAB of what a dichromat sees."""
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear @ np.array(matrix).T, 0, 1)
    return rgb2lab(
        np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    )


def least_difference(to_rgb, matrix, apart: float) -> float:
    """Smallest CIE 1976 difference of two colours whose hues are at least so far apart."""
    colors = seen(to_rgb(np.arange(360) / 360), matrix)
    steps = range(int(np.ceil(apart * 360)), 181)
    return min(np.linalg.norm(np.roll(colors, -k, 0) - colors, axis=1).min() for k in steps)


@pytest.mark.parametrize("matrix", EYES)
@pytest.mark.parametrize(("apart", "difference"), [(0.05, 9), (0.08, 14), (0.2, 30)])
def test_hues_apart_on_the_ring_are_apart_to_dichromats(matrix, apart, difference):
    assert least_difference(safe_to_rgb, matrix, apart) >= difference


@pytest.mark.parametrize("matrix", EYES)
def test_the_even_ring_would_not_do(matrix):
    assert least_difference(perceptual_to_rgb, matrix, 0.08) < 5


def test_the_ring_is_in_gamut_and_closes_without_a_seam():
    rgb = safe_to_rgb(np.linspace(0, 1, 400, endpoint=False))
    assert rgb.min() >= 0
    assert rgb.max() <= 1
    assert np.abs(np.roll(rgb, -1, 0) - rgb).max() < 0.03


@pytest.mark.parametrize("matrix", EYES)
def test_interfering_objects_differ_to_dichromats(matrix):
    places = nx.random_geometric_graph(60, 0.16, seed=2)
    graph = nx.relabel_nodes(places, lambda node: node + 1)
    hues = assign_hues(graph, margin=0.5)
    apart = 0.5 / len(color_classes(graph))
    assert apart >= 0.05
    colors = seen(tints_of(hues, 60, mode="safe")[:, :3].astype(float), matrix)
    assert min(np.linalg.norm(colors[a] - colors[b]) for a, b in graph.edges) >= 9
