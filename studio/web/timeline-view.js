// The time axis that all lanes share: what is seen of it, and where things snap.

import { beats } from './music.js';
import { stage } from './stage-view.js';
import { currentSet, secondsOf, store, ui } from './store.js';

const NEAR = 7; // pixels within which something snaps

// Seconds at the left end, pixels a second, pixels of a track.
export const axis = { from: 0, scale: 100, width: 800, fits: true };

/** @type {(() => void)[]} */
const listeners = [];
/** @param {() => void} does */
export const onAxis = does => {
  listeners.push(does);
};

// What there is to see: the timeline, and what dances longer.
export const wholeTime = () =>
  Math.max(2, stage.whole, store.timeline.seconds, ui.mode === 'takes' ? secondsOf(currentSet()) : 0);

export const xOf = (/** @type {number} */ time) => (time - axis.from) * axis.scale;
export const timeAt = (/** @type {number} */ x) => axis.from + x / axis.scale;

// The axis after a change of what there is, of the window, or of the zoom.
export function settle() {
  const whole = wholeTime(),
    least = axis.width / (1.02 * whole);
  if (axis.fits || axis.scale <= least) Object.assign(axis, { scale: least, from: 0, fits: true });
  axis.from = Math.min(Math.max(0, axis.from), Math.max(0, 1.02 * whole - axis.width / axis.scale));
  listeners.forEach(does => does());
}

/** @param {number} by @param {number} [x] the pixel that stays */
export function zoom(by, x = axis.width / 2) {
  const time = timeAt(x);
  axis.scale = Math.min(2000, axis.scale * by);
  axis.fits = false;
  axis.from = time - x / axis.scale;
  settle();
}

/** @param {number} pixels */
export function slide(pixels) {
  axis.from += pixels / axis.scale;
  settle();
}

export function fit() {
  axis.fits = true;
  settle();
}

// Keeps the playhead in sight while it plays.
/** @param {number} time */
export function reveal(time) {
  const x = xOf(time);
  if (axis.fits || (x >= 0 && x <= axis.width)) return;
  axis.from = time - (0.1 * axis.width) / axis.scale;
  settle();
}

export const frameTime = () => 1 / (store.timeline.fps ?? store.state.model.fps);

// A time on a frame, or on a beat, an edge, the playhead or a whole second that is near.
/** @param {number} time @param {number} [but] a segment whose own edges don't count */
export function snapped(time, but) {
  const frame = frameTime(),
    round = (/** @type {number} */ t) => Math.max(0, Math.round(t / frame) * frame);
  if (!ui.snap) return round(time);
  let best = round(time),
    nearest = NEAR / axis.scale;
  const all = [0, store.timeline.seconds, stage.whole, stage.state.time, ...beats(), ...(ui.range ?? []), Math.round(time)];
  for (const segment of store.timeline.segments) if (segment.index !== but) all.push(segment.from, segment.to);
  for (const one of all) {
    if (Math.abs(one - time) >= nearest) continue;
    nearest = Math.abs(one - time);
    best = round(one);
  }
  return best;
}
