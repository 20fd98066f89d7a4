"""Transfer functions by name, for CT numbers."""

from __future__ import annotations

from typing import Any

AUTOMATIC = "Automatic"
PRESETS: dict[str, tuple[tuple[float, float], ...]] = {
    "All matter": ((0, 0.0), (150, 0.0), (500, 0.05), (1200, 0.2), (4095, 0.5)),
    "Soft": ((0, 0.0), (150, 0.0), (350, 0.06), (900, 0.08), (1150, 0.0), (4095, 0.0)),
    "Dense": ((0, 0.0), (1000, 0.0), (1400, 0.12), (4095, 0.5)),
    "Metal": ((0, 0.0), (2400, 0.0), (3000, 0.4), (4095, 0.8)),
}
"""(density, opacity per voxel); density is CT number + 1000."""


def preset(name: str, volume: Any) -> Any:
    """Make a transfer function by name.

    Parameters
    ----------
    name : str
        `AUTOMATIC`, or a key of `PRESETS`.
    volume : (Z, Y, X) ndarray
        What the automatic one is fitted to.

    Returns
    -------
    napari_unpack.TransferFunction

    Raises
    ------
    ValueError
        If there is no such preset.
    """
    from napari_unpack.appearance import TransferFunction

    if name == AUTOMATIC:
        return TransferFunction.default_for(volume)
    if name not in PRESETS:
        raise ValueError(f"no preset {name!r}: choose one of {', '.join(PRESETS)}")
    return TransferFunction(list(PRESETS[name]))
