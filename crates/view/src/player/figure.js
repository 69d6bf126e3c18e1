// One dancer: its places at any time, from 16-bit numbers.

/** @param {number} v @param {number} low @param {number} high */
export const clamp = (v, low, high) => Math.min(high, Math.max(low, v));

/**
 * @typedef {{ a: number, b: number, ra: number, rb: number, given: boolean }} Bone
 * @typedef {{ at: number, r: number, given: boolean }} Ball
 * @typedef {{ title: string, note: string, fps: number, frames: number, points: number, height: number, world: number,
 *   bones: Bone[], balls: Ball[], tips: number[], paths?: number[], beside: number[], onto: number[], low: number[], step: number,
 *   data: string, given_s?: number[], anew: number[][], hits?: { beats: number[], says: string } }} FigureData
 *   What the program writes of a dancer; a position is `low + step * number`.
 */

/** @param {string} text @returns {Uint16Array} */
export function decoded(text) {
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return new Uint16Array(bytes.buffer, 0, bytes.length >> 1);   // little-endian, as every browser's machine is
}

const root = new Float32Array(3);

export class Figure {
  /** @param {FigureData} data @param {Uint16Array} numbers (frames, points, 3) */
  constructor(data, numbers) {
    this.title = data.title;
    this.note = data.note;
    this.fps = data.fps;
    this.frames = data.frames;
    this.points = data.points;
    this.height = data.height;
    this.world = data.world;
    this.bones = data.bones;
    this.balls = data.balls;
    this.tips = data.tips;
    this.paths = data.paths ?? [];                    // points whose whole path is drawn
    this.beside = data.beside;
    this.onto = data.onto;
    this.low = data.low;
    this.step = data.step;
    this.given_s = data.given_s;
    this.anew = data.anew;
    this.hits = data.hits;
    this.numbers = numbers;
    this.now = new Float32Array(this.points * 3);    // places of this moment, without the shift
    this.shift = [0, 0];
    this.top = this.highest();
    this.colour = [0, 0, 0];
    /** @type {Figure | null} what it was made from, drawn as a ghost at its place */
    this.original = null;
    this.named = true;                               // its label is shown
    this.faint = false;                              // one can see through it
    this.isClothed = false;                          // its body is drawn otherwise than by capsules
    /** @type {Uint8Array | null} (points): the joints that are selected */
    this.selected = null;
    /** @type {number[][][] | null} (points): the seconds, from and to, in which each is on the floor */
    this.contacts = null;
  }

  get lasts() {
    return (this.frames - 1) / this.fps;
  }

  highest() {
    let most = 0;
    for (let i = 1; i < this.frames * this.points * 3; i += 3) most = Math.max(most, this.numbers[i]);
    return this.low[1] + this.step * most;
  }

  // Whether it is on the stage at a time.
  /** @param {number} _time */
  shows(_time) {
    return true;
  }

  // Whether the joint that rotates a bone is given at a time.
  /** @param {Bone | Ball} part @param {number} _joint @param {number} time */
  isGiven(part, _joint, time) {
    const over = this.given_s;
    return part.given && (!over || (time >= over[0] && time < over[1]));
  }

  // Whether it is at a time where its original is with a bone, so that a ghost of it would only flicker.
  /** @param {Bone} bone @param {Figure} original @param {number} time */
  covers(bone, original, time) {
    return this.points === original.points && this.isGiven(bone, bone.a, time);
  }

  // Places of points `from` to `upto` at a time, between frames along a Catmull-Rom curve; held beyond the ends.
  /** @param {number} time @param {Float32Array} out */
  places(time, out, from = 0, upto = this.points) {
    const last = this.frames - 1, n = this.numbers, size = this.points * 3;
    const frame = clamp(time * this.fps, 0, last), at = Math.floor(frame), u = frame - at;
    const a = Math.max(at - 1, 0) * size, b = at * size, c = Math.min(at + 1, last) * size, d = Math.min(at + 2, last) * size;
    const wa = 0.5 * u * (u * (2 - u) - 1), wb = 0.5 * (u * u * (3 * u - 5) + 2);
    const wc = 0.5 * u * (u * (4 - 3 * u) + 1), wd = 0.5 * u * u * (u - 1);
    for (let i = from * 3, o = 0; i < upto * 3; i++, o++) {
      out[o] = this.low[i % 3] + this.step * (wa * n[a + i] + wb * n[b + i] + wc * n[c + i] + wd * n[d + i]);
    }
  }

  // Where the figure is on the floor around a time, with its shift: the root's mean over a second and a half, so that
  // nothing jitters.
  /** @param {number} time @param {number[]} out */
  about(time, out) {
    let x = 0, z = 0;
    for (let i = -4; i <= 4; i++) {
      this.places(time + i * 0.18, root, 0, 1);
      x += root[0] / 9;
      z += root[2] / 9;
    }
    out[0] = x + this.shift[0];
    out[1] = z + this.shift[1];
    return out;
  }

  // How far its root is from where it began: what is taken off to dance in place.
  /** @param {number} time @param {number[]} out */
  drift(time, out) {
    this.places(time, root, 0, 1);
    out[0] = root[0];
    out[1] = root[2];
    this.places(0, root, 0, 1);
    out[0] -= root[0];
    out[1] -= root[2];
    return out;
  }
}
