#!/usr/bin/env python3
"""Does the short-term error predict how long a dance lasts? Spearman's rho over the rows of docs/results/aclstm.md.

    scripts/reproduce/rank_correlation.py docs/results/aclstm.md

The 95 % interval is that of Bonett and Wright (2000): Fisher's z with the variance (1 + rho^2 / 2) / (n - 3).
"""
import math
import re
import sys

COLUMNS = {"cm": 3, "degrees": 4}
LASTING = {"still of 400": 5, "still of 4,000": 8}


def rows(text):
    """The rows of the table that have both kinds of figures: a network each."""
    table = [line.split("|")[1:-1] for line in text.splitlines() if line.startswith("| ") and line.count("|") == 12]
    number = lambda cell: re.search(r"[\d.]+", cell.replace(",", ""))
    networks = [row for row in table if all(number(row[i]) for i in [*COLUMNS.values(), *LASTING.values()])]
    return [[float(m.group()) if (m := number(cell)) else None for cell in row] for row in networks if "real" not in row[0]]


def ranks(values):
    return [sum(v < x for v in values) + (sum(v == x for v in values) + 1) / 2 for x in values]


def spearman(x, y):
    x, y = ranks(x), ranks(y)
    mean = (len(x) + 1) / 2
    covariance = sum((a - mean) * (b - mean) for a, b in zip(x, y))
    return covariance / math.sqrt(sum((a - mean) ** 2 for a in x) * sum((b - mean) ** 2 for b in y))


def main():
    networks = rows(open(sys.argv[1], encoding="utf-8").read())
    for name, some in [("all", networks), ("the LSTMs", networks[:-1])]:
        for error, i in COLUMNS.items():
            for lasting, k in LASTING.items():
                rho, n = spearman([r[i] for r in some], [r[k] for r in some]), len(some)
                z, half = math.atanh(min(abs(rho), 1 - 1e-9)) * math.copysign(1, rho), 1.96 * math.sqrt((1 + rho**2 / 2) / (n - 3))
                low, high = math.tanh(z - half), math.tanh(z + half)
                print(f"{name} (n = {n}): {error} with {lasting}: {rho:.2f} ({low:.2f} to {high:.2f})")


if __name__ == "__main__":
    main()
