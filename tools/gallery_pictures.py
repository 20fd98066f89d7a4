"""Pictures for docs/gallery that need no window: what hues, layers and opacities do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from napari_unpack.appearance import PRESETS, Decorations, TransferFunction, tints_of
from napari_unpack.geometry.view import View
from napari_unpack.rendering import cast_ids
from napari_unpack.rendering.compose import scene_image
from napari_unpack.rendering.image_patch import compose
from napari_unpack.rendering.object_casting import Appearance, cast_subvolume
from napari_unpack.rendering.scene import LIGHT
from napari_unpack.session import Session

ImageTexture = NDArray[np.float32]
SIDE = 392
FINE = 0.5
CAPTION = 34
GROUND = Decorations.of("dusk")
CAPTIONS = (0.86, 0.88, 0.92)


def draw(session: Any, name: str, gallery: Path, bag_is_ct: bool = True) -> Iterator[Path]:
    """Write a bag's pictures, one file after the other.

    Parameters
    ----------
    session : Session
        With its view; shown from closer than its camera.
    name : str
        Begins the files' names.
    gallery : Path
        Folder.
    bag_is_ct : bool
        Whether its densities are CT numbers + 1000, which the presets are made for.
    """
    session.recolor()
    panels: dict[str, list[tuple[str, Callable[[], ImageTexture]]]] = {
        "hues": [
            ("untinted", lambda: _tinted(session, _white(session))),
            ("random hues", lambda: _tinted(session, _random(session))),
            ("hues of this view", lambda: _tinted(session, session.packed_tints())),
        ],
        "layers": [(f"object-ID layer {k + 1}", lambda k=k: _layer(session, k)) for k in range(3)],
        "modes": [
            ("even hues", lambda: _in_mode(session, "perceptual")),
            ("colour-blind safe", lambda: _in_mode(session, "safe")),
            ("vivid, as in the paper", lambda: _in_mode(session, "hsv")),
        ],
        "isolate": [
            ("everything", lambda: _tinted(session, session.packed_tints())),
            ("five isolated", lambda: _isolated(session, 5)),
            ("one isolated", lambda: _isolated(session, 1)),
        ],
        "backgrounds": [
            ("two colours" if "," in words else words, lambda words=words: _before(session, words))
            for words in ("dark", "daylight", "#5b2a4a,#e2a36b")
        ],
    }
    if bag_is_ct:
        panels["opacity"] = [(preset, lambda p=preset: _through(session, p)) for preset in PRESETS]
    else:
        panels["opacity"] = [
            ("as opened", lambda: _tinted(session, session.packed_tints())),
            *(
                (f"the densest {share:.0%}", lambda share=share: _densest(session, share))
                for share in (0.4, 0.1, 0.03)
            ),
        ]
    for part, pictures in panels.items():
        path = gallery / f"{name}-{part}.png"
        save(np.hstack([captioned(make(), words) for words, make in pictures]), path)
        yield path
    path = gallery / f"{name}-sides.png"
    save(_from_three_sides(session), path)
    yield path


def open_session_on(
    volume: Any, labels: Any, spacing: Any, direction: tuple[float, float, float]
) -> Session:
    """Return a session whose camera just holds the bag."""
    session = Session(volume, labels, spacing)
    session.backend = "cpu"
    session.canvas_size = (SIDE, SIDE)
    _frame(session, View(direction))
    return session


def _frame(session: Any, view: View) -> None:
    """Look at the bag along a view from where it just fits."""
    session.view = view
    boxes, mm = session.boxes, np.asarray(session.spacing)
    corners = np.concatenate([boxes.corners(i, mm) for i in session.ids])
    camera = session.camera
    flat = corners @ camera.rotation[1:].T
    low, high = flat.min(axis=0), flat.max(axis=0)
    middle = (low + high) / 2 @ camera.rotation[1:]
    middle += (corners @ camera.rotation[0]).mean() * camera.rotation[0]
    session.look(replace(camera, center=middle, height=1.06 * float((high - low).max())))


def _look(session: Any, tints: Any, function: Any = None) -> Appearance:
    mm = np.asarray(session.spacing, dtype=np.float64)
    return Appearance(function or session.transfer_function, tints, LIGHT, mm, FINE, "cpu")


def _tinted(session: Any, tints: Any, ground: Any = GROUND, function: Any = None) -> ImageTexture:
    whole = session.scene().subvolumes.whole()
    patch = cast_subvolume(
        whole, None, session.camera, (SIDE, SIDE), _look(session, tints, function)
    )
    return compose((SIDE, SIDE), [patch], ground.background)


def _white(session: Any) -> Any:
    tints = session.packed_tints().copy()
    tints[1:, :3] = np.where(tints[1:, 3:] > 0, 0.92, 0)
    return tints


def _random(session: Any) -> Any:
    rng = np.random.default_rng(4)
    hues = {i: float(rng.uniform()) for i in session.ids}
    return tints_of(hues, session.ids[-1], mode=session.tint_mode)


def _in_mode(session: Any, mode: Any) -> ImageTexture:
    return _tinted(session, tints_of(session.hues, session.ids[-1], mode=mode))


def _layer(session: Any, k: int) -> ImageTexture:
    visible = np.arange(session.ids[-1] + 1) > 0
    fine = 2 * SIDE
    ids = cast_ids(
        session.labels, session.spacing, session.camera, visible, (fine, fine), k + 1, backend="cpu"
    )[k]
    flat = tints_of(session.hues, session.ids[-1])[ids].copy()
    edge = np.zeros(ids.shape, bool)
    edge[1:] |= ids[1:] != ids[:-1]
    edge[:, 1:] |= ids[:, 1:] != ids[:, :-1]
    flat[edge & (ids > 0), :3] *= 0.45
    image = flat + (1 - flat[..., 3:]) * GROUND.background.paint((fine, fine))
    small: ImageTexture = image.reshape(SIDE, 2, SIDE, 2, 4).mean(axis=(1, 3)).astype(np.float32)
    return small


def _isolated(session: Any, count: int) -> ImageTexture:
    sizes = dict(zip(session.boxes.ids.tolist(), session.boxes.counts.tolist(), strict=True))
    largest = sorted(session.ids, key=lambda i: -sizes[i])
    session.isolate(largest[1 : 1 + count])
    picture = _tinted(session, session.packed_tints())
    session.undo()
    return picture


def _before(session: Any, words: str) -> ImageTexture:
    around = Decorations.of(words, ["box", "scale"])
    camera = replace(session.camera, height=1.22 * session.camera.height)
    return scene_image(session.scene(), camera, (SIDE, SIDE), backend="cpu", decorations=around)


def _densest(session: Any, share: float) -> ImageTexture:
    """Show the voxels of the objects from a density on, more of it the denser they are."""
    densities = session.volume[session.labels > 0]
    low, high = np.quantile(densities, [1.0 - share, 1.0 - share / 4])
    points = [(float(low), 0.0), (float(max(high, low + 1)), 0.6)]
    return _tinted(session, session.packed_tints(), function=TransferFunction(points))


def _from_three_sides(session: Any) -> NDArray[np.uint8]:
    """Return all objects from three sides, and below them the densest tenth and fortieth of all."""
    before, columns = session.camera, []
    for words, direction, up in (
        ("from the front", (1.0, 0.0, 0.0), None),
        ("from above", (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
        ("from the side", (0.0, 0.0, 1.0), None),
    ):
        _frame(session, View(direction, up=up))
        session.recolor()
        whole = _tinted(session, session.packed_tints())
        shares = ((0.1, "the densest 10%"), (0.025, "the densest 2.5%"))
        denser = [captioned(_densest(session, share), text) for share, text in shares]
        columns.append(np.vstack([captioned(whole, words), *denser]))
    session.look(before)
    session.recolor()
    return np.hstack(columns)


def _through(session: Any, preset: str) -> ImageTexture:
    function = TransferFunction.preset(preset)
    return _tinted(session, session.packed_tints(), function=function)


def captioned(picture: ImageTexture, words: str) -> NDArray[np.uint8]:
    """Return an (H, W, 3 or 4) picture of 0 to 1 with words below it."""
    high, wide = picture.shape[:2]
    whole = np.zeros((high + CAPTION, wide, 3), np.uint8)
    whole[:] = (14, 16, 20)
    whole[:high] = np.rint(np.clip(picture[..., :3], 0, 1) * 255)
    image = Image.fromarray(whole)
    color = tuple(round(255 * c) for c in CAPTIONS)
    ImageDraw.Draw(image).text(
        (wide / 2, high + CAPTION / 2),
        words,
        fill=color,
        font=ImageFont.load_default(17),
        anchor="mm",
    )
    return np.asarray(image)


def save(picture: NDArray[np.uint8], path: Path) -> None:
    """Write a PNG, as small as it gets."""
    Image.fromarray(picture).save(path, optimize=True)
