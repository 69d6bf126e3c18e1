"""Places of the joints of an AMC on its ASF, by numpy: crates/motion/tests/golden/bones.json.

    python3 amc.py bones.asf bones.amc > bones.json

Of what the formats allow only what CMU's files hold: degrees, rotations about fixed axes in the order of `dof`. The joint
named after a bone is at its beginning. L = C M C^-1, world = parent's world L, end = beginning + world (direction length).
Metres: 0.0254 / length (mocap.cs.cmu.edu/faqs.php).
"""
import json, re, sys
import numpy as np


def about(axis, degrees):
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.eye(3)
    turn[i, i] = turn[j, j] = c
    turn[i, j], turn[j, i] = -s, s
    return turn


def product(turns):
    whole = np.eye(3)
    for axis, degrees in turns:
        whole = about(axis, degrees) @ whole
    return whole


def words(path):
    for line in open(path):
        found = re.sub("[(),]", " ", line.split("#")[0]).split()
        if found:
            yield found


section, length, order, bones, bone, parent = "", 1.0, [], {}, {}, {}
for w in words(sys.argv[1]):
    if w[0][0] == ":":
        section = w[0]
    elif section == ":units" and w[0] == "length":
        length = float(w[1])
    elif section == ":root" and w[0] == "order":
        order = [x.lower() for x in w[1:]]
    elif section == ":bonedata":
        if w[0] == "begin":
            bone = {"dof": []}
        elif w[0] == "end":
            bones[bone["name"][0]] = bone
        else:
            bone[w[0]] = w[1:]
    elif section == ":hierarchy" and w[0] not in ("begin", "end"):
        parent.update({child: w[0] for child in w[1:]})

frames = []
for w in words(sys.argv[2]):
    if len(w) == 1 and w[0].isdigit():
        frames.append({})
    elif w[0][0] != ":":
        frames[-1][w[0]] = [float(x) for x in w[1:]]

metres = 0.0254 / length
places = []
for frame in frames:
    root = dict(zip(order, frame["root"]))
    begin = {"root": np.array([root["tx"], root["ty"], root["tz"]])}
    end = dict(begin)
    world = {"root": product([(c[1], x) for c, x in zip(order, frame["root"]) if c[0] == "r"])}
    left = list(parent)
    while left:
        name = next(n for n in left if parent[n] in world)
        left.remove(name)
        b, up = bones[name], parent[name]
        own = product(zip("xyz", map(float, b["axis"][:3])))
        moved = product([(c[1].lower(), x) for c, x in zip(b["dof"], frame.get(name, []))])
        world[name] = world[up] @ own @ moved @ own.T
        way = np.array([float(x) for x in b["direction"]])
        begin[name] = end[up]
        end[name] = begin[name] + world[name] @ (way / np.linalg.norm(way) * float(b["length"][0]))
    places.append({name: (metres * place).round(9).tolist() for name, place in begin.items()})
json.dump({"frames": places}, sys.stdout, indent=1)
print()
