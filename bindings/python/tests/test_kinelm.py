"""The package as a user has it. python -m unittest, with the package on the path; scripts/python.sh does both."""

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import kinelm

JOINTS = "root,torso,right_arm"


class Kinelm(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        os.environ["XDG_CACHE_HOME"] = cls.folder.name
        cls.at = Path(cls.folder.name)
        cls.model = kinelm.Model.ready()
        cls.dance = cls.model.generate(seconds=4, labels={"genre": "salsa"}, seed=3)
        cls.dance.write(cls.at / "dance.bvh")

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def in_order_of(self, clip):
        """The dance's positions in the order of a file's joints, which is depth first."""
        return self.dance.positions()[:, [self.dance.joints.index(name) for name in clip.joints]]

    def test_arrays(self):
        dance = self.dance
        self.assertEqual((len(dance), dance.fps, dance.duration), (80, 20.0, 4.0))
        self.assertEqual(dance.rotations.shape, (80, 24, 4))
        self.assertEqual((dance.root.shape, dance.offsets.shape, dance.positions().shape), ((80, 3), (24, 3), (80, 24, 3)))
        np.testing.assert_allclose(np.linalg.norm(dance.rotations, axis=2), 1)
        np.testing.assert_allclose(dance.positions()[:, 0], dance.root)
        arrays = (dance.joints, dance.parents, dance.offsets, dance.root, dance.rotations)
        again = kinelm.Clip(*arrays, dance.fps)
        np.testing.assert_array_equal(again.positions(), dance.positions())
        with self.assertRaises(kinelm.Error) as raised:
            kinelm.Clip(*arrays[:4], dance.rotations[:, :, :3], 20)
        self.assertEqual(raised.exception.kind, "call")

    def test_files(self):
        clip = kinelm.Clip.read(self.at / "dance.bvh")
        np.testing.assert_allclose(clip.positions(), self.in_order_of(clip), atol=1e-5)
        self.assertEqual(clip.resample(30).frames, 119)  # to the last frame, 3.95 s
        self.assertEqual(clip.slice(10, 30).frames, 20)
        self.assertEqual(clip.retarget("smpl").joints[0], "pelvis")
        with self.assertRaisesRegex(kinelm.Error, "force=True"):
            clip.write(self.at / "dance.bvh")
        with self.assertRaises(kinelm.Error) as raised:
            kinelm.Clip.read(self.at / "none.bvh")
        self.assertEqual(raised.exception.kind, "io")
        self.assertIn("none.bvh", str(raised.exception))
        self.assertTrue(clip._repr_html_().startswith("<iframe"))

    def test_tokenizer(self):
        tokenizer = kinelm.Tokenizer.fit([self.dance])
        ids = tokenizer.encode(self.dance)
        self.assertEqual((ids.dtype, len(ids)), (np.uint32, 80 * tokenizer.tokens_per_word))
        back = tokenizer.decode(ids)
        far = np.linalg.norm(back.positions() - self.dance.positions(), axis=2)
        self.assertLess(far.mean(), 0.02)
        tokenizer.save(self.at / "tokenizer.json")
        np.testing.assert_array_equal(kinelm.Tokenizer.load(self.at / "tokenizer.json").encode(self.dance), ids)
        self.assertEqual(tokenizer.decode(np.random.default_rng(1).integers(0, tokenizer.vocabulary, 999, np.uint32)).fps, 20)

    def test_dances(self):
        follows = self.model.generate(self.at / "dance.bvh", joints=JOINTS, rig="prompt")
        self.assertEqual(follows.frames, 80)
        again = self.model.generate(self.at / "dance.bvh", joints=JOINTS, rig="prompt")
        np.testing.assert_array_equal(follows.rotations, again.rotations)
        edited = self.model.generate(self.at / "dance.bvh", free=["all@1s:2s"])
        np.testing.assert_allclose(edited.positions()[:15], self.in_order_of(edited)[:15], atol=1e-5)
        self.assertGreater(self.model.bits_per_frame(self.at / "dance.bvh"), 10)
        with self.assertRaisesRegex(kinelm.Error, "genre"):
            self.model.generate(seconds=1, labels={"genre": "waltz"})
        with self.assertRaisesRegex(kinelm.Error, "config.toml"):
            kinelm.Model.open(self.at)

    def test_program(self):
        call = [sys.executable, "-m", "kinelm", "inspect", str(self.at / "dance.bvh")]
        self.assertIn("80 frames at 20 fps", subprocess.run(call, capture_output=True, text=True, check=True).stdout)
        self.assertEqual(subprocess.run([*call[:3], "inspect"], capture_output=True).returncode, 2)


if __name__ == "__main__":
    unittest.main()
