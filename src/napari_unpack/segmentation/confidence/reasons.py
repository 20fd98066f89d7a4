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

# Deviations from those of usual objects below which a measure is as usual, whatever it lowered.
UNUSUAL = 1.0
# And from which more may be said of it than that it is less or more than usual.
EXTREME = 2.0

# What is said of measures below and above those of usual objects; several may say the same. Where
# there is nothing, that side is no fault: it lowers a confidence by what it goes along with.
_RAGGED = "its surface is smoother than usual", "its surface is rougher than usual"
_MIXED = "its densities are more even than usual", "its densities are more mixed than usual"
_STEPS = (
    "its inside has fewer steps of density than usual",
    "its inside has more steps of density than usual",
)
_EDGE = "its border stands out more than usual", "its border is fainter than usual"
_FORM = "it is rounder or fuller than usual", "it is longer or flatter than usual"
_FULL = "it fills its outline less than usual", "it fills its outline more than usual"
_THIN = "it is thinner than usual", "it is thicker than usual"
_LOBES = "", "it is more lobed than usual"
_DENSE = (
    "its least dense parts are lighter than usual",
    "its least dense parts are denser than usual",
)
_PEAK = "its densest parts are lighter than usual", "its densest parts are denser than usual"
_AROUND = "", "more around it is denser than usual"
_TWO = _MIXED[0], "it is more like two materials than usual"
_CORE = (
    "its core is lighter beside its rim than usual",
    "its core is denser beside its rim than usual",
)
_SIDES = (
    "its border is more alike all round than usual",
    "its border differs more from side to side than usual",
)
_BLUR = "its border is more blurred than usual", "its border is sharper than usual"
_WORDS: dict[str, tuple[str, str]] = {
    "log_volume": ("it is smaller than usual", "it is larger than usual"),
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
    "weak_boundary": ("", _EDGE[1]),
    "dense_boundary": _AROUND,
    "weak_plane": ("", "more of a flat side than usual ends where nothing else does"),
    "weighted_cut": (_EDGE[1], _EDGE[0]),
    "low_to_high_cut": _AROUND,
    "high_to_low_cut": (_EDGE[1], _EDGE[0]),
    "weighted_curvature": _RAGGED,
    "step_spread": _SIDES,
    "lowest": _DENSE,
    "highest": _PEAK,
    "core_over_rim": _CORE,
    "two_materials": _TWO,
    "material_cut": _TWO,
    "blur_index": _BLUR,
    "cut_over_volume": (_EDGE[1], _EDGE[0]),
    **dict.fromkeys(
        ("weighted_volume", "skew", "quartiles", "spread", "deviation", "core_quartiles"), _MIXED
    ),
    **dict.fromkeys((n for n in FEATURES if n.startswith(("l1_", "l2_", "core_l2"))), _STEPS),
    "rayleigh": _STEPS,
    "contrast": _STEPS,
}
_EXTREMES = {
    _WORDS["log_volume"][0]: "it is very small",
    _WORDS["log_volume"][1]: "it is very large",
    _RAGGED[1]: "its surface is ragged",
    _MIXED[1]: "its densities are mixed",
    _STEPS[1]: "its inside has steps of density",
    _EDGE[1]: "its border is faint",
    _FULL[0]: "it fills its outline poorly, as pieces or folds do",
    _LOBES[1]: "it comes apart into lobes, as joined things do",
    _PEAK[1]: "its densest parts are very dense",
    _AROUND[1]: "what is around it is denser",
    _WORDS["weak_plane"][1]: "a flat side is cut off where nothing ends",
    _TWO[1]: "it is of two materials",
    _BLUR[0]: "its border is blurred",
}


def reasons(oracle: Oracle, row: NDArray[np.float64]) -> tuple[str, ...]:
    """Say what lowered the confidence of an object; empty where it is high or nothing stands out.

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
    deviations = (row - oracle.center) / oracle.scale
    found: dict[str, str] = {}
    for k in np.argsort(-gains).tolist():
        if gains[k] < LEAST or len(found) == MOST:
            break
        below, above = _WORDS[FEATURES[k]]
        words, against = (above, below) if deviations[k] > 0 else (below, above)
        # The quartiles may be narrow and the tails wide: both at once would puzzle.
        if not words or words in found or against in found or abs(deviations[k]) < UNUSUAL:
            continue
        extreme = abs(deviations[k]) >= EXTREME
        found[words] = _EXTREMES.get(words, words) if extreme else words
    return tuple(found.values())
