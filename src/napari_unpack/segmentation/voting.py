"""What speaks for the labels at a voxel: the network's word on the faces it shares with them."""

from __future__ import annotations

from numba import njit

MOST = 7
"""Labels that a voxel and its six neighbours have."""

LEAD = 0.2
"""By how much more must speak for another label: who holds a voxel keeps it in doubt."""


@njit(cache=True, nogil=True)
def count_votes(labels, following, bar, z, y, x, names, votes):  # type: ignore[no-untyped-def]
    """Write the labels at a voxel and what speaks for each; return how many they are.

    Parameters
    ----------
    labels : (Z, Y, X) ndarray of int32
        0 is background, which has no vote.
    following : (3, Z, Y, X) ndarray of uint8
        That a voxel belongs with the next; see `boundaries.Prediction`.
    bar : float
        Taken off the probability of every face.
    z, y, x : int
        The voxel, of a label.
    names : (7,) ndarray of int32
        Gets the labels, its own first.
    votes : (7,) ndarray of float64
        Gets the sums over their faces.

    Returns
    -------
    count : int
    bare : bool
        Whether it touches background.
    """
    size = labels.shape
    count, bare = 1, False
    names[0], votes[0] = labels[z, y, x], 0.0
    for side in range(6):
        axis, ahead = side // 2, side % 2
        k, j, i = z, y, x
        if axis == 0:
            k += 2 * ahead - 1
        elif axis == 1:
            j += 2 * ahead - 1
        else:
            i += 2 * ahead - 1
        inside = 0 <= k < size[0] and 0 <= j < size[1] and 0 <= i < size[2]
        name = labels[k, j, i] if inside else 0
        bare |= inside and name == 0
        if name > 0:
            said = following[axis, z, y, x] if ahead else following[axis, k, j, i]
            n = 0
            while n < count and names[n] != name:
                n += 1
            if n == count:
                names[n], votes[n] = name, 0.0
                count += 1
            votes[n] += said / 255.0 - bar
    return count, bare
