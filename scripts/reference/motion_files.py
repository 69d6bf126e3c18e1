#!/usr/bin/env python3
"""Makes the motion files of crates/motion/tests/golden/{amass,aist,body} with numpy and Python's own pickle, and what they say.

    python3 -m venv VENV && VENV/bin/pip install numpy==2.4.6 scipy==1.17.1
    VENV/bin/python scripts/reference/motion_files.py            # writes the golden files
    VENV/bin/python scripts/reference/motion_files.py --check D  # loads what the ignored test `for_numpy` wrote into D

All motions are random numbers; no clip of any data set is in them, and the body models are no bodies.
"""
import io
import json
import pathlib
import pickle
import platform
import sys
import warnings
import zipfile

import numpy as np
import scipy
from scipy import sparse
from scipy.spatial.transform import Rotation

from smpl import PARENTS

SEED = 20261121
FRAMES = 2
GOLDEN = pathlib.Path(__file__).parents[2] / "crates/motion/tests/golden"
HEADER = {
    "script": "scripts/reference/motion_files.py",
    "versions": {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__},
    "seed": SEED,
}
J0 = np.array([0.00, -0.21, 0.03])  # the rest pelvis when no body model is given
TURN = Rotation.from_euler("x", -90, degrees=True)


def lines(value, depth=3, pad=""):
    """JSON with a line for each key down to a depth."""
    if depth == 0 or not isinstance(value, dict) or not value:
        return json.dumps(value, ensure_ascii=False)
    items = [f"{pad} {json.dumps(k)}: {lines(v, depth - 1, pad + ' ')}" for k, v in value.items()]
    return "{\n" + ",\n".join(items) + "\n" + pad + "}" + ("\n" if not pad else "")


def motion(rng, joints):
    """(F, joints*3) rotation vectors: some longer than pi, one tiny, one zero; (F, 3) translations."""
    vectors = rng.normal(size=(FRAMES, joints, 3))
    vectors[0, 1] *= 4.5 / np.linalg.norm(vectors[0, 1])
    vectors[1, 0] *= 9.0 / np.linalg.norm(vectors[1, 0])
    vectors[0, 2] = 0
    vectors[1, 2] = [1e-9, -2e-9, 3e-10]
    return vectors.reshape(FRAMES, -1), rng.normal(size=(FRAMES, 3))


def wxyz(rotation):
    return np.roll(rotation.as_quat(), 1, axis=-1)


def expected_amass(poses, trans, fps, hands=False):
    poses, trans = np.asarray(poses, float), np.asarray(trans, float)
    body = poses.reshape(FRAMES, -1, 3)[:, :24].copy()
    if not hands:
        body[:, 22:] = 0
    q = wxyz(Rotation.from_rotvec(body.reshape(-1, 3))).reshape(FRAMES, 24, 4)
    q[:, 0] = wxyz(TURN * Rotation.from_rotvec(body[:, 0]))
    return {"fps": fps, "root": TURN.apply(trans + J0).tolist(), "rotations": q.tolist()}


def expected_aist(poses, trans, scaling):
    poses, trans = np.asarray(poses, float), np.asarray(trans, float)
    q = wxyz(Rotation.from_rotvec(poses.reshape(-1, 3))).reshape(FRAMES, 24, 4)
    return {"fps": 60.0, "root": (trans / scaling + J0).tolist(), "rotations": q.tolist()}


def npz64(path, arrays):
    """An archive with a zip64 directory: zipfile is told that two entries are too many for the plain one."""
    limit, zipfile.ZIP_FILECOUNT_LIMIT = zipfile.ZIP_FILECOUNT_LIMIT, 2
    np.savez(path, **arrays)
    zipfile.ZIP_FILECOUNT_LIMIT = limit
    assert b"PK\x06\x06" in path.read_bytes()


def npz_versions(path, arrays):
    """Header versions 1, 2 and 3 in turn."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as z:
        for i, (key, value) in enumerate(arrays.items()):
            with io.BytesIO() as f:
                np.lib.format.write_array(f, np.asanyarray(value), version=(1 + i % 3, 0))
                z.writestr(zipfile.ZipInfo(key + ".npy"), f.getvalue())


def amass(rng):
    folder = GOLDEN / "amass"
    poses, trans = motion(rng, 52)
    betas = rng.normal(size=16)
    rest = {"betas": betas, "dmpls": np.zeros((FRAMES, 8))}
    x_poses, _ = motion(rng, 55)
    f32, f16 = poses.astype(np.float32), poses.astype(np.float16)
    expected = {
        "f64": expected_amass(poses, trans, 120.0),
        "f32": expected_amass(f32, trans.astype(np.float32), 59.99),
        "f16": expected_amass(f16, trans.astype(np.float16), 250.0),
        "smplx": expected_amass(x_poses, trans, 30.0),
        "smpl": expected_amass(poses[:, :72], trans, 60.0, hands=True),
    }
    files = {}

    def note(name, values, **about):
        files[name] = {"values": values, "model": "SMPL+H", "gender": "", "betas": 0, **about}
        return folder / name

    whole = {"poses": poses, "trans": trans, "mocap_framerate": np.array(120.0), **rest}
    np.savez_compressed(note("deflated.npz", "f64", gender="male", betas=16), gender="male", **whole)
    np.savez(note("stored.npz", "f64", gender="female", betas=16), gender=np.bytes_("female"), **whole)
    np.savez_compressed(
        note("f32_fortran.npz", "f32", gender="neutral"),
        poses=np.asfortranarray(f32),
        trans=np.asfortranarray(trans.astype(np.float32)),
        mocap_framerate=np.array([59.99]),
        gender=np.array(["neutral"]),
    )
    np.savez_compressed(
        note("big_endian.npz", "f64", gender="féminin", betas=16),
        poses=np.asfortranarray(poses.astype(">f8")),
        trans=trans.astype(">f8"),
        betas=betas.astype(">f4"),
        mocap_framerate=np.array(120, ">i8"),
        gender=np.array("féminin", ">U9"),
    )
    np.savez_compressed(
        note("f16_object_text.npz", "f16", gender="male"),
        poses=f16,
        trans=trans.astype(np.float16),
        mocap_framerate=np.array(250, np.uint8),
        gender=np.array("male", dtype=object),
    )
    npz64(note("zip64.npz", "f64", gender="male", betas=16), {"gender": "male", **whole})
    npz_versions(note("versions.npz", "f64", betas=16), whole)
    np.savez_compressed(note("joints_axis.npz", "f64"), poses=poses.reshape(FRAMES, 52, 3), trans=trans, mocap_framerate=120)
    np.savez_compressed(note("smpl.npz", "smpl", model="SMPL"), poses=poses[:, :72], trans=trans, mocap_framerate=60)
    smplx = {
        "trans": trans,
        "gender": "neutral",
        "surface_model_type": "smplx",
        "mocap_frame_rate": np.array(30.0),
        "mocap_time_length": np.array(FRAMES / 30),
        "num_betas": np.array(16),
        "betas": betas,
        "markers_obs": np.array([{"a": 1}, None], dtype=object),  # not asked for, so not refused
    }
    about = {"model": "SMPL-X", "gender": "neutral", "betas": 16}
    np.savez_compressed(note("a_stageii.npz", "smplx", **about), poses=x_poses, **smplx)
    parts = {"root_orient": x_poses[:, :3], "pose_body": x_poses[:, 3:66], "pose_jaw": x_poses[:, 66:69]}
    parts |= {"pose_eye": x_poses[:, 69:75], "pose_hand": x_poses[:, 75:]}
    np.savez_compressed(note("split_stageii.npz", "smplx", **about), **parts, **smplx)

    faults = {}

    def fault(name, kind, says, **arrays):
        faults[name] = {"kind": kind, "says": says}
        np.savez_compressed(folder / name, **arrays)

    bad = poses.copy()
    bad[1, 13] = np.nan
    fault("shape.npz", "no_motion", "betas gender", gender="male", betas=betas)
    fault("no_trans.npz", "npz_key_missing", "the keys mocap_framerate poses, expected trans", poses=f16, mocap_framerate=60)
    fault("no_rate.npz", "npz_key_missing", "mocap_framerate or mocap_frame_rate", poses=f16, trans=trans)
    fault("rate_zero.npz", "rate_bad", "0", poses=f16, trans=trans, mocap_framerate=0)
    fault("rate_text.npz", "npz_dtype", "mocap_framerate: <U2", poses=f16, trans=trans, mocap_framerate="60")
    fault("width.npz", "npz_shape", "(2, 100)", poses=f16[:, :100], trans=trans, mocap_framerate=60)
    fault("lengths.npz", "npz_shape", "(1, 3), expected (2, 3)", poses=f16, trans=trans[:1], mocap_framerate=60)
    fault("nan.npz", "not_finite", "frame 1, joint 4 (left_knee)", poses=bad, trans=trans, mocap_framerate=60)
    fault("inf.npz", "not_finite", "frame 0", poses=f16, trans=trans * np.inf, mocap_framerate=60)
    fault("complex.npz", "npz_dtype", "<c8", poses=f32[:, :72].astype(np.complex64), trans=trans, mocap_framerate=60)
    fault("record.npz", "npz_dtype", "[('a'", poses=np.zeros(2, [("a", "<f8"), ("b", "<i4")]), trans=trans)
    objects = np.array([[1.0, 2], [3, {}]], dtype=object)
    fault("object.npz", "npz_object", "poses: an array of Python objects", poses=objects, trans=trans, mocap_framerate=60)
    said = {**HEADER, "expected": expected, "files": files, "faults": faults}
    (folder / "expected.json").write_text(lines(said))


class OldNames(pickle._Pickler):
    """Names as numpy 1 wrote them."""

    def save_global(self, obj, name=None):
        module = {"numpy._core.multiarray": "numpy.core.multiarray", "numpy._core.numeric": "numpy.core.numeric"}
        module = module.get(getattr(obj, "__module__", None)) or ("numpy.core.multiarray" if name is None else None)
        builtin = obj.__name__ in ("_reconstruct", "scalar", "_frombuffer")
        if not builtin:
            return super().save_global(obj, name)
        module = "numpy.core.numeric" if obj.__name__ == "_frombuffer" else "numpy.core.multiarray"
        if self.proto >= 4:
            self.save(module)
            self.save(obj.__name__)
            self.write(pickle.STACK_GLOBAL)
        else:
            self.write(pickle.GLOBAL + f"{module}\n{obj.__name__}\n".encode())
        self.memoize(obj)

    dispatch = pickle._Pickler.dispatch.copy()
    dispatch[type(np.zeros)] = save_global
    dispatch[type(pickle._dumps)] = save_global


class Python2(OldNames):
    """Text and bytes alike as Python 2 wrote them; protocols 0 to 2."""

    def save_string(self, obj):
        raw = obj if isinstance(obj, bytes) else obj.encode("latin1")
        if self.proto == 0:
            quoted = "".join(chr(b) if 32 <= b < 127 and b not in b"\\'" else f"\\x{b:02x}" for b in raw)
            self.write(b"S'" + quoted.encode() + b"'\n")
        elif len(raw) < 256:
            self.write(b"U" + bytes([len(raw)]) + raw)
        else:
            self.write(b"T" + len(raw).to_bytes(4, "little") + raw)
        self.memoize(obj)

    dispatch = OldNames.dispatch.copy()
    dispatch[str] = save_string
    dispatch[bytes] = save_string


def dumped(pickler, value, protocol):
    with io.BytesIO() as f:
        pickler(f, protocol).dump(value)
        return f.getvalue()


def aist(rng):
    folder = GOLDEN / "aist"
    poses, trans = motion(rng, 24)
    trans *= 93.5
    f32 = poses.astype(np.float32)
    expected = {"f64": expected_aist(poses, trans, 93.5), "f32": expected_aist(f32, trans.astype(np.float32), 93.5)}
    files = {}

    def put(name, values, pickled):
        files[name] = values
        (folder / name).write_bytes(pickled)

    whole = {"smpl_loss": 1.25, "smpl_poses": poses, "smpl_scaling": np.array([93.5]), "smpl_trans": trans}
    for protocol in range(6):
        put(f"protocol{protocol}.pkl", "f64", pickle.dumps(whole, protocol))
    for protocol in (0, 2, 3, 4, 5):
        put(f"numpy1_protocol{protocol}.pkl", "f64", dumped(OldNames, whole, protocol))
    for protocol in (0, 1, 2):
        put(f"python2_protocol{protocol}.pkl", "f64", dumped(Python2, whole, protocol))
    single = {
        "smpl_loss": np.float64(3),  # a numpy scalar
        "smpl_poses": np.asfortranarray(f32.astype(">f4")),
        "smpl_scaling": np.float32(93.5),
        "smpl_trans": np.repeat(trans.astype(np.float32), 2, axis=0)[::2],  # not contiguous
        "names": ("a", b"b", None, True, [1, -2, 300, 70000, 2**40, {}]),
    }
    for protocol in (2, 4, 5):
        put(f"single_protocol{protocol}.pkl", "f32", pickle.dumps(single, protocol))
    # memory order joint, frame, component: numpy's order K
    axes = poses.reshape(FRAMES, 24, 3).transpose(1, 0, 2).copy().transpose(1, 0, 2)
    put("axes_protocol5.pkl", "f64", pickle.dumps({**whole, "smpl_poses": axes}, 5))
    put("axes_protocol2.pkl", "f64", pickle.dumps({**whole, "smpl_poses": axes}, 2))
    for name in files:
        loaded = pickle.loads((folder / name).read_bytes(), encoding="latin1")
        want = poses if files[name] == "f64" else f32
        assert np.array_equal(loaded["smpl_poses"].reshape(FRAMES, 72), want), name
    (folder / "expected.json").write_text(lines({**HEADER, "expected": expected, "files": files}))


def body(rng):
    """Random vertices in place of a body; what counts is the arithmetic."""
    folder = GOLDEN / "body"
    vertices, shapes = 40, 3
    v_template = rng.normal(size=(vertices, 3))
    shapedirs = rng.normal(size=(vertices, 3, shapes)) * 0.1
    betas = rng.normal(size=16)

    def regressor(n):
        weights = rng.random((n, vertices)) * (rng.random((n, vertices)) < 0.15)
        weights[np.arange(n), rng.integers(0, vertices, n)] = 0.5
        return weights / weights.sum(axis=1, keepdims=True)

    def joints(weights, shape):
        return weights @ (v_template + shapedirs[:, :, : len(shape)] @ shape[:shapes])

    def offsets(places, hands):
        places = np.concatenate([places[:22], hands])
        return [[0.0] * 3] + [(places[j] - places[PARENTS[j]]).tolist() for j in range(1, 24)]

    def said(weights, shape, hands):
        places = joints(weights, shape)
        return {"rest_pelvis": places[0].tolist(), "offsets": offsets(places, np.array([places[h].mean(0) for h in hands]))}

    files = {}
    own = [[22], [23]]
    smpl = regressor(24)
    mesh = {"v_template": v_template, "shapedirs": shapedirs}
    tree = np.array([PARENTS, range(24)]).astype(np.uint32)  # the root's parent becomes 2^32 - 1
    np.savez_compressed(folder / "dense.npz", J_regressor=smpl, kintree_table=tree, **mesh)
    files["dense.npz"] = {"mean": said(smpl, np.zeros(3), own), "shaped": said(smpl, betas[:3], own)}
    for kind in ("csr", "csc"):
        m = sparse.csr_array(smpl).asformat(kind)
        parts = {"data": m.data, "indices": m.indices, "indptr": m.indptr, "shape": m.shape}
        np.savez_compressed(folder / f"{kind}.npz", **{f"J_regressor_{k}": v for k, v in parts.items()}, **mesh)
        files[f"{kind}.npz"] = files["dense.npz"]
    m = sparse.coo_array(smpl)
    parts = {"data": m.data, "row": m.row, "col": m.col, "shape": m.shape}
    np.savez_compressed(folder / "coo.npz", **{f"J_regressor_{k}": v for k, v in parts.items()}, **mesh)
    files["coo.npz"] = files["dense.npz"]
    np.savez_compressed(folder / "own_betas.npz", J_regressor=smpl, betas=betas[:2], **mesh)
    files["own_betas.npz"] = {"mean": said(smpl, betas[:2], own), "shaped": said(smpl, betas[:2], own)}
    j_only = joints(smpl, np.zeros(3))
    np.savez_compressed(folder / "joints.npz", J=j_only.astype(np.float32), J_regressor=np.array({}, dtype=object))
    fixed = said(smpl, np.zeros(3), own)
    files["joints.npz"] = {"mean": fixed, "shaped": fixed}
    # SMPL+H: five fingers of three joints on each wrist
    fingers = [20 if i % 3 == 0 else 21 + i for i in range(15)] + [21 if i % 3 == 0 else 36 + i for i in range(15)]
    smplh = regressor(52)
    tree = np.array([PARENTS[:22] + fingers, range(52)], dtype=np.int64)
    np.savez_compressed(folder / "smplh.npz", J_regressor=smplh, kintree_table=tree, **mesh)
    hands = [[22, 25, 28, 31, 34], [37, 40, 43, 46, 49]]
    files["smplh.npz"] = {"mean": said(smplh, np.zeros(3), hands), "shaped": said(smplh, betas[:3], hands)}
    (folder / "expected.json").write_text(lines({**HEADER, "betas": betas.tolist(), "files": files}))


def check(folder):
    """What our own writers made, loaded by numpy without pickles."""
    want = json.loads((folder / "clip.json").read_text())
    q, root = np.array(want["rotations"]), np.array(want["root"])
    with np.load(folder / "amass.npz", allow_pickle=False) as z:
        assert sorted(z.files) == ["betas", "gender", "mocap_framerate", "poses", "trans"], z.files
        assert z["poses"].dtype == "<f8" and z["poses"].shape == (len(root), 156) and not z["poses"][:, 66:].any()
        assert z["betas"].shape == (16,) and not z["betas"].any()
        assert z["gender"].shape == () and str(z["gender"]) == "neutral" and z["gender"].dtype.kind == "U"
        assert z["mocap_framerate"].shape == () and z["mocap_framerate"] == want["fps"]
        got = Rotation.from_rotvec(z["poses"][:, :66].reshape(-1, 3))
        ours = Rotation.from_quat(np.roll(q[:, :22], -1, axis=-1).reshape(-1, 4))
        angle = (got.inv() * ours).magnitude().reshape(len(root), 22)
        angle[:, 0] = (Rotation.from_rotvec(z["poses"][:, :3]).inv() * TURN.inv() *
                       Rotation.from_quat(np.roll(q[:, 0], -1, axis=-1))).magnitude()
        assert angle.max() < 1e-9 and np.abs(TURN.apply(z["trans"] + J0) - root).max() < 1e-9, angle.max()
        print("amass.npz:", len(root), "frames, largest angle", angle.max())
    with np.load(folder / "positions.npz", allow_pickle=False) as z:
        assert sorted(z.files) == ["fps", "joints", "parents", "positions"], z.files
        assert z["positions"].dtype == "<f4" and z["positions"].shape == (len(root), 24, 3)
        assert z["joints"].dtype.kind == "U" and z["joints"].tolist() == want["names"]
        assert z["parents"].dtype == "<i4" and z["parents"].tolist() == want["parents"]
        assert z["fps"].shape == () and z["fps"].dtype == "<f8" and z["fps"] == want["fps"]
        assert np.array_equal(z["positions"][:, 0], root.astype(np.float32))
        places, turns = np.zeros((len(root), 24, 3)), [None] * 24
        for j, parent in enumerate(want["parents"]):
            local = Rotation.from_quat(np.roll(q[:, j], -1, axis=-1))
            turns[j] = local if j == 0 else turns[parent] * local
            places[:, j] = root if j == 0 else places[:, parent] + turns[parent].apply(want["offsets"][j])
        assert np.abs(places - z["positions"]).max() < 1e-6
        print("positions.npz: largest difference", np.abs(places - z["positions"]).max())


if __name__ == "__main__":
    warnings.simplefilter("ignore", DeprecationWarning)  # numpy 1's names are meant
    if sys.argv[1:2] == ["--check"]:
        check(pathlib.Path(sys.argv[2]))
    else:
        for make in (amass, aist, body):
            make(np.random.default_rng(SEED))
