#!/usr/bin/env python3
"""Numbers of crates/evaluate/src/blind/tests.rs, by numpy: Wilson's interval as the roots of its quadratic equation, and
Fleiss' kappa from pairs of raters that agree, one pair after the other.

    python3 scripts/reference/blind.py
"""
import itertools

import numpy as np

Z = 1.959963984540054  # scipy.stats.norm.ppf(0.975)


def wilson(votes, of):
    # all p with (votes/of - p)^2 = z^2 p (1 - p) / of
    p = votes / of
    return sorted(np.roots([1 + Z**2 / of, -(2 * p + Z**2 / of), p**2]).real)


def fleiss(counts):
    counts = [c for c in counts if sum(c) > 1]
    raters = [[answer for answer, n in enumerate(c) for _ in range(n)] for c in counts]
    agree = np.mean([np.mean([a == b for a, b in itertools.combinations(r, 2)]) for r in raters])
    shares = np.sum(counts, axis=0) / np.sum(counts)
    return (agree - np.sum(shares**2)) / (1 - np.sum(shares**2))


for pair in [(81, 263), (15, 148), (0, 20), (1, 29), (29, 29)]:
    print("wilson", pair, [round(float(x), 10) for x in wilson(*pair)])
TABLE = [[0, 0, 0, 0, 14], [0, 2, 6, 4, 2], [0, 0, 3, 5, 6], [0, 3, 9, 2, 0], [2, 2, 8, 1, 1], [7, 7, 0, 0, 0], [3, 2, 6, 3, 0],
         [2, 5, 3, 2, 2], [6, 5, 2, 1, 0], [0, 2, 2, 3, 7]]
print("fleiss, 14 raters", round(float(fleiss(TABLE)), 12))
print("fleiss, unequal", round(float(fleiss([[3, 1], [0, 5], [2, 0], [1, 0], [2, 2]])), 12))
