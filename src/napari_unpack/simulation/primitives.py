"""Signed distances of the solids that objects are modelled from, in mm, negative inside.

A solid is a code and six numbers; its own frame is z, y, x with y down, its long axis is x. Some
distances are bounds, not exact: what matters is the zero level and a slope of about 1 near it.
"""

from __future__ import annotations

import math

from napari_unpack.kernels import njit

ELLIPSOID = 0
BOX = 1
CYLINDER = 2
ROUND_CONE = 3
ARC = 4
HELIX = 5
SLAB = 6
SOLE = 7
BRISTLES = 8
PLEATS = 9
RIBS = 10
LOFT = 11


@njit(cache=True, nogil=True)
def solid_distance(code, p, z, y, x):  # type: ignore[no-untyped-def]
    """Return the signed distance of one point from one solid.

    Parameters
    ----------
    code : int
        ELLIPSOID (rz, ry, rx) · BOX (half z, half y, half x, rounding) · CYLINDER along x
        (radius, half length, rounding) · ROUND_CONE along x (radius at -x, radius at +x, half
        length between the centres) · ARC of a ring lying in z, x, centred on +x (ring radius,
        tube radius, half angle, taper, flattening along y) · HELIX about y (ring radius, tube
        radius, pitch, turns) · SLAB, the half-space below a plane (normal z y x) · SOLE, two
        circles joined in z, x, extruded along y (radius at -x, radius at +x, half length, half
        height, rounding) · BRISTLES along y on an x, z grid (half z, half x, pitch, radius,
        half length) · PLEATS, a folded cone along x (radius at -x, radius at +x, half length,
        folds, depth) · RIBS, a cylinder with hoops (radius, half length, rounding, pitch,
        depth) · LOFT along x between two ellipses (rz, ry at -x, rz, ry at +x, half length,
        rounding).
    p : (6,) ndarray of float64
        Its numbers, mm and radians.
    z, y, x : float
        The point in the solid's frame, mm.
    """
    if code == ELLIPSOID:
        return _ellipsoid(p[0], p[1], p[2], z, y, x)
    if code == BOX:
        return _box(p[0], p[1], p[2], p[3], z, y, x)
    if code == CYLINDER:
        return _capped(math.hypot(z, y) - p[0], abs(x) - p[1], p[2])
    if code == ROUND_CONE:
        return _round_cone(p[0], p[1], p[2], math.hypot(z, y), x)
    if code == ARC:
        return _arc(p, z, y, x)
    if code == HELIX:
        return _helix(p, z, y, x)
    if code == SLAB:
        return p[0] * z + p[1] * y + p[2] * x
    if code == SOLE:
        flat = _round_cone(p[0], p[1], p[2], abs(z), x)
        return _capped(flat, abs(y) - p[3], p[4])
    if code == BRISTLES:
        return _bristles(p, z, y, x)
    if code == PLEATS:
        return _pleats(p, z, y, x)
    if code == RIBS:
        hoop = p[4] * math.cos(2.0 * math.pi * x / p[3])
        return _capped(math.hypot(z, y) - p[0] - hoop, abs(x) - p[1], p[2])
    return _loft(p, z, y, x)


@njit(cache=True, nogil=True)
def _capped(across, along, rounding):  # type: ignore[no-untyped-def]
    # The corner of two half-spaces, rounded off without growing the solid.
    a = across + rounding
    b = along + rounding
    outside = math.hypot(max(a, 0.0), max(b, 0.0))
    return outside + min(max(a, b), 0.0) - rounding


@njit(cache=True, nogil=True)
def _box(hz, hy, hx, rounding, z, y, x):  # type: ignore[no-untyped-def]
    a = abs(z) - hz + rounding
    b = abs(y) - hy + rounding
    c = abs(x) - hx + rounding
    outside = math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
    return outside + min(max(a, b, c), 0.0) - rounding


@njit(cache=True, nogil=True)
def _ellipsoid(rz, ry, rx, z, y, x):  # type: ignore[no-untyped-def]
    a, b, c = z / rz, y / ry, x / rx
    near = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / rz, b / ry, c / rx
    slope = math.sqrt(a * a + b * b + c * c)
    # At the centre the slope vanishes with the distance, and 0 / 0 says nothing.
    if slope < 1e-12:
        return -min(rz, ry, rx)
    return near * (near - 1.0) / slope


@njit(cache=True, nogil=True)
def _round_cone(r1, r2, half, radius, x):  # type: ignore[no-untyped-def]
    # Two balls and the cone that touches both, in the plane of axis and point.
    length = 2.0 * half
    # Where one ball holds the other there is no cone; the limit keeps the root real.
    sine = min(max((r1 - r2) / max(length, 1e-9), -0.999), 0.999)
    cosine = math.sqrt(1.0 - sine * sine)
    along = x + half
    k = cosine * along - sine * radius
    if k < 0.0:
        return math.hypot(radius, along) - r1
    if k > cosine * length:
        return math.hypot(radius, along - length) - r2
    return radius * cosine + along * sine - r1


@njit(cache=True, nogil=True)
def _arc(p, z, y, x):  # type: ignore[no-untyped-def]
    angle = math.atan2(z, x)
    # Beyond its ends an arc is as far as the ball at its end.
    nearest = min(max(angle, -p[2]), p[2])
    share = nearest / p[2]
    tube = p[1] * (1.0 - p[3] * share * share)
    dz = z - p[0] * math.sin(nearest)
    dx = x - p[0] * math.cos(nearest)
    return math.sqrt(dz * dz + (y * p[4]) ** 2 + dx * dx) - tube


@njit(cache=True, nogil=True)
def _helix(p, z, y, x):  # type: ignore[no-untyped-def]
    # Turns are numbered from the top; the nearest two heights of this angle are compared.
    ring, tube, pitch, turns = p[0], p[1], p[2], p[3]
    angle = math.atan2(z, x) / (2.0 * math.pi)
    height = y / pitch + turns / 2.0 - angle
    # Only turns that exist at this angle, or the coil would go on for ever.
    turn = min(max(round(height), math.ceil(-angle)), math.floor(turns - angle))
    return math.hypot(math.hypot(z, x) - ring, (height - turn) * pitch) - tube


@njit(cache=True, nogil=True)
def _bristles(p, z, y, x):  # type: ignore[no-untyped-def]
    pitch = p[2]
    rows = math.floor(p[0] / pitch)
    cols = math.floor(p[1] / pitch)
    # The nearest pin of the grid is the only one that counts.
    dz = z - pitch * min(max(round(z / pitch), -rows), rows)
    dx = x - pitch * min(max(round(x / pitch), -cols), cols)
    dy = max(abs(y) - p[4], 0.0)
    return math.sqrt(dz * dz + dx * dx + dy * dy) - p[3]


@njit(cache=True, nogil=True)
def _pleats(p, z, y, x):  # type: ignore[no-untyped-def]
    share = min(max(0.5 + 0.5 * x / p[2], 0.0), 1.0)
    radius = p[0] + (p[1] - p[0]) * share
    angle = math.atan2(z, y)
    # Swept folds: every pleat is wrapped the same way round the stick.
    wave = abs(math.sin(0.5 * p[3] * (angle + 0.35 * share)))
    # The waves are steeper than 1: 0.85 keeps marching from stepping through a fold.
    return _capped(math.hypot(z, y) - radius - p[4] * (wave - 0.6), abs(x) - p[2], 0.0) * 0.85


@njit(cache=True, nogil=True)
def _loft(p, z, y, x):  # type: ignore[no-untyped-def]
    share = min(max(0.5 + 0.5 * x / p[4], 0.0), 1.0)
    rz = p[0] + (p[2] - p[0]) * share
    ry = p[1] + (p[3] - p[1]) * share
    # An ellipse as an ellipsoid so long that its x radius never is the least.
    return _capped(_ellipsoid(rz, ry, 1e3, z, y, 0.0), abs(x) - p[4], p[5])
