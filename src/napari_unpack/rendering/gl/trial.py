"""Whether a graphics driver survives our shaders: tried by a child process, as it may end it."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from hashlib import sha256
from importlib import resources

# A driver compiles all shaders anew; one that hangs must not keep us waiting for ever.
SECONDS = 60
LATE = f"it did not draw within {SECONDS} s"
DRAWN = "the driver has drawn"
OFFSCREEN = "from napari_unpack.rendering.gl.trial import draw_offscreen; draw_offscreen()"


def tried(command: str) -> str:
    """Return why a child process could not draw with the driver, "" where it could.

    Parameters
    ----------
    command : str
        What the child does, in Python.
    """
    # An application packed into one file has no interpreter to start.
    if getattr(sys, "frozen", False) or not sys.executable:
        return ""
    try:
        child = subprocess.run(
            [sys.executable, "-c", command], capture_output=True, text=True, timeout=SECONDS
        )
    except subprocess.TimeoutExpired:
        return LATE
    except OSError:
        return ""
    if DRAWN in child.stdout:
        return ""
    if child.returncode < 0:
        return f"it ends the process with signal {-child.returncode}"
    errors = [line for line in child.stderr.splitlines() if "Error" in line]
    return errors[-1].strip() if errors else "it draws nothing"


def refusal(driver: str) -> str:
    """Return why a driver must not draw offscreen, "" where it may; kept for later processes.

    A driver is known by what it calls itself, its version included: another is tried anew, and
    so are other shaders.
    """
    from platformdirs import user_cache_path

    name = sha256(f"{driver} {shaders_digest()}".encode()).hexdigest()[:16]
    file = user_cache_path("napari-unpack", appauthor=False) / f"offscreen-{name}.txt"
    with suppress(OSError, ValueError):
        return file.read_text("utf-8")
    reason = tried(OFFSCREEN)
    if reason == LATE:
        # The machine may have been busy: the next process asks again.
        return reason
    # As it does where nothing can be kept.
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(reason, "utf-8")
    return reason


def shaders_digest() -> str:
    """Return a short name of all shaders' text: a driver is tried anew with other shaders."""
    folders = [resources.files("napari_unpack.shaders") / name for name in ("lib", "passes")]
    files = sorted((f for folder in folders for f in folder.iterdir()), key=lambda f: f.name)
    return sha256(b"".join(f.read_bytes() for f in files if f.is_file())).hexdigest()[:16]


def draw_offscreen() -> None:
    """Cast a small bag in a context without a window, and say so; for the child."""
    from napari_unpack.rendering.gl.offscreen import Offscreen

    with Offscreen().use():
        draw_bag()


def draw_bag() -> None:
    """Cast a small bag with the shaders of the current canvas, and say so."""
    import numpy as np

    from napari_unpack.appearance import TransferFunction
    from napari_unpack.geometry.shading import Shading
    from napari_unpack.geometry.view import View
    from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
    from napari_unpack.rendering.gl import framebuffer
    from napari_unpack.rendering.gl.cached_pass import TintedCaster
    from napari_unpack.rendering.gl.tinted_pass import Appearance
    from napari_unpack.rendering.gl.volume_store import VolumeStore

    labels = np.zeros((8, 9, 10), np.uint16)
    labels[2:6, 2:7, 2:8] = 1
    store = VolumeStore(labels, labels * np.uint16(1000))
    while not store.send(2**20):
        pass
    spacing = np.ones(3)
    look = TransferFunction.default_for(labels * np.uint16(1000))
    shown = Appearance(
        spacing, look.table(TABLE_ENTRIES), look.domain, np.ones((2, 4), np.float32), Shading()
    )
    camera, caster = View((0.2, 0.3, 1.0)).camera(labels.shape, spacing), TintedCaster(store)
    caster.cast(rays_for(camera, (24, 32), spacing), shown)
    framebuffer.finish()
    if caster.targets.get((24, 32)).read()[..., 3].max() > 0.5:
        sys.stdout.write(DRAWN)
