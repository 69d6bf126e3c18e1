#!/usr/bin/env python3
"""The inner loops of bf16 and int8, which valgrind can't run: python3 scripts/bench/loops.py PROGRAM [--cpu znver4]

Finds the loops in a built program (not stripped or stripped) that hold the most `vdpbf16ps` and `vpdpbusd`, and lets
llvm-mca say how many cycles one turn takes beside what the products alone would. Exit code 1 where a loop takes more
than 1.3 times that, so a change that spills sums out of registers shows.

Needs objdump and llvm-mca 19 or newer (Debian: apt-get install binutils llvm-19).
"""

import argparse
import re
import shutil
import subprocess
import sys

LINE = re.compile(r"^\s*([0-9a-f]+):\s+(\S.*)$")
JUMP = re.compile(r"^j\w+\s+([0-9a-f]+)\b")
LIMIT = 1.3


def loops(program, instruction):
    """Bodies of loops that hold an instruction, from their first line to the jump back."""
    found, lines = [], []
    listing = subprocess.Popen(["objdump", "-d", "--no-show-raw-insn", program], stdout=subprocess.PIPE, text=True)
    for text in listing.stdout:
        if text.endswith(">:\n"):
            lines = []
            continue
        line = LINE.match(text)
        if not line:
            continue
        lines.append((int(line[1], 16), line[2].split("#")[0].strip()))
        lines = lines[-400:]
        jump = JUMP.match(lines[-1][1])
        if jump and int(jump[1], 16) <= lines[-1][0]:
            body = [code for at, code in lines if at >= int(jump[1], 16)]
            whole = lines[0][0] <= int(jump[1], 16)
            if whole and any(instruction in code for code in body) and not any(JUMP.match(code) for code in body[:-1]):
                found.append(body)
    return found


def cycles(body, mca, cpu):
    """Cycles of a turn, as llvm-mca has it in the long run."""
    # a jump's address means nothing there
    text = "\n".join(re.sub(r"\s<.*", "", code) for code in body if not code.startswith("j"))
    call = [mca, f"-mcpu={cpu}", "-iterations=200", "-"]
    done = subprocess.run(call, input=text, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"loops.py: {' '.join(call)}: {done.stderr[:400]}")
    return int(re.search(r"Total Cycles:\s+(\d+)", done.stdout)[1]) / 200


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("--cpu", default="znver4")
    args = parser.parse_args()
    mca = next((name for name in ["llvm-mca-22", "llvm-mca-19", "llvm-mca"] if shutil.which(name)), None)
    if not mca or not shutil.which("objdump"):
        sys.exit("loops.py: objdump or llvm-mca is not installed")
    slow = False
    for instruction in ["vdpbf16ps", "vpdpbusd"]:
        bodies = loops(args.program, instruction)
        if not bodies:
            sys.exit(f"loops.py: {args.program} has no loop with {instruction}")
        body = max(bodies, key=lambda body: sum(instruction in code for code in body))
        products = [code for code in body if instruction in code]
        # the products alone, each on sums of its own
        least = cycles([f"{instruction} %zmm30,%zmm31,%zmm{n % 24}" for n in range(len(products))], mca, args.cpu)
        took = cycles(body, mca, args.cpu)
        slow |= took > LIMIT * least
        print(f"{instruction}: {len(products)} products of {len(body)} instructions, {took:.1f} cycles a turn, {took / least:.2f} of the products alone ({args.cpu})")
    sys.exit(1 if slow else 0)


if __name__ == "__main__":
    main()
