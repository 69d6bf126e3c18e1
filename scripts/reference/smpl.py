"""SMPL's joints as other scripts here need them: parents, a body's offsets in metres, and where joints are."""
import numpy as np

PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
OFFSETS = np.array([
    (0, 0, 0), (.09, -.08, 0), (-.09, -.08, 0), (0, .12, 0), (0, -.41, 0), (0, -.41, 0), (0, .13, 0),
    (0, -.42, -.03), (0, -.42, -.03), (0, .06, 0), (0, -.06, .13), (0, -.06, .13), (0, .21, -.02), (.07, .12, -.01),
    (-.07, .12, -.01), (0, .09, .03), (.11, .03, 0), (-.11, .03, 0), (.26, 0, 0), (-.26, 0, 0), (.25, 0, 0),
    (-.25, 0, 0), (.08, 0, 0), (-.08, 0, 0)])


def posed(root, local, offsets=OFFSETS):
    """(.., 3) and matrices (.., 24, 3, 3) of each joint in its parent -> the same in the world, and places (.., 24, 3)."""
    world, place = np.zeros_like(local), np.zeros(local.shape[:-2] + (3,))
    for j, parent in enumerate(PARENTS):
        if parent < 0:
            world[..., j, :, :], place[..., j, :] = local[..., j, :, :], root
        else:
            place[..., j, :] = place[..., parent, :] + world[..., parent, :, :] @ offsets[j]
            world[..., j, :, :] = world[..., parent, :, :] @ local[..., j, :, :]
    return world, place
