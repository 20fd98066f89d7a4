"""Hand-made volumes with known objects, sharing no code with the package's simulator."""

import numpy as np

MATERIALS = (260.0, 420.0, 640.0, 880.0, 1000.0, 1180.0, 1500.0, 2100.0, 3400.0)


def ball(shape, center, radius):
    grid = np.indices(shape, dtype=np.float32)
    squared = sum((g - c) ** 2 for g, c in zip(grid, center, strict=True))
    return squared <= radius**2


def box(shape, lower, upper):
    mask = np.zeros(shape, bool)
    mask[tuple(slice(a, b) for a, b in zip(lower, upper, strict=True))] = True
    return mask


def two_balls(shape=(48, 48, 80), radius=17, distance=29):
    """Return two overlapping balls, each cut off at the plane half-way: labels 1 and 2."""
    z, y, x = (n // 2 for n in shape)
    left, right = x - distance / 2, x + distance / 2
    labels = np.zeros(shape, np.int32)
    labels[ball(shape, (z, y, left), radius)] = 1
    labels[ball(shape, (z, y, right), radius) & (np.arange(shape[2]) > x)] = 2
    labels[(labels == 1) & (np.arange(shape[2]) > x)] = 2
    return labels


def scanned(labels, densities, noise=25.0, seed=0, blur=0.7):
    """Return the density volume of labels: blurred, with white noise, never below 0."""
    from scipy.ndimage import gaussian_filter

    table = np.zeros(labels.max() + 1, np.float32)
    for name, value in densities.items():
        table[name] = value
    clean = gaussian_filter(table[labels], blur)
    noisy = clean + np.random.default_rng(seed).normal(0, noise, labels.shape)
    return np.clip(noisy, 0, 32000).astype(np.uint16)


def superquadric(rng, largest=24.0):
    """Return the mask of one randomly turned superquadric in a cube just large enough."""
    radii = rng.uniform(0.25, 1.0, 3) * largest
    powers = rng.choice([2.0, 2.0, 4.0, 10.0], 3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    if rng.random() < 0.5:
        turn = np.eye(3)[rng.permutation(3)]
    half = int(np.ceil(np.linalg.norm(radii)))
    grid = np.indices((2 * half + 1,) * 3, dtype=np.float32).reshape(3, -1) - half
    local = np.abs(turn @ grid) / radii[:, None]
    inside = sum(q**p for q, p in zip(local, powers, strict=True)) <= 1
    mask = inside.reshape((2 * half + 1,) * 3)
    keep = np.ix_(*(mask.any(axis=tuple({0, 1, 2} - {a})) for a in range(3)))
    return mask[keep]


def packed(seed, shape=(96, 112, 128), count=14, largest=24.0, press=0):
    """Drop superquadrics along +y until they touch; return labels and the density of each.

    They are pressed that many voxels further, and the later one gives way where they meet.
    """
    rng = np.random.default_rng(seed)
    labels = np.zeros(shape, np.int32)
    densities = {}
    for name in range(1, count + 1):
        for _ in range(30):
            mask = superquadric(rng, largest)
            room = [n - m for n, m in zip(shape, mask.shape, strict=True)]
            if min(room) < 1:
                continue
            z, x = int(rng.integers(0, room[0])), int(rng.integers(0, room[2]))
            y = _rest(labels, mask, z, x, room[1])
            if y is not None:
                y = min(y + press, room[1] - 1)
                window = labels[z : z + mask.shape[0], y : y + mask.shape[1], x : x + mask.shape[2]]
                window[mask & (window == 0)] = name
                densities[name] = float(rng.choice(MATERIALS))
                break
    return labels, densities


def _rest(labels, mask, z, x, deepest):
    """Return how far the mask falls before it would overlap, or None where it cannot enter."""
    last = None
    a, b, c = mask.shape
    for y in range(deepest):
        if (labels[z : z + a, y : y + b, x : x + c][mask] > 0).any():
            return last
        last = y
    return last
