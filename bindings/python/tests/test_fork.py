"""Forked processes: they call what needs no pool of threads, and hear of spawn where one is needed; nothing hangs."""

import json
import os
import select
import subprocess
import sys
import tempfile
import unittest

from calls import World, calls

# what a forked child can't do once its parent has used the pool
POOLED = {
    "Corpus.build",
    "Model.generate",
    "Model.variations",
    "Model.frames",
    "Model.bits_per_frame",
    "Model.likelihood",
    "pretrain",
    "finetune",
    "resume",
    "Index.build",
    "Index.open",
    "Index.find",
    "Classifier.train",
    "Classifier.open",
    "Classifier.predict",
    "evaluate",
}
SECONDS = 60


def outcome(call):
    """"" or what it raised."""
    try:
        call()
        return ""
    except Exception as e:
        return f"{type(e).__name__}: {e}"


def in_a_fork(work):
    """What `work` yields in a forked child, a JSON value a line; ends at SECONDS without one."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(reader)
            for said in work():
                os.write(writer, (json.dumps(said) + "\n").encode())
        finally:
            os._exit(0)
    os.close(writer)
    text = b""
    try:
        while select.select([reader], [], [], SECONDS)[0]:
            more = os.read(reader, 1 << 16)
            if not more:
                break
            text += more
    finally:
        os.close(reader)
        os.kill(child, 9)
        os.waitpid(child, 0)
    return [json.loads(line) for line in text.splitlines()]


@unittest.skipUnless(hasattr(os, "fork"), "no fork")
class Fork(unittest.TestCase):
    def test_after_each_call_each_returns(self):
        with tempfile.TemporaryDirectory() as folder:
            os.environ["XDG_CACHE_HOME"] = folder
            all_calls = calls(World(folder))

            def each():
                for name, call in all_calls.items():
                    yield [name, outcome(call)]

            for before, call in all_calls.items():
                self.assertEqual(outcome(call), "", before)
                said = in_a_fork(each)
                self.assertEqual([name for name, _ in said], list(all_calls), f"after {before}: one hangs")
                for name, raised in said:
                    if name in POOLED:
                        self.assertRegex(raised, "^Error: this process .* was forked from .*spawn", f"{name} after {before}")
                    else:
                        self.assertEqual(raised, "", f"{name} after {before}")

    def test_a_parent_without_work_leaves_the_threads_to_its_children(self):
        code = (
            "import os, kinelm\n"
            "child = os.fork()\n"
            "if child == 0:\n"
            "    os._exit(kinelm.Model.ready().generate(seconds=0.2).frames)\n"
            "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), kinelm.Model.ready().generate(seconds=0.2).frames)\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=SECONDS)
        self.assertEqual(done.stdout.split(), ["6", "6"], done.stderr)


if __name__ == "__main__":
    unittest.main()
