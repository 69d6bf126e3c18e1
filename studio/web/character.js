// A character in the pose of a moment: where each node stands, and what that makes of each joint of a skin.

import { multiply } from './scene.js';

/** @typedef {import('./glb.js').Glb} Glb @typedef {import('./glb.js').Part} Part @typedef {import('./glb.js').Skin} Skin */

export class Character {
  /** @param {Glb} glb @param {Float32Array} toStage (4, 4) from the file's world */
  constructor(glb, toStage) {
    this.glb = glb;
    this.toStage = toStage;
    // those above come before those below
    const depth = (/** @type {number} */ node) => {
      let n = 0;
      for (let at = glb.nodes[node].parent; at >= 0 && n <= glb.nodes.length; at = glb.nodes[at].parent) n++;
      return n;
    };
    this.order = glb.nodes.map((_, i) => i).sort((a, b) => depth(a) - depth(b));
    this.now = glb.nodes.map(({ place, turn, scale }) => ({ place: [...place], turn: [...turn], scale: [...scale] }));
    this.worlds = glb.nodes.map(() => new Float32Array(16));
    this.own = new Float32Array(16);
    this.time = NaN;
    /** @type {Map<Skin, Float32Array>} (joints, 4, 4) */
    this.skins = new Map();
    for (const { skin } of glb.parts) if (skin) this.skins.set(skin, new Float32Array(16 * skin.joints.length));
  }

  // Stands as at a time, seconds.
  /** @param {number} time */
  pose(time) {
    if (time === this.time) return;
    this.time = time;
    const { nodes, tracks } = this.glb;
    for (const { node, path, times, values } of tracks) {
      const now = this.now[node];
      if (path === 'rotation') turnAt(times, values, time, now.turn);
      else placeAt(times, values, time, path === 'scale' ? now.scale : now.place);
    }
    for (const node of this.order) {
      const { parent } = nodes[node];
      matrixOf(this.now[node], this.own);
      multiply(parent < 0 ? this.toStage : this.worlds[parent], this.own, this.worlds[node]);
    }
    for (const [skin, all] of this.skins) {
      skin.joints.forEach((node, j) => {
        multiply(this.worlds[node], skin.inverse.subarray(16 * j, 16 * j + 16), all.subarray(16 * j, 16 * j + 16));
      });
    }
  }

  // What moves a part's vertices (joints, 4, 4): its skin's joints, or the one node that it hangs on.
  /** @param {Part} part */
  matrices({ skin, node }) {
    return skin ? /** @type {Float32Array} */ (this.skins.get(skin)) : this.worlds[node];
  }
}

// The keys around a time: the one before it, and how far it is to the next.
/** @param {Float32Array} times @param {number} time @returns {[number, number]} */
function between(times, time) {
  let low = 0,
    high = times.length - 1;
  if (time <= times[0] || high === 0) return [0, 0];
  if (time >= times[high]) return [high - 1, 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return [low, (time - times[low]) / (times[high] - times[low])];
}

/** @param {Float32Array} times @param {Float32Array} values @param {number} time @param {number[]} out */
function placeAt(times, values, time, out) {
  const [at, t] = between(times, time);
  for (let k = 0; k < 3; k++) out[k] = values[3 * at + k] + (t ? t * (values[3 * at + 3 + k] - values[3 * at + k]) : 0);
}

// Along the straight line between two keys, which of keys in every frame is as good as along the sphere.
/** @param {Float32Array} times @param {Float32Array} values @param {number} time @param {number[]} out */
function turnAt(times, values, time, out) {
  const [at, t] = between(times, time),
    a = 4 * at,
    b = t ? a + 4 : a;
  let dot = 0,
    size = 0;
  for (let k = 0; k < 4; k++) dot += values[a + k] * values[b + k];
  for (let k = 0; k < 4; k++) {
    out[k] = (1 - t) * values[a + k] + t * (dot < 0 ? -1 : 1) * values[b + k];
    size += out[k] * out[k];
  }
  size = Math.sqrt(size);
  for (let k = 0; k < 4; k++) out[k] /= size;
}

/** @param {{ place: number[], turn: number[], scale: number[] }} node @param {Float32Array} m */
function matrixOf({ place, turn: [x, y, z, w], scale }, m) {
  const turned = [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
  for (let c = 0; c < 3; c++) {
    for (let r = 0; r < 3; r++) m[4 * c + r] = turned[c][r] * scale[c];
    m[4 * c + 3] = 0;
    m[12 + c] = place[c];
  }
  m[15] = 1;
}
