// From dancers to capsules, shadows, rings, trails and paths.

import { CAPSULE, SHADOW } from './scene.js';

const TRAIL = 40, TRAIL_S = 1.3;
const PIECES = 2000;                                 // of all paths of a dancer: long ones are thinned

/**
 * @typedef {import('./figure.js').Figure} Figure
 * @typedef {{ time: number, trails: boolean, ghost: boolean, contacts: boolean, inPlace: boolean }} Looks
 */

export class Composition {
  constructor() {
    this.capsules = new Float32Array(0);
    this.ghosts = new Float32Array(0);
    this.shadows = new Float32Array(0);
    this.rings = new Float32Array(0);
    this.paths = new Float32Array(0);
    this.capsuleCount = this.ghostCount = this.shadowCount = this.ringCount = this.pathCount = 0;
    this.spots = [new Float32Array(3), new Float32Array(3)];
    this.drifts = [[0, 0], [0, 0], [0, 0]];
  }

  // Room for all that these dancers can show, so that no picture needs new arrays.
  /** @param {Figure[]} figures */
  reserve(figures) {
    const sum = (/** @type {(f: Figure) => number} */ of) => figures.reduce((n, f) => n + of(f), 0);
    const body = (/** @type {Figure} */ f) => f.bones.length + f.balls.length;
    this.capsules = new Float32Array(CAPSULE * sum(f => body(f) + f.tips.length * TRAIL));
    this.ghosts = new Float32Array(CAPSULE * sum(f => f.bones.length + body(f) + (f.original ? body(f.original) : 0)));
    this.shadows = new Float32Array(SHADOW * sum(f => f.points));
    this.rings = new Float32Array(SHADOW * sum(f => f.points));
    this.paths = new Float32Array(CAPSULE * sum(f => f.paths.length * Math.ceil((f.frames - 1) / this.thinned(f))));
  }

  clear() {
    this.capsuleCount = this.ghostCount = this.shadowCount = this.ringCount = this.pathCount = 0;
  }

  // One capsule, its colour `t` of the way to another.
  /** @param {Float32Array} c @param {number} i @param {number} ax @param {number} ay @param {number} az @param {number} ra
   *  @param {number} bx @param {number} by @param {number} bz @param {number} rb
   *  @param {number[]} colour @param {number[]} towards @param {number} t */
  put(c, i, ax, ay, az, ra, bx, by, bz, rb, colour, towards, t) {
    c[i] = ax; c[i + 1] = ay; c[i + 2] = az; c[i + 3] = ra;
    c[i + 4] = bx; c[i + 5] = by; c[i + 6] = bz; c[i + 7] = rb;
    for (let k = 0; k < 3; k++) c[i + 8 + k] = colour[k] + (towards[k] - colour[k]) * t;
  }

  /** @param {Figure} figure @param {Looks} looks @param {Record<string, any>} colours @param {boolean} plain */
  add(figure, looks, colours, plain) {
    this.addBody(figure, Math.min(looks.time, figure.lasts), colours, plain);
    this.addShadows(figure, colours);
    if (plain) return;
    if (figure.paths.length) this.addPaths(figure, looks, colours);
    if (looks.trails) this.addTrails(figure, looks, colours);
    if (looks.contacts && figure.contacts) this.addRings(figure, Math.min(looks.time, figure.lasts));
    if (looks.ghost && figure.original) this.addGhost(figure, figure.original, looks);
  }

  /** @param {Figure} figure @param {number} time @param {Record<string, any>} colours @param {boolean} plain */
  addBody(figure, time, colours, plain) {
    const p = figure.now, [sx, sz] = figure.shift, own = figure.colour, { given, ink } = colours;
    const list = figure.faint ? this.ghosts : this.capsules, isClothed = figure.isClothed && !figure.faint && !plain;
    let next = figure.faint ? this.ghostCount : this.capsuleCount;
    for (const bone of isClothed ? [] : figure.bones) {
      const a = 3 * bone.a, b = 3 * bone.b, colour = figure.isGiven(bone, bone.a, time) ? given : own;
      this.put(list, CAPSULE * next++, p[a] + sx, p[a + 1], p[a + 2] + sz, bone.ra,
        p[b] + sx, p[b + 1], p[b + 2] + sz, bone.rb, colour, colour, 0);
    }
    for (const ball of isClothed ? [] : figure.balls) {
      const i = 3 * ball.at, x = p[i] + sx, y = p[i + 1], z = p[i + 2] + sz, isGiven = figure.isGiven(ball, ball.at, time);
      this.put(list, CAPSULE * next++, x, y, z, ball.r, x, y, z, ball.r, isGiven ? given : own, ink, plain ? 0 : isGiven ? 0.12 : 0.16);
    }
    if (figure.faint) this.ghostCount = next;
    else this.capsuleCount = next;
    if (!figure.selected || plain) return;
    for (const bone of figure.bones) if (figure.selected[bone.a]) this.addHalo(bone, p, sx, sz, colours);
  }

  // A selected limb: a wider ghost around it.
  /** @param {import('./figure.js').Bone} bone @param {Float32Array} p @param {number} sx @param {number} sz
   *  @param {Record<string, any>} colours */
  addHalo(bone, p, sx, sz, colours) {
    const a = 3 * bone.a, b = 3 * bone.b;
    this.put(this.ghosts, CAPSULE * this.ghostCount++, p[a] + sx, p[a + 1], p[a + 2] + sz, 1.3 * bone.ra + 0.012,
      p[b] + sx, p[b + 1], p[b + 2] + sz, 1.3 * bone.rb + 0.012, colours.selected, colours.selected, 0);
  }

  /** @param {Figure} figure @param {Record<string, any>} colours */
  addShadows(figure, colours) {
    const p = figure.now, [sx, sz] = figure.shift, h = figure.height, s = this.shadows;
    for (let i = 0; i < figure.points; i++) {
      const y = Math.max(0, p[3 * i + 1]) / h, k = SHADOW * this.shadowCount++;
      s[k] = p[3 * i] + sx;
      s[k + 1] = p[3 * i + 2] + sz;
      s[k + 2] = (0.075 + 0.42 * y) * h;
      s[k + 3] = colours.shadow * (0.6 * Math.exp(-y / 0.05) + 0.09 * Math.exp(-y / 0.4));
    }
  }

  /** @param {Figure} figure @param {number} time */
  addRings(figure, time) {
    const p = figure.now, [sx, sz] = figure.shift, s = this.rings;
    for (let i = 0; i < figure.points; i++) {
      const spans = figure.contacts?.[i];
      if (!spans?.some(span => time >= span[0] && time < span[1])) continue;
      const k = SHADOW * this.ringCount++;
      s[k] = p[3 * i] + sx;
      s[k + 1] = p[3 * i + 2] + sz;
      s[k + 2] = 0.075 * figure.height;
      s[k + 3] = 0.9;
    }
  }

  // The ways of hands and feet; in place they are those relative to the root.
  /** @param {Figure} figure @param {Looks} looks @param {Record<string, any>} colours */
  addTrails(figure, looks, colours) {
    const [sx, sz] = figure.shift, time = Math.min(looks.time, figure.lasts), [a, b] = this.spots;
    const [here, late, early] = this.drifts;
    if (looks.inPlace) figure.drift(time, here);
    for (const tip of figure.tips) {
      const limb = figure.bones.find(bone => bone.b === tip);
      for (let k = 0; k < TRAIL; k++) {
        const lateS = time - k * TRAIL_S / TRAIL, earlyS = time - (k + 1) * TRAIL_S / TRAIL;
        if (earlyS < 0) break;
        figure.places(lateS, a, tip, tip + 1);
        figure.places(earlyS, b, tip, tip + 1);
        if (looks.inPlace) {
          figure.drift(lateS, late);
          figure.drift(earlyS, early);
          for (let i = 0; i < 2; i++) {
            a[2 * i] += here[i] - late[i];
            b[2 * i] += here[i] - early[i];
          }
        }
        const radius = 0.0085 * figure.height, given = limb && figure.isGiven(limb, limb.a, lateS);
        this.put(this.capsules, CAPSULE * this.capsuleCount++, a[0] + sx, a[1], a[2] + sz, radius * (1 - k / TRAIL),
          b[0] + sx, b[1], b[2] + sz, radius * (1 - (k + 1) / TRAIL), given ? colours.given : figure.colour, colours.floor, 0.15 + 0.7 * k / TRAIL);
      }
    }
  }

  // Frames from one place of a path to the next.
  /** @param {Figure} figure */
  thinned(figure) {
    return Math.max(1, Math.ceil((figure.frames - 1) * figure.paths.length / PIECES));
  }

  // The whole paths of joints, paler from this moment on.
  /** @param {Figure} figure @param {Looks} looks @param {Record<string, any>} colours */
  addPaths(figure, looks, colours) {
    const [sx, sz] = figure.shift, [a, b] = this.spots, { fps, frames } = figure;
    const step = this.thinned(figure), radius = 0.0045 * figure.height;
    for (const point of figure.paths) {
      figure.places(0, b, point, point + 1);
      for (let from = 0; from < frames - 1; from += step) {
        const upto = Math.min(from + step, frames - 1);
        a.set(b);
        figure.places(upto / fps, b, point, point + 1);
        this.put(this.paths, CAPSULE * this.pathCount++, a[0] + sx, a[1], a[2] + sz, radius,
          b[0] + sx, b[1], b[2] + sz, radius, figure.colour, colours.floor, upto / fps <= looks.time ? 0.1 : 0.6);
      }
    }
  }

  // What a dancer was made from, at the dancer's own place.
  /** @param {Figure} figure @param {Figure} original @param {Looks} looks */
  addGhost(figure, original, looks) {
    original.places(looks.time, original.now);
    const p = original.now, own = original.colour;
    let [sx, sz] = figure.shift;
    if (looks.inPlace) {
      const [mine, its] = this.drifts;
      figure.drift(looks.time, mine);
      original.drift(looks.time, its);
      sx += mine[0] - its[0];
      sz += mine[1] - its[1];
    }
    for (const bone of original.bones) {
      if (figure.covers(bone, original, looks.time)) continue;
      const a = 3 * bone.a, b = 3 * bone.b;
      this.put(this.ghosts, CAPSULE * this.ghostCount++, p[a] + sx, p[a + 1], p[a + 2] + sz, bone.ra,
        p[b] + sx, p[b + 1], p[b + 2] + sz, bone.rb, own, own, 0);
    }
  }
}
