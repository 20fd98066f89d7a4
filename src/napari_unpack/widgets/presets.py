"""The names under which transfer functions are offered."""

from __future__ import annotations

from typing import Any

AUTOMATIC = "Automatic"
CUSTOM = "My own curve"
PRESETS = {
    "All matter": "all",
    "Soft: cloth to water": "soft",
    "Dense: solids": "dense",
    "Metal": "metal",
}
"""Names here to names in `appearance.TransferFunction.preset`, all for CT numbers."""


def transfer_function(name: str, volume: Any) -> Any:
    """Make the transfer function of a name.

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
        If there is no such name, or nothing can be fitted to the volume.
    """
    from napari_unpack.appearance import TransferFunction

    if name == AUTOMATIC:
        return TransferFunction.default_for(volume)
    if name not in PRESETS:
        raise ValueError(f"no transfer function {name!r}: choose one of {', '.join(PRESETS)}")
    return TransferFunction.preset(PRESETS[name])
