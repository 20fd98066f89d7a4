"""The camera's way from one view to another: a pure function of time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from napari_unpack.geometry.easing import ease
from napari_unpack.geometry.transforms import slerp
from napari_unpack.geometry.view import Camera

# As long as an object takes to the middle of the view: the eye follows, and nobody waits.
GLIDE_SECONDS = 0.35


@dataclass(frozen=True, eq=False)
class CameraGlide:
    """A camera on its way.

    Parameters
    ----------
    origin, target : Camera
        Both stretched alike; the perspective is the target's from the beginning.
    start : float
        When it sets off, s.
    """

    origin: Camera
    target: Camera
    start: float

    @property
    def turns(self) -> bool:
        """Whether it looks another way at its end."""
        return not np.allclose(self.origin.rotation, self.target.rotation, atol=1e-4)

    def done(self, time: float) -> bool:
        """Tell whether it has arrived."""
        return time >= self.start + GLIDE_SECONDS

    def gone(self, time: float) -> float:
        """Return the part of the way that lies behind it, in [0, 1]."""
        return float(ease((time - self.start) / GLIDE_SECONDS))

    def camera(self, time: float) -> Camera:
        """Return where it is, at rest at both ends."""
        if self.done(time):
            return self.target
        gone = self.gone(time)
        a, b = self.origin, self.target
        return replace(
            b,
            rotation=slerp(a.rotation, b.rotation, gone),
            center=(1.0 - gone) * a.center + gone * b.center,
            # Geometric, so that drawing back looks as steady as coming near.
            height=a.height ** (1.0 - gone) * b.height**gone,
        )
