"""Numbers that become sizes, and files that are there."""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

import kinelm
from calls import World

# as many gigabytes of address space: what allocates by a wrong number ends the process
GIGABYTES = 16
HUGE = [10**13, 2**31, 2**32, 2**63 - 1, 2**64 - 1, 10**30, -1, 0]
ODD = [-1.0, 0.0, 1e-300, 1e300, float("inf"), float("nan")]


def numbers(w):
    """Every numeric argument: its name, the numbers, and the call that takes one."""
    clip, file, corpus, model = w.clip, w.file, w.corpus, w.model
    one = {"seconds": 0.2}
    train = {"steps": 1, "batch": 2}
    classes = lambda **more: kinelm.Classifier.train(w.run, corpus, ["genre"], w.new(), **{**train, **more})
    return [
        ("Clip parents", HUGE, lambda n: kinelm.Clip(["a", "b"], [None, n], np.zeros((2, 3)), np.zeros((1, 3)), np.ones((1, 2, 4)), 30)),
        ("Clip fps", ODD, lambda x: kinelm.Clip(*w.arrays(), x)),
        ("Clip.read skip", HUGE, lambda n: kinelm.Clip.read(file, skip=n)),
        ("Clip.read fps_source", ODD, lambda x: kinelm.Clip.read(file, fps_source=x)),
        ("Clip.resample", [*ODD, 1e4, 1e9], lambda x: clip.resample(x)),
        ("Clip.slice start", HUGE, lambda n: clip.slice(n, 9)),
        ("Clip.slice stop", HUGE, lambda n: clip.slice(0, n)),
        ("Tokenizer.fit fps", ODD, lambda x: kinelm.Tokenizer.fit([clip], fps=x)),
        ("Tokenizer.fit bins", HUGE, lambda n: kinelm.Tokenizer.fit([clip], bins=n)),
        ("Tokenizer.fit floor", ODD, lambda x: kinelm.Tokenizer.fit([clip], floor=x)),
        ("Tokenizer.encode floor", ODD, lambda x: w.tokenizer.encode(clip, floor=x)),
        ("Tokenizer.decode", [2**32 - 1], lambda n: w.tokenizer.decode(np.full(99, n, np.uint32))),
        ("sequences context", HUGE, lambda n: corpus.sequences(context=n)[0]),
        ("sequences arrays", [*HUGE, 2**20], lambda n: corpus.sequences(context=n).arrays() and None),
        ("sequences index", HUGE, lambda n: w.sequences[n]),
        ("variations count", HUGE, lambda n: model.variations(n, **one)),
        ("generate seconds", ODD, lambda x: model.generate(seconds=x)),
        ("generate frames", HUGE, lambda n: model.generate(frames=n)),
        ("generate fps", [*ODD, 1e9], lambda x: model.generate(fps=x, **one)),
        ("generate from_frame", HUGE, lambda n: model.generate(file, from_frame=n, seconds=0.2)),
        ("generate seed", HUGE, lambda n: model.generate(seed=n, **one)),
        ("generate guidance", ODD, lambda x: model.generate(guidance=x, labels={"genre": "salsa"}, **one)),
        ("generate temperature", ODD, lambda x: model.generate(temperature=x, **one)),
        ("generate top_p", ODD, lambda x: model.generate(top_p=x, **one)),
        ("frames frames", HUGE, lambda n: next(model.frames(frames=n))),
        ("bits_per_frame skip", HUGE, lambda n: model.bits_per_frame(file, skip=n)),
        ("Index.build window", HUGE, lambda n: kinelm.Index.build(w.data, w.new(), window=n)),
        ("Index.build hop", HUGE, lambda n: kinelm.Index.build(w.data, w.new(), window=32, hop=n)),
        ("Index.build fps", ODD, lambda x: kinelm.Index.build(w.data, w.new(), window=32, hop=16, fps=x)),
        ("Index.find k", HUGE, lambda n: w.index.find(file, k=n)),
        ("Index.find at", ODD, lambda x: w.index.find(file, at=x)),
        ("Classifier.train steps", [2**64, 10**30, -1, 0], lambda n: classes(steps=n)),
        ("Classifier.train batch", HUGE, lambda n: classes(batch=n)),
        ("Classifier.train seed", HUGE, lambda n: classes(seed=n)),
        ("finetune steps", [2**64, 10**30, -1, 0], lambda n: kinelm.finetune(model, w.at / "corpus", w.new(), steps=n)),
        ("finetune seed", HUGE, lambda n: kinelm.finetune(model, w.at / "corpus", w.new(), steps=1, seed=n)),
        ("resume steps", [2**64, 10**30, -1], lambda n: kinelm.resume(w.stopped, steps=n)),
    ]


def try_all(folder):
    """Prints what each number does: a line before and one after."""
    import resource

    w = World(folder)
    resource.setrlimit(resource.RLIMIT_AS, (GIGABYTES << 30, GIGABYTES << 30))
    for name, values, call in numbers(w):
        for value in values:
            print(json.dumps([name, repr(value)]), flush=True)
            try:
                call(value)
                said = "taken"
            except Exception as e:
                said = f"{type(e).__name__}: {e}"
            print(json.dumps(said), flush=True)


class Limits(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        os.environ["XDG_CACHE_HOME"] = cls.folder.name

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @unittest.skipUnless(sys.platform == "linux", "limits the address space as Linux does")
    def test_no_number_ends_the_interpreter(self):
        folder = Path(self.folder.name, "numbers")
        folder.mkdir()
        code = f"import test_limits; test_limits.try_all({str(folder)!r})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=Path(__file__).parent)
        lines = [json.loads(line) for line in done.stdout.splitlines()]
        self.assertEqual(done.returncode, 0, f"{lines[-1:]}: {done.stderr[-2000:]}")
        said = {tuple(name): text for name, text in zip(lines[::2], lines[1::2])}
        self.assertNotIn("PanicException", str(said))
        refused = lambda name, value, text: self.assertRegex(said[name, repr(value)], text)
        refused("sequences context", 10**13, "context is 10000000000000; expected 1 to 1048576")
        refused("generate seconds", -1.0, "seconds")
        refused("generate seconds", 0.0, "seconds")
        refused("generate frames", 0, "frames")
        refused("generate fps", 1e300, "fps")
        refused("Classifier.train batch", 10**13, "batch.*1 to 65536")
        refused("Index.find k", 10**13, "k is .*; expected 0 to 1048576")
        for value in ODD:
            self.assertIn("Error: ", said["Clip fps", repr(value)])

    def test_rates_that_no_file_has(self):
        dance = kinelm.Model.ready().generate(seconds=0.2)
        arrays = (dance.joints, dance.parents, dance.offsets, dance.root, dance.rotations)
        with self.assertRaises(kinelm.Error) as raised:
            kinelm.Clip(*arrays, 1e300)
        self.assertEqual((raised.exception.parameter, raised.exception.kind), ("fps", "call"))
        for fps in (0.001, 10_000.0):
            kinelm.Clip(*arrays, fps).write(Path(self.folder.name, f"{fps}.json"))

    def test_a_tokenizer_replaces_a_file_only_by_force(self):
        tokenizer = kinelm.Tokenizer.load(Path(kinelm.Model.ready().run, "tokenizer.json"))
        path = Path(self.folder.name, "mine.json")
        path.write_text("mine")
        with self.assertRaisesRegex(kinelm.Error, "mine.json is there; force=True replaces it"):
            tokenizer.save(path)
        self.assertEqual(path.read_text(), "mine")
        tokenizer.save(path, force=True)
        self.assertEqual(kinelm.Tokenizer.load(path).vocabulary, tokenizer.vocabulary)

    def test_arrays_in_any_order_of_memory(self):
        model = kinelm.Model.ready()
        tokenizer = kinelm.Tokenizer.load(Path(model.run, "tokenizer.json"))
        ids = tokenizer.encode(model.generate(seconds=1))
        apart = np.repeat(ids, 2)[::2]
        self.assertFalse(apart.flags.c_contiguous)
        np.testing.assert_array_equal(tokenizer.decode(apart).rotations, tokenizer.decode(ids).rotations)
        backwards = ids[::-1]
        np.testing.assert_array_equal(
            tokenizer.decode(backwards).rotations, tokenizer.decode(backwards.copy()).rotations
        )


if __name__ == "__main__":
    unittest.main()
