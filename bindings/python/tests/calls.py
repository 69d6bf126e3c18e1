"""A call of everything public, on small data: what test_fork.py and test_limits.py go through."""

import tempfile
from pathlib import Path

import numpy as np

import kinelm


class World:
    """Files and objects that calls take."""

    def __init__(self, folder):
        self.at = Path(folder)
        self.model = kinelm.Model.ready()
        self.data = self.at / "data"
        self.data.mkdir()
        for i, dance in enumerate(self.model.variations(6, seconds=3, seed=7)):
            dance.write(self.data / f"{'ab'[i % 2]}_{i}.bvh")
        self.file = self.data / "a_0.bvh"
        self.clip = kinelm.Clip.read(self.file)
        self.json = Path(self.model.run) / "tokenizer.json"
        self.tokenizer = kinelm.Tokenizer.load(self.json)
        self.ids = self.tokenizer.encode(self.clip)
        labels = {"tokenizer": self.tokenizer, "labels": ["{genre}_*"]}
        self.labels = labels
        self.corpus = kinelm.Corpus.build(self.data, self.at / "corpus", **labels)
        self.sequences = self.corpus.sequences(context=581)
        self.run = kinelm.finetune(self.model, self.at / "corpus", self.at / "run", steps=2).run
        self.stopped = self.at / "stopped"
        kinelm.finetune(self.model, self.at / "corpus", self.stopped, steps=3, callback=lambda m: m.get("step", 0) < 1)
        self.index = kinelm.Index.build(self.data, self.at / "index", window=32, hop=16)
        self.classifier = kinelm.Classifier.train(self.run, self.corpus, ["genre"], self.at / "classes", steps=1, batch=2)

    def new(self):
        """A path that is free."""
        return Path(tempfile.mkdtemp(dir=self.at)) / "new"

    def arrays(self):
        """What a clip is made of, but its rate."""
        clip = self.clip
        return clip.joints, clip.parents, clip.offsets, clip.root, clip.rotations


def calls(w):
    """Every public call by its name."""
    return {
        "Clip": lambda: kinelm.Clip(*w.arrays(), 30.0),
        "Clip.read": lambda: kinelm.Clip.read(w.file),
        "Clip.write": lambda: w.clip.write(w.new().with_suffix(".bvh")),
        "Clip.retarget": lambda: w.clip.retarget("smpl"),
        "Clip.resample": lambda: w.clip.resample(20),
        "Clip.slice": lambda: w.clip.slice(0, 9),
        "Clip.positions": lambda: w.clip.positions(),
        "Clip.lock_feet": lambda: w.clip.lock_feet(),
        "Clip.humanoid": lambda: w.clip.humanoid(),
        "Clip.page": lambda: w.clip.page(),
        "Tokenizer.fit": lambda: kinelm.Tokenizer.fit([w.clip]),
        "Tokenizer.load": lambda: kinelm.Tokenizer.load(w.json),
        "Tokenizer.save": lambda: w.tokenizer.save(w.new()),
        "Tokenizer.encode": lambda: w.tokenizer.encode(w.clip),
        "Tokenizer.decode": lambda: w.tokenizer.decode(w.ids),
        "Corpus.build": lambda: kinelm.Corpus.build(w.data, w.new(), **w.labels),
        "Corpus.open": lambda: kinelm.Corpus.open(w.at / "corpus"),
        "Corpus.clips": lambda: w.corpus.clips(),
        "Corpus.tokens": lambda: np.array(w.corpus.tokens),
        "Corpus.sequences": lambda: w.corpus.sequences(context=99),
        "Sequences": lambda: w.sequences[0],
        "Sequences.arrays": lambda: w.sequences.arrays(),
        "Model.open": lambda: kinelm.Model.open(w.run),
        "Model.ready": lambda: kinelm.Model.ready(),
        "Model.generate": lambda: w.model.generate(seconds=0.2),
        "Model.variations": lambda: w.model.variations(2, seconds=0.2),
        "Model.frames": lambda: next(w.model.frames(seconds=0.2)),
        "Model.bits_per_frame": lambda: w.model.bits_per_frame(w.file),
        "Model.likelihood": lambda: w.model.likelihood(w.corpus, "train"),
        "pretrain": lambda: kinelm.pretrain(w.at / "corpus", w.new(), config="tiny", steps=1),
        "finetune": lambda: kinelm.finetune(w.model, w.at / "corpus", w.new(), steps=1),
        "resume": lambda: kinelm.resume(w.stopped),
        "Index.build": lambda: kinelm.Index.build(w.data, w.new(), window=32, hop=16),
        "Index.open": lambda: kinelm.Index.open(w.at / "index"),
        "Index.find": lambda: w.index.find(w.file, k=1, exclude="none"),
        "Classifier.train": lambda: kinelm.Classifier.train(w.run, w.corpus, ["genre"], w.new(), steps=1, batch=2),
        "Classifier.open": lambda: kinelm.Classifier.open(w.at / "classes"),
        "Classifier.predict": lambda: w.classifier.predict(w.file),
        "evaluate": lambda: kinelm.evaluate([w.file], w.corpus),
    }
