#!/usr/bin/env python3
"""A text of words back into motion, written from docs/tokenizer.md alone: uniform bins without a joint transform.

    kinelm tokenizer text walk.bvh --tokenizer tokenizer.json > walk.txt
    python3 scripts/reference/decode_words.py tokenizer.json walk.txt > walk.json

Python's own library is enough. Prints one JSON object: `root` (F, 3) and `positions` (F, 24, 3) in metres, the height above the
floor where the tokenizer codes that; `rotations` (F, 24, 4), local, w x y z. tests/cli/words.rs compares it with
`kinelm tokenizer decode`.
"""
import json
import math
import sys

PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
OFFSETS = [
    (0, 0, 0), (.09, -.08, 0), (-.09, -.08, 0), (0, .12, 0), (0, -.41, 0), (0, -.41, 0), (0, .13, 0), (0, -.42, -.03),
    (0, -.42, -.03), (0, .06, 0), (0, -.06, .13), (0, -.06, .13), (0, .21, -.02), (.07, .12, -.01), (-.07, .12, -.01),
    (0, .09, .03), (.11, .03, 0), (-.11, .03, 0), (.26, 0, 0), (-.26, 0, 0), (.25, 0, 0), (-.25, 0, 0), (.08, 0, 0),
    (-.08, 0, 0)]
ASCII = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"


def code(character):
    at = ASCII.find(character)
    return at if at >= 0 else ord(character) - 0x4E00 + len(ASCII)


def exp(v):
    """The rotation of a vector, as (w, x, y, z)."""
    angle = math.hypot(*v)
    share = math.sin(angle / 2) / angle if angle > 0 else 0.0
    return (math.cos(angle / 2), *(share * x for x in v))


def times(a, b):
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw)


def turned(q, v):
    """A vector turned by a rotation."""
    w, x, y, z = q
    return times(times(q, (0.0, *v)), (w, -x, -y, -z))[1:]


def decode(own, text):
    """-> root (F, 3), local rotations (F, 24, 4)"""
    config, fitted = own["config"], own["fitted"]
    scheme, joints = config["scheme"], config["joints"]
    assert scheme["type"] == "uniform" and scheme["joint_transform"]["type"] == "none", "uniform bins of joints"
    n, has_turn = scheme["bins"], config["root_rotation"] == "heading_delta" and joints[0] == 0

    def component(k):
        return (k - n // 2) * 2 * math.pi / n if scheme["form"] == "centred" else (k + 0.5) * 2 * math.pi / n - math.pi

    # the means are those of the joints that aren't coded, by ascending id
    means = {j: (1.0, 0.0, 0.0, 0.0) for j in range(24)}
    for j, (x, y, z, w) in zip([j for j in range(24) if j not in joints], own.get("mean_pose") or []):
        means[j] = (w, x, y, z)

    x, y, z, heading, turn = 0.0, fitted["first_height"], 0.0, 0.0, 0
    root, rotations = [], []
    for word in text.split():
        codes = [code(character) for character in word]
        assert len(codes) == 3 + 3 * len(joints), f"a word of {len(codes)} characters"
        vx, vy, vz = ((k - line["zero"]) * line["width"] + line["offset"]
                      for k, line in zip(codes, fitted["translation"]))
        if scheme["translation"] == "velocity":
            s, c = math.sin(heading), math.cos(heading)
            x, z = x + vx * c + vz * s, z + vz * c - vx * s
        else:
            x, z = vx, vz
        y = {"floor": fitted["first_height"] + vy, "velocity": y + vy, "absolute": vy}[scheme["height"]]
        root.append((x, y, z))

        pose = dict(means)
        for i, j in enumerate(joints):
            a, b, c = codes[3 + 3 * i:6 + 3 * i]
            if j == 0 and has_turn:
                turn = (turn + a - n // 2) % n
                about_y = exp((0.0, turn * 2 * math.pi / n, 0.0))
                pose[j] = times(about_y, exp((component(b), 0.0, component(c))))
            else:
                pose[j] = exp((component(a), component(b), component(c)))
        if 0 in joints:
            ahead = turned(pose[0], (0.0, 0.0, 1.0))
            if math.hypot(ahead[0], ahead[2]) > 1e-6:
                heading = math.atan2(ahead[0], ahead[2])
        rotations.append([pose[j] for j in range(24)])
    return root, rotations


def positions(root, pose):
    """-> (24, 3)"""
    places, world = [], []
    for j, parent in enumerate(PARENTS):
        if parent < 0:
            places.append(root)
            world.append(pose[j])
        else:
            step = turned(world[parent], OFFSETS[j])
            places.append(tuple(p + d for p, d in zip(places[parent], step)))
            world.append(times(world[parent], pose[j]))
    return places


def main():
    tokenizer, words = sys.argv[1:]
    own = json.load(open(tokenizer, encoding="utf-8"))["decoder"]["kinelm"]
    root, rotations = decode(own, open(words, encoding="utf-8").read())
    places = [positions(*frame) for frame in zip(root, rotations)]
    json.dump({"root": root, "rotations": rotations, "positions": places}, sys.stdout)


if __name__ == "__main__":
    main()
