// Figures of clips and dances: loaded once, decoded beside the page, and growing while a dance is sampled.

import { forgetCharacter } from './characters.js';
import { decoded } from './figure.js';

/** @typedef {import('./types.js').FigureData} FigureData */

/**
 * A figure's numbers. They are replaced where more frames need more room.
 * @typedef {{ head: FigureData, numbers: Uint16Array, frames: number, top: number, live: boolean }} Loaded
 */

// Numbers of whole figures that are kept, bytes; small ones take some 20 KB each.
const MOST_BYTES = 256 << 20,
  MOST_SMALL = 400;
const SMALL = { fps: 15, seconds: 6 };

/** @type {Map<string, { loading: Promise<Loaded>, loaded: Loaded | null }>} */
const whole = new Map();
/** @type {Map<string, Promise<Loaded>>} */
const small = new Map();
/** @type {Set<string>} figures that can't be had */
const lost = new Set();
/** @type {Map<string, Loaded>} dances that are sampled, or were until their file came */
const live = new Map();

/** @type {Worker | null} */
let worker = null;
let last = 0;
/** @type {Map<number, { done: (loaded: Loaded) => void, fail: (error: Error) => void }>} */
const waiting = new Map();

/** @param {string} url @returns {Promise<Loaded>} */
function decode(url) {
  if (!worker) {
    worker = new Worker('/assets/decode.worker.js', { type: 'module' });
    worker.onerror = event => reportError(event.error ?? new Error(event.message ?? 'decode.worker.js'));
    worker.onmessage = ({ data: { id, head, numbers, top, error } }) => {
      const one = waiting.get(id);
      waiting.delete(id);
      if (error) one?.fail(new Error(error));
      else one?.done({ head, numbers, frames: head.frames, top, live: false });
    };
  }
  const id = ++last,
    at = worker;
  return new Promise((done, fail) => {
    waiting.set(id, { done, fail });
    at.postMessage({ id, url });
  });
}

/** @param {string} id @returns {Promise<Loaded>} */
export function load(id) {
  const known = whole.get(id);
  if (known) {
    // the latest stand last
    whole.delete(id);
    whole.set(id, known);
    return known.loading;
  }
  const one = { loading: decode(`/api/clips/${id}/figure`), loaded: /** @type {Loaded | null} */ (null) };
  whole.set(id, one);
  one.loading.then(
    loaded => {
      one.loaded = loaded;
      live.delete(id);
      makeRoom();
    },
    () => {
      if (whole.get(id) !== one) return;
      whole.delete(id);
      lost.add(id);
    },
  );
  return one.loading;
}

function makeRoom() {
  let bytes = 0;
  for (const [id, { loaded }] of [...whole].reverse()) {
    bytes += loaded?.numbers.byteLength ?? 0;
    if (bytes > MOST_BYTES) whole.delete(id);
  }
}

// What is there of a figure at once: all of it, or as much as is sampled.
/** @param {string} id @returns {Loaded | null} */
export const loaded = id => whole.get(id)?.loaded ?? live.get(id) ?? null;

// The beginning of a figure, at a low rate: for cards.
/** @param {string} id @returns {Promise<Loaded>} */
export function loadSmall(id) {
  const known = small.get(id) ?? decode(`/api/clips/${id}/figure?fps=${SMALL.fps}&seconds=${SMALL.seconds}`);
  small.delete(id);
  small.set(id, known);
  known.catch(() => small.delete(id));
  for (const oldest of small.keys()) {
    if (small.size <= MOST_SMALL) break;
    small.delete(oldest);
  }
  return known;
}

// Whether a figure was asked for in vain, since it was last heard of.
/** @param {string} id */
export const isLost = id => lost.has(id);

/** @param {string} id */
export function forget(id) {
  lost.delete(id);
  whole.delete(id);
  small.delete(id);
  forgetCharacter(id);
}

// Frames that were sampled just now.
/** @param {import('./types.js').Frames} frames */
export function streamed({ dance, from, figure_head: head, data }) {
  const numbers = decoded(data);
  let figure = live.get(dance);
  if (head) {
    figure = { head, numbers: new Uint16Array(0), frames: 0, top: head.low[1], live: true };
    live.set(dance, figure);
  }
  if (!figure) return; // its beginning was missed; the dance itself will come
  const size = figure.head.points * 3,
    begin = from * size;
  if (begin + numbers.length > figure.numbers.length) {
    const room = new Uint16Array(Math.max(2 * figure.numbers.length, begin + numbers.length, 256 * size));
    room.set(figure.numbers);
    figure.numbers = room;
  }
  figure.numbers.set(numbers, begin);
  figure.frames = from + numbers.length / size;
  for (let i = 1; i < numbers.length; i += 3) {
    figure.top = Math.max(figure.top, figure.head.low[1] + figure.head.step * numbers[i]);
  }
}
