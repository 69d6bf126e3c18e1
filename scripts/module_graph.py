#!/usr/bin/env python3
"""Lists which rooms of every crate know which, and the circles among them.

    scripts/module_graph.py            # every folder: its rooms, and what each one uses
    scripts/module_graph.py --check    # only circles, and crates that use what docs/architecture.md doesn't allow; exit 1 then
    scripts/module_graph.py --why A B  # the lines in which module A (a::b) uses module B
    scripts/module_graph.py --dot      # the same graph for graphviz
    scripts/module_graph.py --svg docs/architecture.svg    # the crates as a picture, which --check compares

A room is a folder of modules or a single file. Paths are read from the source text (use lines and paths in code),
re-exports are followed to the file that defines the name, and what stands under #[cfg(test)] does not count.
"""

import argparse
import pathlib
import re
import sys

import crate_picture

ROOT = pathlib.Path(__file__).resolve().parent.parent
COMMENT = re.compile(r"//[^\n]*")
STRING = re.compile(r'b?r#"(?:.|\n)*?"#|"(?:[^"\\]|\\.)*"', re.S)
TESTED = re.compile(r"#\[cfg\((?:all\()?test\b[^\]]*\]\s*(?:#\[[^\]]*\]\s*)*")
USE = re.compile(r"^\s*(pub(?:\([a-z ]+\))?\s+)?use\s+([^;]+);", re.M)
PATH = re.compile(r"\b(?:crate|self|super)(?:::\w+)+")
INLINE = re.compile(r"^\s*(?:pub(?:\([a-z ]+\))?\s+)?mod\s+\w+\s*\{", re.M)
MOD = re.compile(r"^\s*(?:pub(?:\([a-z ]+\))?\s+)?mod\s+(\w+)\s*;", re.M)


def without_tests(text):
    """`text` without the items that stand under #[cfg(test)]; also the names of the test modules it declares."""
    tests = set()
    while True:
        found = TESTED.search(text)
        if not found:
            return text, tests
        at = found.end()
        depth, end = 0, at
        while end < len(text):
            if text[end] == "{":
                depth += 1
            elif text[end] == "}":
                depth -= 1
                if depth == 0:
                    break
            elif text[end] == ";" and depth == 0:
                break
            end += 1
        item = text[at : end + 1]
        declared = MOD.match(item) or re.match(r"\s*(?:pub(?:\([a-z ]+\))?\s+)?mod\s+(\w+)", item)
        if declared:
            tests.add(declared.group(1))
        kept = "\n" * text[found.start() : end + 1].count("\n")
        text = text[: found.start()] + kept + text[end + 1 :]


def flattened(text):
    """`text` with `super` of modules written inside the file as `self`: they belong to the file."""
    found = INLINE.search(text)
    if not found:
        return text
    depth, end = 1, found.end()
    while depth and end < len(text):
        depth += {"{": 1, "}": -1}.get(text[end], 0)
        end += 1
    inside = re.sub(r"\bsuper::", "self::", flattened(text[found.end() : end]))
    return text[: found.end()] + inside + flattened(text[end:])


def leaves(tree):
    """Every path of a use tree, as (segments, name under which it is known)."""
    tree = tree.strip()
    brace = tree.find("{")
    if brace < 0:
        path, _, alias = tree.partition(" as ")
        segments = [s for s in path.strip().split("::") if s]
        yield segments, alias.strip() or (segments[-1] if segments else "")
        return
    head = [s for s in tree[:brace].strip().split("::") if s]
    body, depth, start = tree[brace + 1 : tree.rfind("}")], 0, 0
    parts = []
    for at, char in enumerate(body):
        if char == "{":
            depth += 1
        elif char == "}":
            depth -= 1
        elif char == "," and depth == 0:
            parts.append(body[start:at])
            start = at + 1
    parts.append(body[start:])
    for part in parts:
        if part.strip():
            for segments, name in leaves(part):
                if segments and segments[-1] == "self":
                    segments = segments[:-1]
                    name = name if name != "self" else (segments or head)[-1]
                yield head + segments, name


class Crate:
    def __init__(self, folder):
        self.name = re.search(r'^name = "([^"]+)"', (folder / "Cargo.toml").read_text(), re.M).group(1)
        self.files, self.exports, self.uses = {}, {}, {}
        self.read((), folder / "src" / "lib.rs", folder / "src")
        for module in self.files:
            self.uses[module] = list(self.used(module))

    def read(self, module, file, children):
        text = COMMENT.sub("", file.read_text())
        text = STRING.sub(lambda found: '""' + "\n" * found.group().count("\n"), text)
        text, tests = without_tests(text)
        text = flattened(text)
        self.files[module] = text
        for declared in MOD.finditer(text):
            name = declared.group(1)
            if name in tests:
                continue
            if (children / f"{name}.rs").exists():
                self.read((*module, name), children / f"{name}.rs", children / name)
            elif (children / name / "mod.rs").exists():
                self.read((*module, name), children / name / "mod.rs", children / name)
        self.exports[module] = {
            name: self.absolute(module, segments)
            for use in USE.finditer(text)
            for segments, name in leaves(use.group(2))
        }

    def absolute(self, module, segments):
        """`segments` as a path from the crate's root; None if it leads out of the crate."""
        if segments[0] == "crate":
            return tuple(segments[1:])
        at = module
        if segments[0] in ("self", "super"):
            while segments and segments[0] in ("self", "super"):
                at = at[:-1] if segments[0] == "super" else at
                segments = segments[1:]
            return (*at, *segments)
        return (*module, *segments)

    def owner(self, path, depth=0):
        """The module that defines what `path` names, through re-exports."""
        module = ()
        for at, name in enumerate(path):
            if (*module, name) in self.files:
                module = (*module, name)
                continue
            target = self.exports[module].get(name)
            if target and target != path[: at + 1] and depth < 8:
                return self.owner((*target, *path[at + 1 :]), depth + 1)
            break
        return module

    def used(self, module):
        text = self.files[module]
        for use in USE.finditer(text):
            line = text.count("\n", 0, use.start(2)) + 1
            for segments, _ in leaves(use.group(2)):
                known = segments[0] in ("crate", "self", "super") or (*module, segments[0]) in self.files
                if known:
                    yield line, self.owner(self.absolute(module, segments))
        for path in PATH.finditer(USE.sub(lambda use: "\n" * use.group().count("\n"), text)):
            line = text.count("\n", 0, path.start()) + 1
            yield line, self.owner(self.absolute(module, path.group().split("::")))

    def rooms(self, folder):
        """The edges between the rooms right below `folder`: {room: {room it uses}}."""
        below = [m for m in self.files if m[: len(folder)] == folder and len(m) > len(folder)]
        graph = {m[len(folder)]: set() for m in below}
        for module in below:
            room = module[len(folder)]
            for _, used in self.uses[module]:
                if used[: len(folder)] == folder and len(used) > len(folder) and used[len(folder)] != room:
                    graph[room].add(used[len(folder)])
        return graph

    def folders(self):
        return sorted({m[:-1] for m in self.files if m})


def circles(graph):
    """The strongly connected parts of more than one room."""

    def reach(start):
        seen, todo = set(), [start]
        while todo:
            for room in graph[todo.pop()]:
                if room not in seen:
                    seen.add(room)
                    todo.append(room)
        return seen

    reached = {room: reach(room) for room in graph}
    found, done = [], set()
    for room in sorted(graph):
        if room in done or room not in reached[room]:
            continue
        part = sorted(other for other in reached[room] if room in reached[other])
        done.update(part)
        if len(part) > 1:
            found.append(part)
    return found


def folders():
    text = (ROOT / "Cargo.toml").read_text()
    listed = re.search(r"members = \[(.*?)\]", text, re.S).group(1)
    found = [ROOT] + [ROOT / member for member in re.findall(r'"([^"]+)"', listed)]
    return [folder for folder in found if (folder / "src" / "lib.rs").exists()]


def members():
    return [Crate(folder) for folder in folders()]


def direct_arrows():
    """The arrows of docs/architecture.md as they stand there: {crate: {crate}}."""
    text = (ROOT / "docs/architecture.md").read_text()
    block = text.split("## Who may know whom\n```\n", 1)[1].split("```", 1)[0]
    return {a.strip(): {b.strip() for b in to.split(",")} for a, to in (line.split("->") for line in block.splitlines())}


def layers():
    """The table by layer of docs/architecture.md, from the bottom up: {layer: [crate]}."""
    text = (ROOT / "docs/architecture.md").read_text()
    rows = re.findall(r"^\| ([\w ,]*?) ?\| `(\w+)` \|", text.split("| layer | crate |", 1)[1].split("\n\n", 1)[0], re.M)
    found = {}
    for layer, crate in rows:
        found.setdefault(layer or list(found)[-1], []).append(crate)
    return dict(reversed(found.items()))


def picture():
    """docs/architecture.svg as it should be."""
    return crate_picture.svg(direct_arrows(), layers())


def arrows():
    """Which crates a crate may use, by docs/architecture.md: {crate: {crate}}, over other arrows too."""
    direct = direct_arrows()

    def reach(crate):
        return set().union(*({to} | reach(to) for to in direct.get(crate, ())))

    return {crate: reach(crate) for crate in direct}


def beyond_arrows():
    """Crates that use others than the arrows allow, as sentences."""
    allowed = arrows()
    for folder in folders():
        text = (folder / "Cargo.toml").read_text()
        used = set(re.findall(r"^kinelm-(\w+)", text.split("[dependencies]", 1)[-1].split("\n[", 1)[0], re.M))
        crate = "src" if folder == ROOT else folder.name
        for other in sorted(used - allowed.get(crate, set())):
            yield f"{crate} uses {other}, which docs/architecture.md doesn't allow"


def wrong_picture():
    """What is wrong with the table by layer and the picture in docs/architecture.md, as sentences."""
    listed = {crate for members in layers().values() for crate in members}
    for crate in sorted(listed ^ {*direct_arrows(), *(to for used in direct_arrows().values() for to in used)}):
        yield f"docs/architecture.md has {crate} only in one of its table by layer and its arrows"
    file = ROOT / "docs/architecture.svg"
    if not file.exists() or file.read_text() != picture():
        yield "docs/architecture.svg is not what docs/architecture.md says: scripts/module_graph.py --svg docs/architecture.svg"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="only what is not allowed; exit 1 if there is any")
    parser.add_argument("--dot", action="store_true", help="the graph for graphviz")
    parser.add_argument("--svg", metavar="FILE", type=pathlib.Path, help="writes the crates as a picture")
    parser.add_argument("--why", nargs=2, metavar=("A", "B"), help="the lines in which A uses B")
    parser.add_argument("--crate", help="only this crate")
    args = parser.parse_args()
    if args.svg:
        args.svg.write_text(picture())
        return
    failed = False
    for sentence in (*beyond_arrows(), *wrong_picture()) if args.check else ():
        failed = True
        print(sentence)
    for crate in members():
        if args.crate and crate.name != args.crate:
            continue
        if args.why:
            a, b = (tuple(name.split("::")) for name in args.why)
            for module, uses in sorted(crate.uses.items()):
                for line, used in uses:
                    if module[: len(a)] == a and used[: len(b)] == b:
                        print(f"{crate.name} {'::'.join(module)}:{line} uses {'::'.join(used)}")
            continue
        for folder in crate.folders():
            graph = crate.rooms(folder)
            where = "::".join((crate.name, *folder))
            if args.dot:
                print(f'digraph "{where}" {{')
                for room, used in sorted(graph.items()):
                    print("\n".join([f'  "{room}";'] + [f'  "{room}" -> "{other}";' for other in sorted(used)]))
                print("}")
                continue
            if not args.check:
                print(where)
                for room, used in sorted(graph.items()):
                    kind = "/" if any(m[: len(folder) + 1] == (*folder, room) and len(m) > len(folder) + 1 for m in crate.files) else ""
                    print(f"  {room}{kind} -> {' '.join(sorted(used)) or '-'}")
            for part in circles(graph):
                below = [room for room in part if any(m[:-1] == (*folder, room) for m in crate.files)]
                failed = True
                marked = " ".join(room + "/" if room in below else room for room in part)
                print(f"circle in {where}: {marked}")
    sys.exit(args.check and failed)


if __name__ == "__main__":
    main()
