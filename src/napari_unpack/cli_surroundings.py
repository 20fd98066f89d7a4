"""The options of the command line that say what is behind and around a picture."""

from __future__ import annotations

from typing import Annotated, Any

import typer

Ground = Annotated[
    str | None,
    typer.Option(
        "--background",
        help="dark, dusk, light, daylight, black, white, '#rrggbb', two of these with a comma "
        "between (top, bottom), or a picture's path.",
    ),
]
Box = Annotated[bool, typer.Option("--box", help="Draw the box around all objects.")]
Scale = Annotated[bool, typer.Option("--scale-bar", help="Draw a scale bar.")]


def wanted_surroundings(background: str | None, box: bool, scale: bool) -> Any:
    """Return the Surroundings asked for; None where nothing is, as a saved session has its own."""
    from napari_unpack.appearance import Surroundings

    shown = [kind for kind, wanted in (("box", box), ("scale", scale)) if wanted]
    if background is None and not shown:
        return None
    return Surroundings.of(background or "dark", shown)
