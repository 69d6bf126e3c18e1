// Dancers on a stage: the clock, the camera, and what is drawn at a moment.

import { Composition } from './capsules.js';
import { clamp } from './figure.js';
import { multiply, perspective, viewFrom } from './scene.js';

/** @param {number} t */
export const ease = t => t * t * (3 - 2 * t);
const mix = (/** @type {number} */ a, /** @type {number} */ b, /** @type {number} */ t) => a + (b - a) * t;

export const HOME = { yaw: 0.0, pitch: 0.13, zoom: 1, pan: [0, 0, 0] };
export const FOV = 0.46;
const HOLD_S = 0.7;                                  // stillness at the end before it starts again

/**
 * @typedef {import('./figure.js').Figure} Figure
 * @typedef {{ follow(time: number, speed: number): void, now(): number | null, seek(time: number): void }} Sound
 * @typedef {{ wide: number, deep: number, high: number, middle: number[] }} Room
 */

export class Stage {
  constructor() {
    this.state = {
      time: 0, playing: true, speed: 1, loop: true, follow: true, overlay: false, trails: false,
      ghost: false, contacts: false, inPlace: false, mesh: true,
      from: 0, upto: Infinity,                       // what is played of the whole
      overlaid: 0, following: 1,                     // 0 to 1: where a change of the two above has got to
      yaw: HOME.yaw, pitch: HOME.pitch, zoom: HOME.zoom, pan: [0, 0, 0], rested: 0, dirty: true,
    };
    /** @type {Figure[]} */
    this.figures = [];
    this.unit = 1;
    this.highest = 1;
    this.whole = 0;
    this.oneWorld = false;
    this.hold_s = HOLD_S;
    this.held = false;                               // the camera stays where it is, whatever the dancers do
    this.growing = false;                            // frames still come: at the end it waits for them
    /** @type {Sound | null} */
    this.sound = null;
    /** @type {Record<string, any>} floor, line, ink, given, selected, ring, shadow */
    this.colours = {};
    // the part of the height that labels and bar take, in heights of a dancer
    this.margin = { high: 0.24, low: -0.015 };
    this.things = new Composition();
    /** @type {Map<string, Room>} */
    this.rooms = new Map();
    this.lens = new Float32Array(16);
    this.turned = new Float32Array(16);
    this.target = [0, 0, 0];
    this.spot = [0, 0];
    this.drift = [0, 0];
    this.seen = { view: new Float32Array(16), eye: new Float32Array(3), centre: [0, 0], distance: 1, reach: 1, unit: 1 };
    this.onPlay = () => {};
  }

  /** @param {Figure[]} figures */
  setFigures(figures) {
    const most = (/** @type {(f: Figure) => number} */ of) => Math.max(...figures.map(of));
    this.figures = figures;
    this.unit = figures.length ? most(f => f.height) : 1;
    this.highest = figures.length ? most(f => f.top) : 1;
    this.whole = figures.length ? most(f => f.lasts) : 0;
    // figures of one world stand to each other as their clips put them
    this.oneWorld = figures.length > 1 && figures.every(f => f.world === figures[0].world);
    this.things.reserve(figures);
    this.rooms.clear();
    this.state.dirty = true;
  }

  // ---- time ----
  get end() {
    return Math.min(this.whole, this.state.upto);
  }

  get begin() {
    return Math.min(this.state.from, this.end);
  }

  /** @param {boolean} on */
  play(on) {
    if (on && this.state.time >= this.end) this.seek(this.begin);
    this.state.playing = on;
    this.state.dirty = true;
    this.onPlay();
  }

  /** @param {number} time */
  seek(time) {
    this.state.time = clamp(time, 0, this.whole);
    this.state.rested = 0;
    this.state.dirty = true;
    if (this.sound) this.sound.seek(this.state.time);
  }

  // Time passes: the dance, and changes that take a moment.
  /** @param {number} dt seconds */
  advance(dt) {
    const { state, sound } = this, end = this.end;
    if (sound) sound.follow(state.time, state.playing && state.time < end ? state.speed : 0);
    if (state.playing) {
      state.dirty = true;
      // the sound's time where there is sound: it can't be made to wait
      const heard = sound ? sound.now() : null;
      state.time = heard === null || heard >= end ? state.time + dt * state.speed : heard;
      if (state.time >= end) {
        state.time = end;
        state.rested += dt;
        if (!this.growing && (state.rested > this.hold_s || this.whole === 0)) state.loop ? this.seek(this.begin) : this.play(false);
      }
    }
    state.overlaid = this.moved(state.overlaid, state.overlay, dt);
    state.following = this.moved(state.following, state.follow, dt);
  }

  /** @param {number} at @param {boolean} goal @param {number} dt */
  moved(at, goal, dt) {
    if (at === Number(goal)) return at;
    this.state.dirty = true;
    return clamp(at + (goal ? dt : -dt) / 0.6, 0, 1);
  }

  // ---- dancers ----
  // Where a figure is at a time, `onto` 0 to 1 of the way from side by side to one spot.
  /** @param {Figure} figure @param {number} time @param {number} onto */
  place(figure, time, onto) {
    for (let i = 0; i < 2; i++) figure.shift[i] = mix(figure.beside[i], figure.onto[i], onto);
    if (!this.state.inPlace) return;
    figure.drift(time, this.drift);
    for (let i = 0; i < 2; i++) figure.shift[i] -= this.drift[i];
  }

  compose(plain = false) {
    const { state, things } = this, onto = ease(state.overlaid);
    things.clear();
    for (const figure of this.figures) {
      this.place(figure, state.time, onto);
      figure.places(state.time, figure.now);
      if (figure.shows(state.time)) things.add(figure, state, this.colours, plain);
    }
  }

  // ---- camera ----
  // How much room the dances need around the point that the camera looks at, over the whole time: found once for each
  // arrangement of the figures and of the camera.
  /** @param {boolean} overlay @param {boolean} follow @returns {Room} */
  roomFor(overlay, follow) {
    const key = `${overlay} ${follow} ${this.state.inPlace}`, known = this.rooms.get(key);
    if (known) return known;
    const { figures, whole, unit } = this, at = [0, 0];
    const settle = (/** @type {number} */ time) => figures.forEach(f => this.place(f, time, Number(overlay)));
    const middle = [0, 0];
    for (const time of [0, whole / 2, whole]) {
      settle(time);
      this.centre(time, at);
      middle[0] += at[0] / 3;
      middle[1] += at[1] / 3;
    }
    const room = { wide: 0.5 * unit, deep: 0, high: unit, middle };
    for (let i = 0; i <= 120; i++) {
      const time = whole * i / 120;
      settle(time);
      const [cx, cz] = follow ? this.centre(time, at) : middle;
      const nobody = !figures.some(f => f.shows(time));
      for (const f of figures) {
        if (!nobody && !f.shows(time)) continue;
        f.places(time, f.now);
        for (let k = 0; k < f.now.length; k += 3) {
          room.wide = Math.max(room.wide, Math.abs(f.now[k] + f.shift[0] - cx));
          room.deep = Math.max(room.deep, f.now[k + 2] + f.shift[1] - cz);
          room.high = Math.max(room.high, f.now[k + 1]);
        }
      }
    }
    settle(this.state.time);
    for (const f of figures) {
      this.place(f, this.state.time, ease(this.state.overlaid));
      f.places(this.state.time, f.now);
    }
    this.rooms.set(key, room);
    return room;
  }

  // The middle of all dancers on the stage around a time, with the shifts that they have.
  /** @param {number} time @param {number[]} out */
  centre(time, out) {
    let x = 0, z = 0, n = 0;
    const nobody = !this.figures.some(f => f.shows(time));
    for (const f of this.figures) {
      if (!nobody && !f.shows(time)) continue;
      f.about(time, this.spot);
      x += this.spot[0];
      z += this.spot[1];
      n++;
    }
    out[0] = x / (n || 1);
    out[1] = z / (n || 1);
    return out;
  }

  /** @param {'wide' | 'deep' | 'high'} name */
  size(name) {
    const onto = ease(this.state.overlaid);
    const still = mix(this.roomFor(false, false)[name], this.roomFor(true, false)[name], onto);
    return mix(still, mix(this.roomFor(false, true)[name], this.roomFor(true, true)[name], onto), ease(this.state.following));
  }

  // The camera of this moment, for a picture of this many pixels.
  /** @param {number} width @param {number} height */
  camera(width, height) {
    const { state, unit, margin, target, seen } = this, aspect = width / height, tan = Math.tan(FOV / 2);
    if (this.held) return seen;
    const high = this.size('high'), onto = ease(state.overlaid), following = ease(state.following);
    const fitHigh = (0.5 * high + margin.high * unit) / tan, fitWide = (this.size('wide') + 0.12 * unit) / (tan * aspect);
    const distance = (Math.max(fitHigh, fitWide) + Math.min(this.size('deep'), 2 * unit)) * state.zoom;
    this.centre(state.time, seen.centre);
    for (let i = 0; i < 2; i++) {
      const still = mix(this.roomFor(false, false).middle[i], this.roomFor(true, false).middle[i], onto);
      seen.centre[i] = mix(still, seen.centre[i], following);
    }
    target[0] = seen.centre[0] + state.pan[0];
    target[1] = 0.5 * high + margin.low * unit + state.pan[1];
    target[2] = seen.centre[1] + state.pan[2];
    const cp = Math.cos(state.pitch);
    seen.eye[0] = target[0] + distance * cp * Math.sin(state.yaw);
    seen.eye[1] = Math.max(target[1] + distance * Math.sin(state.pitch), 0.02 * unit);
    seen.eye[2] = target[2] + distance * cp * Math.cos(state.yaw);
    perspective(FOV, aspect, 0.02 * distance, distance * 4 + 60 * unit, this.lens);
    viewFrom(seen.eye, state.yaw, state.pitch, this.turned);
    multiply(this.lens, this.turned, seen.view);
    seen.distance = distance;
    seen.reach = 2.2 * distance;
    seen.unit = unit;
    return seen;
  }

  resetView() {
    Object.assign(this.state, { yaw: HOME.yaw, pitch: HOME.pitch, zoom: HOME.zoom, pan: [0, 0, 0], dirty: true });
  }

  /** @param {number} dx @param {number} dy pixels */
  orbit(dx, dy) {
    this.state.yaw -= dx * 0.006;
    this.state.pitch = clamp(this.state.pitch + dy * 0.006, -0.05, 1.5);
    this.state.dirty = true;
  }

  // Moves what the camera looks at with the pointer, at the dancers' distance.
  /** @param {number} dx @param {number} dy pixels @param {number} height of the picture, pixels */
  pan(dx, dy, height) {
    const metres = 2 * Math.tan(FOV / 2) * this.seen.distance / height, { state } = this;
    state.pan[0] -= Math.cos(state.yaw) * dx * metres;
    state.pan[2] += Math.sin(state.yaw) * dx * metres;
    state.pan[1] = clamp(state.pan[1] + dy * metres, -this.unit, 3 * this.unit);
    state.dirty = true;
  }

  /** @param {number} by */
  zoom(by) {
    this.state.zoom = clamp(this.state.zoom * by, 0.12, 6);
    this.state.dirty = true;
  }
}
