// Which limb is under the pointer.

const NEAR = 5; // pixels beside a limb that still count

/**
 * @template {import('./figure.js').Figure} Dancer
 * @param {import('./stage.js').Stage} stage @param {Dancer[]} dancers @param {number} x @param {number} y pixels
 * @param {HTMLCanvasElement} canvas
 * @returns {{ dancer: Dancer, joint: number } | null}
 */
export function picked(stage, dancers, x, y, canvas) {
  const { view, eye } = stage.seen,
    { clientWidth: width, clientHeight: height } = canvas;
  const pixels = height / (2 * Math.tan(0.23)); // of a metre at a distance of one
  let best = null,
    nearest = Infinity;
  const project = (/** @type {number[]} */ p) => {
    const w = view[3] * p[0] + view[7] * p[1] + view[11] * p[2] + view[15];
    const on = (/** @type {number} */ i) =>
      (view[i] * p[0] + view[4 + i] * p[1] + view[8 + i] * p[2] + view[12 + i]) / w;
    return [(0.5 + 0.5 * on(0)) * width, (0.5 - 0.5 * on(1)) * height, w];
  };
  for (const dancer of dancers) {
    if (!dancer.shows(stage.state.time)) continue;
    const at = (/** @type {number} */ i) => [
      dancer.now[3 * i] + dancer.shift[0],
      dancer.now[3 * i + 1],
      dancer.now[3 * i + 2] + dancer.shift[1],
    ];
    for (const { a, b, ra, rb } of dancer.bones) {
      const pa = at(a),
        pb = at(b),
        [ax, ay, wa] = project(pa),
        [bx, by, wb] = project(pb);
      if (wa <= 0 || wb <= 0) continue;
      const dx = bx - ax,
        dy = by - ay,
        t = Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)));
      const away = Math.hypot(ax + t * dx - x, ay + t * dy - y),
        w = wa + t * (wb - wa);
      const radius = (pixels * (ra + t * (rb - ra))) / w;
      const far = Math.hypot(...pa.map((v, i) => v + t * (pb[i] - v) - eye[i]));
      // outside its surface it counts as further away than anything that is hit
      const order = away <= radius ? far : 1e3 + away;
      if (away <= radius + NEAR && order < nearest) {
        nearest = order;
        best = { dancer, joint: a };
      }
    }
  }
  return best;
}
