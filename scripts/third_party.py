#!/usr/bin/env python3
"""Prints the licences of the crates that the program and the Python package are built from, each text once.

usage: scripts/third_party.py TARGET > LICENSE-THIRD-PARTY
"""

import collections
import json
import pathlib
import re
import subprocess
import sys

FILES = re.compile(r"(licen[cs]e|copying|notice|copyright|unlicense)", re.IGNORECASE)
ROOTS = ["kinelm", "kinelm-python"]
RULE = "-" * 100


def crates(target):
    """Crates from a registry that the roots are compiled with, without what only tests and build scripts need."""
    call = ["cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", target]
    metadata = json.loads(subprocess.run(call, check=True, stdout=subprocess.PIPE).stdout)
    packages = {package["id"]: package for package in metadata["packages"]}
    below = {node["id"]: node["deps"] for node in metadata["resolve"]["nodes"]}
    waiting = [id for id, package in packages.items() if package["name"] in ROOTS]
    found = set(waiting)
    while waiting:
        for dep in below[waiting.pop()]:
            if dep["pkg"] not in found and any(kind["kind"] is None for kind in dep["dep_kinds"]):
                found.add(dep["pkg"])
                waiting.append(dep["pkg"])
    return sorted((packages[id] for id in found if packages[id]["source"]), key=lambda p: (p["name"], p["version"]))


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    texts = collections.defaultdict(list)
    without = []
    for crate in crates(sys.argv[1]):
        name = f"{crate['name']} {crate['version']} ({crate['license']})"
        folder = pathlib.Path(crate["manifest_path"]).parent
        files = sorted(path for path in folder.iterdir() if path.is_file() and FILES.match(path.name))
        files = [path for path in files if path.suffix not in (".rs", ".toml", ".html")]
        for path in files:
            texts[path.read_text("utf-8", "replace").replace("\r\n", "\n").strip()].append(name)
        if not files:
            without.append(name)
    for text, names in texts.items():
        print("\n".join(dict.fromkeys(names)), text, RULE, sep="\n\n")
    print("Sources: crates.io has each crate under its name and version. Also compiled in: the Rust standard library (MIT OR")
    print("Apache-2.0). Crates that bring no text of their licence:\n")
    print("\n".join(without))


main()
