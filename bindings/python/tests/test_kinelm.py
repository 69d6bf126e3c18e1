"""The package as a user has it. python -m unittest, with the package on the path; scripts/python.sh does both."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
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
        self.assertEqual((len(dance), dance.fps, dance.duration), (120, 30.0, 4.0))
        self.assertEqual(dance.rotations.shape, (120, 24, 4))
        self.assertEqual((dance.root.shape, dance.offsets.shape, dance.positions().shape), ((120, 3), (24, 3), (120, 24, 3)))
        np.testing.assert_allclose(np.linalg.norm(dance.rotations, axis=2), 1)
        np.testing.assert_allclose(dance.positions()[:, 0], dance.root)
        arrays = (dance.joints, dance.parents, dance.offsets, dance.root, dance.rotations)
        again = kinelm.Clip(*arrays, dance.fps)
        np.testing.assert_array_equal(again.positions(), dance.positions())
        with self.assertRaises(kinelm.Error) as raised:
            kinelm.Clip(*arrays[:4], dance.rotations[:, :, :3], 20)
        self.assertEqual(raised.exception.kind, "call")

    def test_compare(self):
        found = kinelm.compare(self.dance, self.dance.slice(12, 120))
        self.assertEqual((found["lag_frames"], found["mirrored"], found["frames"]), (-12, False, 108))
        self.assertLess(found["distance_cm"], 0.01)
        arm = kinelm.compare(self.dance, self.dance, joints="left_arm", band=np.float64(0.5))
        self.assertEqual({row["joint"] for row in arm["joints"]} - {f"left_{j}" for j in ("collar", "shoulder", "elbow", "wrist", "hand")}, set())
        with self.assertRaisesRegex(kinelm.Error, "band") as raised:
            kinelm.compare(self.dance, self.dance, band=0)
        self.assertEqual(raised.exception.kind, "call")

    def test_files(self):
        clip = kinelm.Clip.read(self.at / "dance.bvh")
        np.testing.assert_allclose(clip.positions(), self.in_order_of(clip), atol=1e-5)
        self.assertEqual(clip.resample(60).frames, 239)  # to the last frame, 3.97 s
        self.assertEqual(clip.slice(10, 30).frames, 20)
        self.assertEqual(clip.retarget("smpl").joints[0], "pelvis")
        with self.assertRaisesRegex(kinelm.Error, "force=True"):
            clip.write(self.at / "dance.bvh")
        with self.assertRaises(kinelm.Error) as raised:
            kinelm.Clip.read(self.at / "none.bvh")
        self.assertEqual(raised.exception.kind, "io")
        self.assertIn("none.bvh", str(raised.exception))
        self.assertEqual((Path(raised.exception.path).name, raised.exception.line), ("none.bvh", None))
        (self.at / "bad.bvh").write_text("HIERARCHY\nROOT hips\n{\n  OFFSET 0 zero 0\n")
        with self.assertRaises(kinelm.Error) as raised:
            kinelm.Clip.read(self.at / "bad.bvh")
        self.assertEqual((raised.exception.kind, raised.exception.line), ("file", 4))
        with self.assertRaises(kinelm.Error) as raised:
            self.model.generate(seconds=1, top_p=7)
        self.assertEqual((raised.exception.parameter, raised.exception.found), ("top_p", "7"))
        self.assertTrue(clip._repr_html_().startswith("<iframe"))

    def test_tokenizer(self):
        tokenizer = kinelm.Tokenizer.fit([self.dance])
        ids = tokenizer.encode(self.dance)
        self.assertEqual((ids.dtype, len(ids)), (np.uint32, 80 * tokenizer.tokens_per_word))
        back = tokenizer.decode(ids)
        far = np.linalg.norm(back.positions() - self.dance.resample(20).positions(), axis=2)
        self.assertLess(far.mean(), 0.02)
        tokenizer.save(self.at / "tokenizer.json")
        np.testing.assert_array_equal(kinelm.Tokenizer.load(self.at / "tokenizer.json").encode(self.dance), ids)
        self.assertEqual(tokenizer.decode(np.random.default_rng(1).integers(0, tokenizer.vocabulary, 999, np.uint32)).fps, 20)

    def test_dances(self):
        follows = self.model.generate(self.at / "dance.bvh", joints=JOINTS, rig="prompt")
        self.assertEqual((follows.frames, follows.fps), (120, 30.0))
        on_its_rig = self.model.generate(self.at / "dance.bvh", rig="prompt", seconds=1, fps=60)
        self.assertEqual((on_its_rig.frames, on_its_rig.fps, set(on_its_rig.joints)), (60, 60.0, set(follows.joints)))
        again = self.model.generate(self.at / "dance.bvh", joints=JOINTS, rig="prompt")
        np.testing.assert_array_equal(follows.rotations, again.rotations)
        edited = self.model.generate(self.at / "dance.bvh", free=["all@1s:2s"])
        np.testing.assert_allclose(edited.positions()[:25], self.in_order_of(edited)[:25], atol=1e-5)
        self.assertGreater(self.model.bits_per_frame(self.at / "dance.bvh"), 10)
        with self.assertRaisesRegex(kinelm.Error, "genre"):
            self.model.generate(seconds=1, labels={"genre": "waltz"})
        with self.assertRaisesRegex(kinelm.Error, "config.toml"):
            kinelm.Model.open(self.at)
        latest = kinelm.Model.open(self.model.run, checkpoint="latest").generate(seconds=1)
        np.testing.assert_array_equal(latest.rotations, self.model.generate(seconds=1).rotations)
        with self.assertRaisesRegex(kinelm.Error, "no checkpoint of step 3, expected"):
            kinelm.Model.open(self.model.run, checkpoint=3).generate(seconds=1)
        with self.assertRaisesRegex(kinelm.Error, "expected a step, latest or best"):
            kinelm.Model.open(self.model.run, checkpoint="first")

    def test_prompts_in_memory_and_progress(self):
        clip, said = kinelm.Clip.read(self.at / "dance.bvh"), []
        edited = self.model.generate(clip, free=["left_arm@1s:2s"], callback=said.append)
        changed = np.abs(edited.rotations - clip.rotations).max(axis=(1, 2)) > 0
        self.assertEqual(np.flatnonzero(changed).tolist(), list(range(30, 60)))
        np.testing.assert_array_equal(edited.root, clip.root)
        self.assertEqual(said[-1]["frames"], said[-1]["of"])
        with self.assertRaises(kinelm.Error) as stopped:
            self.model.variations(2, clip, rig="prompt", seconds=60, callback=lambda said: said["frames"] < 5)
        self.assertEqual(stopped.exception.kind, "stopped")
        self.assertEqual(clip.humanoid()["left_hip"], "left_hip")
        self.assertEqual(len(clip.lock_feet()), len(clip))

    def test_options(self):
        self.assertEqual(len(self.model.variations(3, seconds=np.float64(1), seed=np.int64(5))), 3)
        with self.assertRaisesRegex(TypeError, "unknown field `second`, expected one of"):
            self.model.generate(second=1)
        with self.assertRaisesRegex(TypeError, "invalid type"):
            self.model.generate(seconds="1")
        with self.assertRaisesRegex(kinelm.Error, "up is"):
            kinelm.Clip.read(self.at / "dance.bvh", up="w")

    def test_frames_as_they_are_sampled(self):
        given = {"labels": {"genre": "salsa"}, "seed": 3, "seconds": 4}
        frames = list(self.model.frames(**given))
        whole = self.model.generate(**given, lock_feet=False, fps=20)
        np.testing.assert_allclose(frames, whole.positions(), atol=1e-9)
        some = self.model.frames(self.at / "dance.bvh", free=["all@1s:2s"])
        prompt = kinelm.Clip.read(self.at / "dance.bvh")
        np.testing.assert_allclose(next(some)[0], prompt.root[0], atol=0.01)

    def test_interrupt(self):
        code = "import kinelm, sys; print(1, flush=True); kinelm.Model.ready().generate(seconds=600)"
        child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        child.stdout.readline()
        time.sleep(1)
        child.send_signal(signal.SIGINT)
        self.assertIn(b"KeyboardInterrupt", child.communicate(timeout=20)[1])

    def test_corpora_training_and_what_stands_on_them(self):
        data, at = self.at / "dances", self.at
        data.mkdir()
        for i, dance in enumerate(self.model.variations(8, seconds=4, seed=7)):
            dance.write(data / f"{'ab'[i % 2]}_{i}.bvh")
        tokenizer = kinelm.Tokenizer.load(Path(self.model.run) / "tokenizer.json")
        corpus = kinelm.Corpus.build(data, at / "corpus", tokenizer=tokenizer, labels=["{genre}_*"])
        self.assertEqual((len(corpus), len(corpus.tokens)), (8, sum(clip["tokens"] for clip in corpus.clips())))
        clip = corpus.clips("train")[0]
        self.assertEqual(clip["labels"]["genre"], clip["name"][0])
        own = corpus.tokens[clip["offset"] : clip["offset"] + clip["tokens"]]
        np.testing.assert_array_equal(own, tokenizer.encode(kinelm.Clip.read(data / (clip["name"] + ".bvh"))))

        word = tokenizer.tokens_per_word
        sequences = corpus.sequences("train", context=10 * word, conditions=["genre"])
        ids, labels = sequences.arrays()
        self.assertEqual(ids.shape, labels.shape)
        counted = labels[labels != -100]
        self.assertEqual(len(counted), sum(clip["tokens"] for clip in corpus.clips("train")))
        np.testing.assert_array_equal(ids[:, 1:][labels[:, :-1] != -100], labels[:, :-1][labels[:, :-1] != -100])
        np.testing.assert_array_equal(sequences[-1]["input_ids"], ids[-1])
        self.assertRaises(IndexError, lambda: sequences[len(sequences)])

        said = []
        run = kinelm.finetune(self.model, at / "corpus", at / "run", steps=3, callback=said.append)
        self.assertEqual([m["step"] for m in said if "loss" in m], [1, 2, 3])
        self.assertLess(run.likelihood(corpus, "train")["bits_per_frame"], 200)
        stopped = kinelm.finetune(self.model, at / "corpus", at / "stopped", steps=3, callback=lambda m: m.get("step", 0) < 2)
        self.assertEqual(kinelm.resume(stopped.run).generate(seconds=1, seed=1).frames, 30)
        with self.assertRaises(ZeroDivisionError):
            kinelm.finetune(self.model, at / "corpus", at / "raised", steps=3, callback=lambda m: 1 / 0)

        index = kinelm.Index.build(data, at / "index", window=64, hop=16)
        found = index.find(data / "a_0.bvh", k=2, exclude="none")
        self.assertEqual((len(found), found[0]["clip"]), (2, "a_0"))
        with self.assertRaisesRegex(kinelm.Error, "distance is"):
            index.find(data / "a_0.bvh", distance="far")

        classifier = kinelm.Classifier.train(self.model.run, corpus, ["genre"], at / "classes", steps=2, batch=2)
        field = classifier.predict(data / "a_0.bvh")["fields"][0]
        self.assertAlmostEqual(sum(p for _, p in field["probabilities"]), 1)

        report = kinelm.evaluate([data / "a_0.bvh", data / "b_1.bvh"], corpus)
        self.assertEqual([group["name"] for group in report["groups"]][:3], ["train", "valid", "dances"])

    def test_program(self):
        call = [sys.executable, "-m", "kinelm", "inspect", str(self.at / "dance.bvh")]
        self.assertIn("120 frames at 30 fps", subprocess.run(call, capture_output=True, text=True, check=True).stdout)
        self.assertEqual(subprocess.run([*call[:3], "inspect"], capture_output=True).returncode, 2)


class Notebook(unittest.TestCase):
    def test_it_runs(self):
        notebook = json.loads((Path(__file__).parents[1] / "examples/from_files_to_a_dance.ipynb").read_text())
        names, here = {}, os.getcwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                for cell in notebook["cells"]:
                    if cell["cell_type"] == "code":
                        exec("".join(cell["source"]), names)
            finally:
                os.chdir(here)
        self.assertGreater(len(names["corpus"]), 0)
        self.assertLess(names["far"].mean(), 0.05)


class Loaders(unittest.TestCase):
    """Sequences as other libraries take them."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        at = Path(cls.folder.name)
        model = kinelm.Model.ready()
        (at / "data").mkdir()
        for i, dance in enumerate(model.variations(4, seconds=3)):
            dance.write(at / "data" / f"{i}.bvh")
        tokenizer = kinelm.Tokenizer.load(Path(model.run) / "tokenizer.json")
        cls.sequences = kinelm.Corpus.build(at / "data", at / "corpus", tokenizer=tokenizer).sequences(context=581)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_torch(self):
        try:
            import torch
        except ImportError:
            self.skipTest("no torch")
        batch = next(iter(torch.utils.data.DataLoader(self.sequences, batch_size=2, shuffle=True)))
        self.assertEqual((batch["input_ids"].shape, batch["labels"].dtype), ((2, 581), torch.int64))

    def test_datasets(self):
        try:
            import datasets
        except ImportError:
            self.skipTest("no datasets")
        view = datasets.Dataset.from_generator(lambda: iter(self.sequences), cache_dir=self.folder.name)
        self.assertEqual((len(view), len(view[0]["input_ids"])), (len(self.sequences), 581))


if __name__ == "__main__":
    unittest.main()
