"""The light of an image: Blinn-Phong with the lamp at the viewer's head."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Shading:
    """How strongly surfaces are modelled by light.

    Parameters
    ----------
    ambient, diffuse, specular : float
        Weights; specular is added in white, the others multiply the tinted colour. Together
        they may exceed 1: what faces the viewer then glows.
    shininess : float
        Exponent of the highlight.
    gradient_floor : float
        Fraction of the transfer function's domain per voxel below which the density gradient
        is too weak to be a surface: shading fades out towards flat (ambient + diffuse) there.

    Notes
    -----
    With n = -gradient / |gradient| (towards lower density, that is out of the object) in world
    space, c = |n . l| for a two-sided surface and l towards the viewer along the ray, and
    s = clip(|gradient| / gradient_floor, 0, 1): light = ambient + diffuse * (1 - s + s * c),
    highlight = specular * s * c ** shininess (half vector = light vector for a headlight).
    The gradient is the central difference of the interpolated density one voxel to both sides,
    halved, times min(spacing) / spacing: density per min(spacing) mm of the bag. A sample's
    colour is min(tinted colour * light + highlight, 1).
    """

    ambient: float = 0.45
    diffuse: float = 0.72
    specular: float = 0.28
    shininess: float = 28.0
    gradient_floor: float = 0.01


# No light at all: the transfer function's colours as they are.
UNLIT = Shading(ambient=1.0, diffuse=0.0, specular=0.0)
