from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__version__: str

Path = str | PathLike[str]

class Error(Exception):
    """What kinelm could not do: its text says what, where, and what to do."""

    kind: Literal["io", "file", "call", "limit", "stopped", "failed"]

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
        """offsets (J, 3), root (F, 3), rotations (F, J, 4) as x, y, z, w."""
    @staticmethod
    def read(
        path: Path,
        *,
        fps_source: float | None = None,
        skip: int = 0,
        up: Literal["x", "-x", "y", "-y", "z", "-z"] | None = None,
        unit: Literal["m", "cm", "mm", "in"] | None = None,
        map: str | None = None,
    ) -> Clip:
        """Reads .bvh .amc .fbx .glb .vrm .npz .pkl .json."""
    def write(self, path: Path, *, force: bool = False) -> None:
        """Writes .bvh .glb .npz .json."""
    def retarget(self, rig: Path | Clip, *, map: str | None = None) -> Clip:
        """On another rig: "smpl", that of a file, or that of another clip."""
    def resample(self, fps: float) -> Clip: ...
    def slice(self, start: int, stop: int) -> Clip: ...
    def positions(self) -> NDArray[np.float64]:
        """(F, J, 3) in the world, metres."""
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
        clips: Sequence[Clip], *, joints: str = "18", fps: float = 20.0, bins: int = 360, map: str | None = None
    ) -> Tokenizer: ...
    @staticmethod
    def load(path: Path) -> Tokenizer: ...
    def save(self, path: Path) -> None: ...
    def encode(self, clip: Clip, *, map: str | None = None) -> NDArray[np.uint32]: ...
    def decode(self, ids: NDArray[np.uint32]) -> Clip: ...
    @property
    def vocabulary(self) -> int: ...
    @property
    def fps(self) -> float: ...
    @property
    def tokens_per_word(self) -> int | None: ...

class Model:
    """A trained model: its run folder."""

    @staticmethod
    def open(run: Path) -> Model: ...
    @staticmethod
    def ready() -> Model:
        """kinelm's own model; the first call writes it to the user's cache folder."""
    @property
    def run(self) -> str: ...
    def generate(
        self,
        prompt: Path | None = None,
        *,
        joints: str | None = None,
        from_frame: int | None = None,
        free: Sequence[str] | None = None,
        loop: bool = False,
        seconds: float | None = None,
        frames: int | None = None,
        labels: Mapping[str, str] | None = None,
        guidance: float | None = None,
        seed: int = 1,
        temperature: float = 1.0,
        top_p: float | None = None,
        rig: Literal["model", "prompt"] | None = None,
        fps_source: float | None = None,
        skip: int = 0,
        map: str | None = None,
    ) -> Clip: ...
    def bits_per_frame(
        self, path: Path, *, fps_source: float | None = None, skip: int = 0, map: str | None = None
    ) -> float:
        """How surprising a motion is to the model."""
