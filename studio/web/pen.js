// A path drawn on the floor of the stage, along which a new dance goes.

import { find, h, icon } from './dom.js';
import { dancersOnStage, onFrame, stage, theScene } from './stage-view.js';
import { on, store } from './store.js';

/** @typedef {[number, number]} Point x and z, metres */

// Metres between the points of a stroke, and between those that are kept: a hand is less steady than a walk.
const STROKE_M = 0.05,
  STEP_M = 0.3,
  // Shorter than a step or two it is a click.
  LEAST_M = 0.6,
  // Nobody draws as far as the horizon.
  FAR_M = 30;
// The camera looks down on a floor that is drawn on.
const PITCH = 0.95;

/** What is drawn: nothing, or where it goes, and how fast. */
export const drawn = { points: /** @type {Point[]} */ ([]), speed: '1' };
let isOn = false;
let pitch = 0;
/** @type {SVGSVGElement} */
let sheet;
/** @type {() => void} */
let changed = () => {};

const speed = () => {
  const number = Number(drawn.speed);
  return Number.isFinite(number) ? Math.min(4, Math.max(0.1, number)) : 1;
};

/** @param {readonly Point[]} points */
const lengths = points => {
  const along = [0];
  for (let i = 1; i < points.length; i++)
    along.push(along[i - 1] + Math.hypot(points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]));
  return along;
};

// The drawn path as a request has it: seconds, x and z of each place.
export function pathRows() {
  if (!drawn.points.length) return undefined;
  const along = lengths(drawn.points);
  const rounded = (/** @type {number} */ number) => Math.round(number * 1000) / 1000;
  return drawn.points.map(([x, z], i) => [rounded(along[i] / speed()), rounded(x), rounded(z)]);
}

// The path of a request again; none clears it.
/** @param {number[][] | undefined} rows */
export function takePath(rows) {
  drawn.points = (rows ?? []).map(([, x, z]) => [x, z]);
  const along = lengths(drawn.points),
    seconds = rows?.at(-1)?.[0];
  if (seconds) drawn.speed = String(Math.round((100 * along[along.length - 1]) / seconds) / 100);
  stage.state.dirty = true;
}

// Places a step apart along a stroke; each is the mean of the stroke around it, but for the ends.
/** @param {Point[]} stroke @returns {Point[]} */
function steadied(stroke) {
  const along = lengths(stroke),
    whole = along[along.length - 1];
  if (whole < LEAST_M) return [];
  const steps = Math.round(whole / STEP_M);
  return Array.from({ length: steps + 1 }, (_, n) => {
    if (n === 0) return stroke[0];
    if (n === steps) return stroke[stroke.length - 1];
    const near = stroke.filter((_, i) => Math.abs(along[i] - (n * whole) / steps) <= STEP_M / 2);
    const mean = (/** @type {0 | 1} */ k) => near.reduce((sum, point) => sum + point[k], 0) / near.length;
    return near.length ? /** @type {Point} */ ([mean(0), mean(1)]) : stroke[along.findIndex(at => at >= (n * whole) / steps)];
  });
}

// Where the floor is under a place of the picture: of its points that which is seen there. Null above the horizon and too
// far away.
/** @param {number} x @param {number} y pixels @param {HTMLCanvasElement} canvas @returns {Point | null} */
function floorAt(x, y, canvas) {
  const { view, centre } = stage.seen,
    [across, up] = [(2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight];
  // view (x, 0, z, 1) is w times (across, up): two equations for x and z
  const row = (/** @type {number} */ i, /** @type {number} */ on) => [0, 8, 12].map(k => view[k + i] - on * view[k + 3]);
  const [[a, b, e], [c, d, f]] = [row(0, across), row(1, up)],
    size = a * d - b * c;
  const at = /** @type {Point} */ ([(b * f - d * e) / size, (c * e - a * f) / size]);
  const isAhead = view[3] * at[0] + view[11] * at[1] + view[15] > 0;
  return isAhead && Math.hypot(at[0] - centre[0], at[1] - centre[1]) < FAR_M ? at : null;
}

/** @param {boolean} value */
function turn(value) {
  if (isOn === value) return;
  isOn = value;
  find('stage').classList.toggle('pen', isOn);
  if (isOn) {
    // a floor that moves under the pen can't be drawn on
    stage.play(false);
    pitch = stage.state.pitch;
    stage.state.pitch = Math.max(pitch, PITCH);
  } else {
    stage.state.pitch = pitch;
  }
  stage.state.dirty = true;
  changed();
}

// Points on the curve through those of a path, as it is danced: four for each.
/** @param {Point[]} points @returns {Point[]} */
function curved(points) {
  const of = (/** @type {number} */ i) => points[Math.min(points.length - 1, Math.max(0, i))];
  return points.flatMap((b, i) => {
    const [a, c, d] = [of(i - 1), of(i + 1), of(i + 2)];
    return [0, 0.25, 0.5, 0.75].map(u => {
      const on = (/** @type {0 | 1} */ k) =>
        b[k] + (u * (c[k] - a[k] + u * (2 * a[k] - 5 * b[k] + 4 * c[k] - d[k] + u * (3 * (b[k] - c[k]) + d[k] - a[k])))) / 2;
      return /** @type {Point} */ ([on(0), on(1)]);
    });
  });
}

// The line over the stage: what is drawn, else the path of each dancer who goes along one.
function show() {
  const scene = theScene();
  if (!scene) return;
  const { view } = stage.seen,
    { clientWidth: width, clientHeight: height } = scene.canvas;
  const line = (/** @type {Point[]} */ points, /** @type {string} */ colour) => {
    const parts = [];
    let begins = true;
    for (const [x, z] of curved(points)) {
      const w = view[3] * x + view[11] * z + view[15];
      if (w <= 0.05) {
        begins = true; // behind the camera
        continue;
      }
      const on = (/** @type {number} */ i) => (view[i] * x + view[8 + i] * z + view[12 + i]) / w;
      parts.push(`${begins ? 'M' : 'L'}${((0.5 + 0.5 * on(0)) * width).toFixed(1)} ${((0.5 - 0.5 * on(1)) * height).toFixed(1)}`);
      begins = false;
    }
    const path = document.createElementNS('http://www.w3.org/2000/svg', 'path');
    path.setAttribute('d', parts.join(''));
    path.style.setProperty('stroke', colour);
    return path;
  };
  const danced = (isOn ? [] : dancersOnStage()).flatMap(dancer => {
    const job = store.state.dances.find(dance => dance.id === dancer.id)?.job;
    const rows = store.state.jobs.find(one => one.id === job)?.make.path;
    const moved = rows?.map(([, x, z]) => /** @type {Point} */ ([x + dancer.shift[0], z + dancer.shift[1]]));
    return moved ? [line(moved, `var(${dancer.paint})`)] : [];
  });
  const own = drawn.points.length && !danced.length ? [line(drawn.points, 'var(--select)')] : [];
  sheet.replaceChildren(...danced, ...own);
}

// The field of the form.
export function pathField() {
  const along = lengths(drawn.points),
    metres = along[along.length - 1];
  const pen = h(
    'button',
    { type: 'button', id: 'pen', class: 'chip', 'aria-pressed': isOn, onclick: () => turn(!isOn) },
    icon('brush'),
    isOn ? 'Draw on the floor…' : drawn.points.length ? 'Draw anew' : 'Draw',
  );
  const fast = h('input', {
    type: 'number',
    id: 'field-speed',
    'aria-label': 'Metres a second',
    value: drawn.speed,
    min: 0.1,
    max: 4,
    step: 0.1,
  });
  fast.addEventListener('change', () => {
    drawn.speed = fast.value;
    drawn.speed = String(speed());
    changed();
  });
  const clear = h(
    'button',
    {
      type: 'button',
      class: 'chip',
      onclick: () => {
        takePath(undefined);
        changed();
      },
    },
    'None',
  );
  const said = drawn.points.length
    ? `${metres.toFixed(1)} m in ${(metres / speed()).toFixed(1)} s: as long as the dance is.`
    : 'Draw a line on the stage’s floor, and the dance goes along it.';
  return h(
    'div',
    { class: 'field path', role: 'group', 'aria-label': 'Path' },
    h('span', null, 'Path'),
    h('p', { class: 'chips' }, pen, ...(drawn.points.length ? [clear, fast, h('span', null, 'm/s')] : [])),
    h('small', null, said),
  );
}

/** @param {() => void} redraw of the form */
export function openPen(redraw) {
  changed = redraw;
  sheet = /** @type {SVGSVGElement} */ (/** @type {unknown} */ (find('floor-path')));
  const canvas = /** @type {HTMLCanvasElement} */ (find('stage'));
  /** @type {Point[]} */
  let stroke = [];
  /** @type {number | null} */
  let pointer = null;
  // before the stage's own listeners, which would orbit; with another button than the first they still do
  const first = { capture: true };
  canvas.addEventListener(
    'pointerdown',
    e => {
      if (!isOn || e.button !== 0 || pointer !== null) return;
      e.stopImmediatePropagation();
      const at = floorAt(e.offsetX, e.offsetY, canvas);
      if (!at) return;
      [pointer, stroke] = [e.pointerId, [at]];
      // dancers of whom frames still come would move the floor below the pen
      stage.held = true;
      try {
        canvas.setPointerCapture(e.pointerId);
      } catch {
        // a pointer that is gone already
      }
    },
    first,
  );
  canvas.addEventListener(
    'pointermove',
    e => {
      if (e.pointerId !== pointer) return;
      e.stopImmediatePropagation();
      const at = floorAt(e.offsetX, e.offsetY, canvas),
        last = stroke[stroke.length - 1];
      if (!at || Math.hypot(at[0] - last[0], at[1] - last[1]) < STROKE_M) return;
      stroke.push(at);
      drawn.points = stroke;
      stage.state.dirty = true;
    },
    first,
  );
  /** @param {PointerEvent} e */
  const up = e => {
    if (e.pointerId !== pointer) return;
    e.stopImmediatePropagation();
    pointer = null;
    stage.held = false;
    drawn.points = steadied(stroke);
    turn(false);
  };
  canvas.addEventListener('pointerup', up, first);
  canvas.addEventListener('pointercancel', up, first);
  document.addEventListener('keydown', e => {
    if (isOn && e.key === 'Escape') turn(false);
  });
  onFrame(show);
  on(['cast', 'jobs'], () => {
    stage.state.dirty = true;
  });
}
