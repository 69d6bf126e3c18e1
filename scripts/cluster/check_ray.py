#!/usr/bin/env python3
"""Whether tokenize_ray.py gives the bytes of one machine on a cluster of two nodes, of which a worker is killed every three seconds.

    pip install ray==2.60.0 numpy
    PYTHONPATH=target/python check_ray.py dances/ tokenizer.json           (the library that scripts/python.sh has put there)
"""

import filecmp
import os
import random
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path

# nothing is reported, and nodes meet on 127.0.0.1
os.environ.update(RAY_USAGE_STATS_ENABLED="0", RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER="0")

import kinelm
import ray
from ray.cluster_utils import Cluster

from tokenize_ray import run, shard

data, tokenizer = [sys.argv[1]], sys.argv[2]
folder = Path(tempfile.mkdtemp())
whole = folder / "whole"
kinelm.Corpus.build(data, whole, tokenizer=kinelm.Tokenizer.load(tokenizer))

cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "node_ip_address": "127.0.0.1"})
cluster.add_node(num_cpus=1, node_ip_address="127.0.0.1")
ray.init(address=cluster.address, log_to_driver=False)
killed, over = [], threading.Event()


def workers():
    """Processes of Ray that are at work on a shard."""
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and b"ray::shard" in (entry / "cmdline").read_bytes():
                yield int(entry.name)
        except OSError:
            pass


def kill():
    chance = random.Random(1)
    while not over.wait(3.0):
        if here := list(workers()):
            victim = chance.choice(here)
            os.kill(victim, signal.SIGKILL)
            killed.append(victim)


threading.Thread(target=kill, daemon=True).start()
# in tests a shard takes its time, or none would be killed at work
slow = lambda *args: (time.sleep(0.7), shard(*args))[1]
slow.__name__ = slow.__qualname__ = "shard"
env = {"env_vars": {"RAYON_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}}
task = ray.remote(num_cpus=1, max_retries=-1, runtime_env=env)(slow)
run(data, folder / "ray", tokenizer, [], 12, task.remote)
over.set()
ray.shutdown()
cluster.shutdown()
names = sorted(p.name for p in whole.iterdir())
same, other, missing = filecmp.cmpfiles(whole, folder / "ray", names, shallow=False)
print(f"{len(killed)} workers killed; the same bytes: {' '.join(same)}; others: {' '.join(other + missing) or 'none'}")
sys.exit(bool(other or missing or not killed))
