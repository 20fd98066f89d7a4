"""Why a confidence is low, in words: the measures that lowered it most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from napari_unpack.segmentation.confidence.features import FEATURES
from napari_unpack.segmentation.confidence.oracle import Oracle

# Log odds by which a measure must have lowered a confidence to be named; 0.5 takes 0.5 to 0.38.
LEAST = 0.5
# Confidences from here on are not explained: nothing of note lowered them.
HIGH = 0.8
# Reasons at most.
MOST = 3

# What is said of measures below and above those of usual objects; several may say the same.
_RAGGED = "its surface is smoother than usual", "its surface is ragged"
_MIXED = "its densities are more even than usual", "its densities are mixed"
_STEPS = "its inside has fewer steps of density than usual", "its inside has steps of density"
_EDGE = "its border stands out more than usual", "its border is faint"
_FORM = "it is rounder or fuller than usual", "it is longer or flatter than usual"
_FULL = "it fills its outline poorly, as pieces or folds do", "it fills its outline fully"
_THIN = "it is thinner than usual", "it is thicker than usual"
_LOBES = "it is less lobed than usual", "it comes apart into lobes, as joined things do"
_DENSE = "its least dense parts are light", "its least dense parts are dense"
_PEAK = "its densest parts are light", "its densest parts are very dense"
_WORDS: dict[str, tuple[str, str]] = {
    "log_volume": ("it is very small", "it is very large"),
    "compactness": _RAGGED,
    "solidity": _FULL,
    "box_fill": _FULL,
    "ellipsoid_fill": _FULL,
    "elongation": _FORM,
    "flatness": _FORM,
    "thickness": _THIN,
    "depth_ratio": _THIN,
    "shell_share": (_THIN[1], _THIN[0]),
    "total_curvature": _RAGGED,
    "roughness": _RAGGED,
    "lobes_30": _LOBES,
    "lobes_60": _LOBES,
    "weak_boundary": _EDGE,
    "dense_boundary": ("it is denser than all around it", "what is around it is denser"),
    "weak_plane": ("it is cut off nowhere", "a flat side is cut off where nothing ends"),
    "weighted_cut": (_EDGE[1], _EDGE[0]),
    "low_to_high_cut": ("it is denser than all around it", "what is around it is denser"),
    "high_to_low_cut": (_EDGE[1], _EDGE[0]),
    "weighted_curvature": _RAGGED,
    "step_spread": ("its border is alike all round", "its border differs from side to side"),
    "lowest": _DENSE,
    "highest": _PEAK,
    "core_over_rim": ("its core is lighter than its rim", "its core is denser than its rim"),
    "two_materials": (_MIXED[0], "it is of two materials"),
    "material_cut": (_MIXED[0], "it is of two materials"),
    "blur_index": ("its border is blurred", "its border is sharper than usual"),
    "cut_over_volume": (_EDGE[1], _EDGE[0]),
    **dict.fromkeys(
        ("weighted_volume", "skew", "quartiles", "spread", "deviation", "core_quartiles"), _MIXED
    ),
    **dict.fromkeys((n for n in FEATURES if n.startswith(("l1_", "l2_", "core_l2"))), _STEPS),
    "rayleigh": _STEPS,
    "contrast": _STEPS,
}


def reasons(oracle: Oracle, row: NDArray[np.float64]) -> tuple[str, ...]:
    """Say what lowered the confidence of an object; empty where it is high.

    Parameters
    ----------
    oracle : Oracle
        That gave the confidence.
    row : (F,) ndarray of float64
        The object's features.
    """
    # Each measure in turn is made that of a usual object; what then rises was held down by it.
    usual = np.tile(row, (1 + len(row), 1))
    np.fill_diagonal(usual[1:], oracle.center)
    scores = np.clip(oracle.scores(usual), 1e-12, 1 - 1e-12)
    if scores[0] >= HIGH:
        return ()
    odds = np.log(scores / (1 - scores))
    gains = odds[1:] - odds[0]
    found: dict[str, None] = {}
    for k in np.argsort(-gains).tolist():
        if gains[k] < LEAST or len(found) == MOST:
            break
        above = int(row[k] > oracle.center[k])
        words = _WORDS[FEATURES[k]]
        # The quartiles may be narrow and the tails wide: both at once would puzzle.
        if words[1 - above] not in found:
            found[words[above]] = None
    return tuple(found)
