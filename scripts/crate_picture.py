"""The crates as a picture: plain SVG, for `module_graph.py --svg`.

A crate stands above everything that it uses. Arrows over several rows bend around the crates between (Sugiyama's
layers with dummy nodes); rows are ordered by the mean place of what they touch, a few times up and down.
"""

import html
from math import fsum  # the same digits by every Python

BOX, HEIGHT, GAP, ROW, MARGIN = 96, 30, 22, 62, 20
# one colour a layer, from the bottom up, dark enough behind white text on either ground
COLOURS = ("#57606a", "#8250df", "#0969da", "#1a7f37", "#9a6700", "#bc4c00", "#cf222e")
STYLE = """
  .ground { fill: #ffffff } .arrow { stroke: #6e7781; fill: none; stroke-width: 1.3 } .head { fill: #6e7781 }
  .legend { fill: #1f2328; font: 13px sans-serif } .name { fill: #ffffff; font: 600 14px sans-serif; text-anchor: middle }
  @media (prefers-color-scheme: dark) { .ground { fill: #0d1117 } .legend { fill: #e6edf3 }
    .arrow { stroke: #8b949e } .head { fill: #8b949e } }
"""


def rows_of(arrows, crates):
    """Crates by row: one above the highest that it uses, the bottom row first."""
    def row(crate):
        return max((row(used) + 1 for used in arrows.get(crate, ())), default=0)

    return {crate: row(crate) for crate in crates}


def spread(order, place, wide):
    """New places of a row: as near to the wanted ones as its order and the boxes' widths allow."""
    at = {}
    for node in order:
        before = [at[n] + (wide(n) + wide(node)) / 2 + GAP for n in at]
        at[node] = max([place[node], *before[-1:]])
    off = fsum(at[n] - place[n] for n in order) / len(order)
    return {n: at[n] - off for n in order}


def layout(arrows, crates):
    """Rows of nodes and where each node is; a node is a crate or (crate, used, row) on an arrow's way."""
    row = rows_of(arrows, crates)
    rows, steps = [[] for _ in range(max(row.values()) + 1)], []
    for crate in crates:
        rows[row[crate]].append(crate)
        for used in sorted(arrows.get(crate, ())):
            way = [crate, *((crate, used, r) for r in range(row[crate] - 1, row[used], -1)), used]
            for node in way[1:-1]:
                rows[node[2]].append(node)
            steps += zip(way, way[1:])
    wide = lambda node: BOX if isinstance(node, str) else 0
    at = {}
    for nodes in rows:
        at.update(spread(nodes, dict.fromkeys(nodes, 0), wide))
    touching = {node: [b for a, b in steps if a == node] + [a for a, b in steps if b == node] for node in at}
    for turn in range(24):
        for nodes in rows if turn % 2 else rows[::-1]:
            wanted = {n: fsum(at[other] for other in touching[n]) / max(1, len(touching[n])) for n in nodes}
            nodes.sort(key=lambda n: (wanted[n], str(n)))
            at.update(spread(nodes, wanted, wide))
    return rows, at, steps


def svg(arrows, layers):
    """The picture of `arrows` ({crate: crates it uses}); `layers`: {layer: its crates}, from the bottom up."""
    crates = [crate for members in layers.values() for crate in members]
    rows, at, steps = layout(arrows, crates)
    colour = {crate: COLOURS[i % len(COLOURS)] for i, members in enumerate(layers.values()) for crate in members}
    left = min(at.values()) - BOX / 2 - MARGIN
    level = {node: i for i, nodes in enumerate(rows) for node in nodes}
    x = lambda node: round(at[node] - left, 1)
    y = lambda node: MARGIN + (len(rows) - 1 - level[node]) * ROW + HEIGHT // 2
    legend = round(max(at.values()) - left + BOX / 2 + 30)
    width, height = legend + 150, 2 * MARGIN + (len(rows) - 1) * ROW + HEIGHT
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img">',
        "<title>The crates of kinelm, each above those that it uses</title>",
        f"<style>{STYLE}</style>",
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path class="head" d="M0 0 8 4 0 8z"/></marker></defs>',
        f'<rect class="ground" width="{width}" height="{height}" rx="8"/>',
    ]
    for a, b in steps:
        top, end = y(a) + (HEIGHT // 2 if a in colour else 0), y(b) - (HEIGHT // 2 if b in colour else 0)
        middle = (top + end) / 2
        head = ' marker-end="url(#head)"' if b in colour else ""
        out.append(f'<path class="arrow" d="M{x(a)} {top}C{x(a)} {middle} {x(b)} {middle} {x(b)} {end}"{head}/>')
    for crate in crates:
        out.append(
            f'<rect x="{x(crate) - BOX / 2}" y="{y(crate) - HEIGHT // 2}" width="{BOX}" height="{HEIGHT}" rx="6" '
            f'fill="{colour[crate]}"/><text class="name" x="{x(crate)}" y="{y(crate) + 5}">{html.escape(crate)}</text>'
        )
    for i, (layer, members) in enumerate(reversed(layers.items())):
        top = MARGIN + i * 24
        out.append(
            f'<rect x="{legend}" y="{top}" width="14" height="14" rx="3" fill="{colour[members[0]]}"/>'
            f'<text class="legend" x="{legend + 22}" y="{top + 12}">{html.escape(layer)}</text>'
        )
    return "\n".join([*out, "</svg>", ""])
