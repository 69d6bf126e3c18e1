from collections.abc import Callable, Iterator, Mapping, Sequence
from os import PathLike
from typing import Any, Literal, TypedDict, overload

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Unpack

__version__: str

Path = str | PathLike[str]
Split = Literal["train", "valid", "test"]
Checkpoint = int | Literal["latest", "best"]
Callback = Callable[[dict[str, Any]], bool | None]

class Reading(TypedDict, total=False):
    """How a motion file is read; what isn't given is found out."""

    fps_source: float
    """Its true rate, where the file's is wrong."""
    skip: int
    """Frames left out at its beginning."""
    up: Literal["x", "-x", "y", "-y", "z", "-z"]
    unit: Literal["m", "cm", "mm", "in"]
    map: str
    """A skeleton map: its name, file, or text."""
    mirror_axis: Literal["x", "y", "z"]
    """The axis of its world along which it is mirrored."""

class Dance(Reading, total=False):
    """What a dance is asked for."""

    joints: str
    """Of the prompt, given throughout, such as "root,torso,right_arm"."""
    from_frame: int
    """All joints of the prompt are given before this frame."""
    free: Sequence[str]
    """All of the prompt is given but this, such as ["left_arm@4s:8s"]."""
    loop: bool
    """The end leads to the beginning."""
    path: Path | Sequence[Sequence[float]] | NDArray[np.float64]
    """Places on the floor that the dance goes along: rows of seconds, x and z in metres and perhaps a heading in degrees, or a
    .csv of them."""
    seconds: float
    """Above 0."""
    frames: int
    """Of the model, 1 or more."""
    labels: Mapping[str, str]
    guidance: float
    look_ahead: int
    """Continuations of every two seconds, of which the most believable is kept, 1 to 64."""
    music: Path
    seed: int
    temperature: float
    top_p: float
    rig: Literal["model", "prompt"]
    lock_feet: bool

class Training(TypedDict, total=False):
    """What of a training file is overruled."""

    steps: int
    seed: int
    conditions: Sequence[str]
    precision: Literal["f32", "bf16", "auto"]

class Error(Exception):
    """What kinelm could not do: its text says what, where, and what to do."""

    kind: Literal["io", "file", "call", "limit", "stopped", "failed"]
    path: str | None
    """The file that it is about."""
    line: int | None
    column: int | None
    parameter: str | None
    """The parameter that has a wrong value."""
    found: str | None
    expected: str | None

class Clip:
    """A motion: J joints, a rate, and for each of F frames a root position in metres and local rotations; y is up."""

    def __init__(
        self,
        names: Sequence[str],
        parents: Sequence[int | None],
        offsets: NDArray[np.float64],
        root: NDArray[np.float64],
        rotations: NDArray[np.float64],
        fps: float,
    ) -> None:
        """offsets (J, 3), root (F, 3), rotations (F, J, 4) as x, y, z, w; `fps` is 0.001 to 10,000."""
    @staticmethod
    def read(path: Path, **reading: Unpack[Reading]) -> Clip:
        """Reads .bvh .amc .fbx .glb .vrm .vrma .npz .pkl .json."""
    def write(self, path: Path, *, force: bool = False) -> None:
        """Writes .bvh .glb .vrma .npz .json; replaces a file that is there only with `force`."""
    def retarget(self, rig: Path | Clip, *, map: str | None = None, rig_map: str | None = None) -> Clip:
        """On another rig: "smpl", that of a file, or that of another clip."""
    def resample(self, fps: float) -> Clip: ...
    def slice(self, start: int, stop: int) -> Clip: ...
    def lock_feet(self) -> Clip:
        """Feet locked where they are in contact with the floor, and the body on it."""
    def humanoid(self) -> dict[str, str]:
        """The joints that SMPL's correspond to, by SMPL's names."""
    @overload
    def positions(self, *, dtype: Literal["float64"] = "float64") -> NDArray[np.float64]:
        """(F, J, 3) in the world, metres."""
    @overload
    def positions(self, *, dtype: Literal["float32"]) -> NDArray[np.float32]: ...
    def page(self) -> str:
        """The page on which the clip plays, as HTML."""
    @property
    def fps(self) -> float: ...
    @property
    def frames(self) -> int: ...
    @property
    def duration(self) -> float: ...
    @property
    def joints(self) -> list[str]: ...
    @property
    def parents(self) -> list[int | None]: ...
    @property
    def warnings(self) -> list[tuple[str, str]]: ...
    @property
    def offsets(self) -> NDArray[np.float64]: ...
    @property
    def root(self) -> NDArray[np.float64]: ...
    @property
    def rotations(self) -> NDArray[np.float64]: ...
    def _repr_html_(self) -> str: ...
    def __len__(self) -> int: ...

class Tokenizer:
    """Turns clips into ids and back: a frame is a word, each component of a joint's rotation a character."""

    @staticmethod
    def fit(
        clips: Sequence[Clip],
        *,
        joints: str = "18",
        fps: float = 20.0,
        bins: int = 360,
        map: str | None = None,
        floor: float | None = None,
    ) -> Tokenizer: ...
    @staticmethod
    def load(path: Path) -> Tokenizer: ...
    def save(self, path: Path, *, force: bool = False) -> None:
        """Replaces a file that is there only with `force`."""
    def encode(self, clip: Clip, *, map: str | None = None, floor: float | None = None) -> NDArray[np.uint32]:
        """`floor` is the height of the clip's floor, metres, found out if not given."""
    def decode(self, ids: NDArray[np.uint32]) -> Clip: ...
    @property
    def vocabulary(self) -> int: ...
    @property
    def fps(self) -> float: ...
    @property
    def tokens_per_word(self) -> int | None: ...

class Corpus:
    """A corpus folder: the tokens of many clips, with labels and splits."""

    @staticmethod
    def open(path: Path) -> Corpus: ...
    @staticmethod
    def build(
        data: Path | Sequence[Path],
        out: Path,
        *,
        tokenizer: Tokenizer,
        labels: Sequence[str] | None = None,
        shard: tuple[int, int] | None = None,
        force: bool = False,
        **reading: Unpack[Reading],
    ) -> Corpus:
        """Tokenizes files, folders and tar archives. `labels` are CSV files or patterns of file names, "{genre}_{dancer}_*". With
        `shard` (i, n) every n-th file from the i-th on."""
    @staticmethod
    def merge(shards: Sequence[Path], out: Path, *, force: bool = False) -> Corpus:
        """Puts shards together, in any order: the same bytes as a build without them."""
    @property
    def failed(self) -> list[dict[str, Any]]:
        """Key, name and why of each file that is not in it."""
    @property
    def path(self) -> str: ...
    @property
    def tokenizer(self) -> Tokenizer: ...
    def clips(self, split: Split | None = None) -> list[dict[str, Any]]:
        """Name, offset and tokens (of `tokens`), frames, labels, split and take of each clip."""
    @property
    def tokens(self) -> np.memmap[Any, np.dtype[np.uint16 | np.uint32]]:
        """All tokens, clip after clip, straight from the file."""
    def sequences(self, split: Split = "train", *, context: int, conditions: Sequence[str] | None = None) -> Sequences:
        """Windows of whole words behind <bos> and labels, to train a model of your own on. `context`: 1 to 1,048,576."""
    def __len__(self) -> int: ...

class Sequences(Sequence[dict[str, NDArray[np.int64]]]):
    """Dictionaries of `input_ids` and `labels`, (context,) each; what doesn't count has the label -100."""

    def arrays(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """All as (N, context) `input_ids` and `labels`; refused where memory is too short for them."""

class Model:
    """A trained model: its run folder."""

    @staticmethod
    def open(run: Path, *, checkpoint: Checkpoint | None = None) -> Model:
        """Of a run's checkpoints the best, or the latest where none was validated, or the one that `checkpoint` names."""
    @staticmethod
    def ready() -> Model:
        """kinelm's own model; the first call writes it to the user's cache folder."""
    @property
    def run(self) -> str: ...
    def generate(
        self, prompt: Path | Clip | None = None, *, callback: Callback | None = None, **options: Unpack[Dance]
    ) -> Clip:
        """The callback gets `frames` sampled `of` all after each word; False from it stops."""
    def variations(
        self, count: int, prompt: Path | Clip | None = None, *, callback: Callback | None = None, **options: Unpack[Dance]
    ) -> list[Clip]:
        """Several dances, sampled side by side."""
    def frames(self, prompt: Path | Clip | None = None, **options: Unpack[Dance]) -> Iterator[NDArray[np.float64]]:
        """(24, 3) positions of each frame while the dance is sampled. It can be dropped at any frame."""
    def bits_per_frame(self, path: Path, **reading: Unpack[Reading]) -> float:
        """How surprising a motion is to the model."""
    def likelihood(self, corpus: Corpus, split: Split = "test") -> dict[str, Any]:
        """`bits_per_frame`, `nats_per_token`, `tokens`, `frames` of a split."""

class Index:
    """Windows of clips by their spectra."""

    @staticmethod
    def open(path: Path) -> Index: ...
    @staticmethod
    def build(
        data: Path | Sequence[Path],
        out: Path,
        *,
        labels: Sequence[str] | None = None,
        window: int | None = None,
        hop: int | None = None,
        fps: float | None = None,
        **reading: Unpack[Reading],
    ) -> Index:
        """Indexes files and folders, or adds them to the index that is there."""
    def find(
        self,
        clip: Path,
        *,
        at: float | None = None,
        k: int = 10,
        distance: Literal["cosine", "euclid"] = "cosine",
        exclude: Literal["none", "self", "overlap", "clip", "take", "choreography"] = "take",
        one_per_clip: bool = False,
        **reading: Unpack[Reading],
    ) -> list[dict[str, Any]]:
        """What moves like the clip does `at` seconds from its beginning, nearest first."""
    def __len__(self) -> int: ...

class Classifier:
    """Class tokens of a model: dancer, genre or whatever a corpus labels."""

    @staticmethod
    def open(path: Path) -> Classifier: ...
    @staticmethod
    def train(
        run: Path,
        corpus: Corpus,
        fields: Sequence[str],
        out: Path,
        *,
        steps: int = 1000,
        batch: int = 16,
        seed: int = 1,
        resume: bool = False,
        callback: Callback | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Classifier | None:
        """None where the callback stopped it; `resume` goes on."""
    def predict(self, path: Path, **reading: Unpack[Reading]) -> dict[str, Any]:
        """For each field the likeliest class, all probabilities, and the class second by second."""

def pretrain(
    corpus: Path | Sequence[Path],
    run: Path,
    *,
    config: Path = "two-level",
    callback: Callback | None = None,
    **options: Unpack[Training],
) -> Model:
    """Trains a model. The callback gets a dictionary at every step and validation; False from it stops."""

def finetune(
    source: Model | Path,
    corpus: Path | Sequence[Path],
    run: Path,
    *,
    config: Path = "tune",
    callback: Callback | None = None,
    **options: Unpack[Training],
) -> Model:
    """As `pretrain`, from the weights of a model. Corpora have its tokenizer."""

def resume(run: Path, *, steps: int | None = None, callback: Callback | None = None) -> Model:
    """Goes on with a training that was stopped."""

def evaluate(
    dances: Path | Sequence[Path], real: Corpus, *, copying: bool = False, **reading: Unpack[Reading]
) -> dict[str, Any]:
    """Measures dances against the real ones of a corpus."""

def read_many(paths: Sequence[Path], **reading: Unpack[Reading]) -> list[Clip]:
    """Reads files on all threads; the first that can't be read raises its error."""

def compare(teacher: Clip, student: Clip, *, joints: str = "24", band: float = 1.0) -> dict[str, Any]:
    """Compares a student's clip with a teacher's: distance in cm, lag, tempo, mirror image, joints and moments."""
