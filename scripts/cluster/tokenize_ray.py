#!/usr/bin/env python3
"""Tokenizes motion files on the machines of a Ray cluster: the same bytes as `kinelm tokenize` on one machine.

    pip install ray==2.60.0 numpy                   and the kinelm package, on every machine
    tokenize_ray.py dances/ --tokenizer tokenizer.json --out corpus --shards 64 [--labels dances.csv] [--address auto]

Every machine must see the files and the folder of `--out` at the same paths. A shard is a task of one processor, which Ray gives to
another worker when one is lost; a shard is there whole or not at all, so that it may be made twice. Shards that a call before this
one has left in OUT.shards are kept.
"""

import argparse
import os
import shutil
import sys
from pathlib import Path

# a cluster's own machines only: nothing is reported to anyone
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")

import ray


def shard(folder, data, tokenizer, labels, i, n):
    """Shard i of n in a folder, and the files that could not be read."""
    import kinelm

    place = Path(folder) / f"{i:05}-{n:05}"
    if not (place / "corpus.json").exists():
        tokenizer = kinelm.Tokenizer.load(tokenizer)
        kinelm.Corpus.build(data, place, tokenizer=tokenizer, labels=labels, shard=(i, n), force=True)
    return str(place), kinelm.Corpus.open(place).failed


def run(data, out, tokenizer, labels, shards, remote):
    """Makes the shards by `remote`, tells how it goes on, and puts them together."""
    import kinelm

    folder = Path(f"{out}.shards")
    folder.mkdir(parents=True, exist_ok=True)
    absolute = lambda path: str(Path(path).resolve())
    data, tokenizer = [absolute(path) for path in data], absolute(tokenizer)
    # a file, or else a pattern of names
    labels = [absolute(label) if Path(label).is_file() else label for label in labels] or None
    waiting = [remote(absolute(folder), data, tokenizer, labels, i, shards) for i in range(shards)]
    places, failed = [], []
    while waiting:
        done, waiting = ray.wait(waiting)
        for place, bad in ray.get(done):
            places.append(place)
            failed += bad
        print(f"{len(places)} of {shards} shards, {len(failed)} files that could not be read", file=sys.stderr)
    corpus = kinelm.Corpus.merge(sorted(places), out)
    shutil.rmtree(folder)
    for file in failed:
        print(f"{file['name']}: {file['why']}", file=sys.stderr)
    return corpus


def main():
    parser = argparse.ArgumentParser(description="Tokenizes motion files on the machines of a Ray cluster.")
    parser.add_argument("data", nargs="+", help="files, folders and tar archives")
    parser.add_argument("--tokenizer", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--labels", action="append", default=[])
    parser.add_argument("--shards", type=int, default=64, help="several for each processor, so that none waits long for the last")
    parser.add_argument("--address", help="of a cluster that runs, such as auto; without it one on this machine")
    args = parser.parse_args()
    ray.init(address=args.address, log_to_driver=False)
    # a task uses one thread; it is made again wherever its worker was lost
    task = ray.remote(num_cpus=1, max_retries=-1, runtime_env={"env_vars": {"RAYON_NUM_THREADS": "1"}})(shard)
    print(run(args.data, args.out, args.tokenizer, args.labels, args.shards, task.remote))


if __name__ == "__main__":
    main()
