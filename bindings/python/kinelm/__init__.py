"""Motion capture into text, a GPT on that text, and new dances out of it.

    import kinelm
    dance = kinelm.Model.ready().generate("mine.bvh", joints="root,torso,right_arm")
    dance.write("dance.bvh")
"""

from ._kinelm import (
    Classifier,
    Clip,
    Corpus,
    Error,
    Index,
    Model,
    Tokenizer,
    __version__,
    compare,
    evaluate,
    finetune,
    pretrain,
    read_many,
    resume,
)

__all__ = [
    "Classifier",
    "Clip",
    "Corpus",
    "Error",
    "Index",
    "Model",
    "Tokenizer",
    "__version__",
    "compare",
    "evaluate",
    "finetune",
    "pretrain",
    "read_many",
    "resume",
]


def _program():
    """The program `kinelm`."""
    import os
    import signal
    import sys

    from ._kinelm import main

    # the studio starts this program again to read files
    os.environ["KINELM_PYTHON"] = sys.executable
    # the program hears Ctrl-C itself
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(main(["kinelm", *sys.argv[1:]]))
