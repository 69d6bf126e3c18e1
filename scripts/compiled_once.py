#!/usr/bin/env python3
"""Whether README's two commands, the build and the tests, compile every package once.

Cargo resolves features for each call: a feature that only a dependency of the tests asks for compiles its package a second
time, and all that use it. This compares the units of both calls, without compiling: exit 1 where they differ.

    scripts/compiled_once.py
"""

import json
import os
import subprocess
import sys

BUILD = ["build", "--release"]
TESTS = ["test", "--release", "--workspace"]


def units(call):
    """The features of each unit of a package that isn't ours, by what it is."""
    # a unit graph is an unstable output of a stable compiler
    run = ["cargo", *call, "--locked", "-Z", "unstable-options", "--unit-graph"]
    text = subprocess.run(run, env={**os.environ, "RUSTC_BOOTSTRAP": "1"}, stdout=subprocess.PIPE, check=True).stdout
    found = {}
    for unit in json.loads(text)["units"]:
        if "registry" in unit["pkg_id"]:
            name = unit["pkg_id"].split("#")[-1]
            profile = json.dumps(unit["profile"], sort_keys=True)
            what = (name, unit["target"]["name"], unit["mode"], unit["platform"], profile)
            found.setdefault(what, set()).add(tuple(unit["features"]))
    return found


def main():
    build, tests = units(BUILD), units(TESTS)
    differ = [(what[0], sorted(has), sorted(tests[what])) for what, has in build.items()
              if what in tests and not has <= tests[what]]
    for name, has, wanted in sorted(differ, key=str):
        print(f"{name}: cargo {' '.join(BUILD)} compiles it with {has}, cargo {' '.join(TESTS)} with {wanted}")
    print(f"{len(build)} units, {len(differ)} of them compiled twice for their features")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
