"""Rotations as numpy arrays: matrices (.., 3, 3), quaternions (.., 4) as x, y, z, w."""

import numpy as np

# from Blender's world, z up, to kinelm's, y up: a figure that looks along -y then looks along +z
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def to_matrices(q):
    """Of unit quaternions."""
    x, y, z, w = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def to_quaternions(m):
    """Of rotations, each by the largest of its four components, as only that division is accurate."""
    d = np.diagonal(m, axis1=-2, axis2=-1)
    x, y, z = np.moveaxis(d, -1, 0)
    # squares of x, y, z, w, times four
    size = np.stack([1 + x - y - z, 1 - x + y - z, 1 - x - y + z, 1 + x + y + z], -1)
    a, b, c = m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]
    e, f, g = m[..., 1, 2], m[..., 2, 0], m[..., 0, 1]
    rows = np.stack([
        np.stack([size[..., 0], g + c, b + f, a - e], -1), np.stack([g + c, size[..., 1], a + e, b - f], -1),
        np.stack([b + f, a + e, size[..., 2], c - g], -1), np.stack([a - e, b - f, c - g, size[..., 3]], -1)], -2)
    best = np.argmax(size, -1)[..., None, None]
    q = np.take_along_axis(rows, best, -2)[..., 0, :]
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def without_scale(m):
    """The rotations of matrices (.., 4, 4) or (.., 3, 3) with scale."""
    m = m[..., :3, :3]
    return m / np.linalg.norm(m, axis=-2, keepdims=True)


def quarter_turns(m):
    """The rotation by quarter turns that is nearest to a rotation (3, 3)."""
    nearest, left = np.zeros((3, 3)), np.abs(m).copy()
    for _ in range(3):
        row, column = np.unravel_index(np.argmax(left), (3, 3))
        nearest[row, column] = np.sign(m[row, column])
        left[row, :] = left[:, column] = -1
    return nearest if np.linalg.det(nearest) > 0 else np.eye(3)


def to_global(local, parents):
    """World rotations (F, J, 3, 3) of local ones; parents come first."""
    out = local.copy()
    for j, parent in enumerate(parents):
        if parent is not None:
            out[:, j] = out[:, parent] @ local[:, j]
    return out
