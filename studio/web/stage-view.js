// The stage's pane: draws the dancers, tells the time, and lets the other panes listen to it.

import { cast, staged } from './cast.js';
import { character } from './characters.js';
import { find, h } from './dom.js';
import { loaded } from './figures.js';
import { clamp } from './figure.js';
import { NAMES, idsOf } from './groups.js';
import { Labels } from './labels.js';
import { arrange } from './layout.js';
import { picked } from './pick.js';
import { listenToPointers } from './pointers.js';
import { Scene } from './scene.js';
import { Skins } from './skins.js';
import { Stage } from './stage.js';
import { currentSet, isBusy, on, store, tell, ui } from './store.js';

/** @typedef {import('./dancer.js').Dancer} Dancer */

export const stage = new Stage();
stage.state.ghost = true;
/** @type {Dancer[]} */
let dancers = [];
/** @type {Scene | null} */
let scene = null;
/** @type {Skins | null} */
let skins = null;
/** @type {Labels | null} */
let labels = null;
/** @type {((time: number) => void)[]} */
const frames = [];
// Milliseconds of script of the last pictures, the latest last.
export const costs = /** @type {number[]} */ ([]);

export const dancersOnStage = () => dancers;
export const theScene = () => scene;

// Calls back after each picture.
/** @param {(time: number) => void} does */
export function onFrame(does) {
  frames.push(does);
}

// ---- colours ----
/** @param {CSSStyleDeclaration} style @param {string} name */
const rgb = (style, name) =>
  [1, 3, 5].map(
    i =>
      parseInt(
        style
          .getPropertyValue(name)
          .trim()
          .slice(i, i + 2),
        16,
      ) / 255,
  );

export function readColours() {
  const style = getComputedStyle(document.documentElement),
    { colours } = stage;
  const names = {
    floor: '--floor',
    line: '--line',
    ink: '--ink',
    given: '--body',
    selected: '--select',
    ring: '--ring',
    sky: '--sky',
  };
  for (const [key, name] of Object.entries(names)) colours[key] = rgb(style, name);
  colours.shadow = parseFloat(style.getPropertyValue('--shadow'));
  for (const dancer of dancers) {
    dancer.colour = rgb(style, dancer.paint);
    if (dancer.original) dancer.original.colour = rgb(style, '--ghost');
  }
  stage.state.dirty = true;
}

// ---- dancers ----
let last = '';
function recast() {
  const before = dancers,
    job = currentSet(),
    shown = ui.mode === 'takes' && job ? job : null;
  dancers = cast();
  // those of before stay until the first frame of the next comes
  if (!dancers.length && isBusy(shown ?? undefined)) dancers = before;
  const key = dancers.map(d => `${d.id} ${d.paint} ${d.title} ${d.note} ${d.original ? 1 : 0}`).join('|');
  const isSame =
    dancers.length === before.length && dancers.every((d, i) => d === before[i] && d.original === before[i].original);
  stage.growing = isBusy(shown ?? undefined) && dancers.some(dancer => dancer.loaded.live);
  // a loop goes on without a rest
  stage.hold_s = shown?.kind === 'loop' || stage.state.upto !== Infinity ? 0 : 0.7;
  if (!isSame || key !== last) {
    last = key;
    place(dancers, before.length !== dancers.length);
    select();
  }
  dress();
  labels?.all.forEach((label, i) => label.classList.toggle('chosen', dancers[i].id === ui.focus && dancers.length > 1));
  empty();
}

/** @param {Dancer[]} all @param {boolean} moved */
function place(all, moved) {
  const whole = Math.max(0, ...all.map(d => d.lasts));
  arrange(all, whole);
  const { time } = stage.state;
  stage.setFigures(all);
  if (time > stage.whole || !all.length) stage.seek(Math.min(time, stage.whole));
  readColours();
  if (labels) {
    labels.make((_, i) => `var(${all[i].paint})`);
  }
  if (moved) stage.state.dirty = true;
}

// Frames came: dancers are longer now. The room for them is measured anew twice a second, not at each.
let measured = 0;
function grown() {
  if (ui.mode === 'takes' && staged().some(({ id }) => loaded(id) && !dancers.some(dancer => dancer.id === id))) recast();
  for (const dancer of dancers) dancer.grow();
  const now = performance.now();
  if (now - measured > 500) {
    measured = now;
    stage.rooms.clear();
    arrangeLive();
  }
  stage.whole = Math.max(0, ...dancers.map(d => d.lasts));
  stage.highest = Math.max(0, ...dancers.map(d => d.top));
  stage.state.dirty = true;
}

function arrangeLive() {
  arrange(dancers, Math.max(0, ...dancers.map(d => d.lasts)));
}

function select() {
  const ids = idsOf([...ui.joints].join(','));
  for (const dancer of dancers) {
    dancer.selected = ids.size
      ? Uint8Array.from(dancer.joints, joint => Number(joint?.smpl !== undefined && ids.has(joint.smpl)))
      : null;
  }
  stage.state.dirty = true;
}

// A click on a limb selects its group, with Ctrl its joint, with Shift more; on the floor nothing.
/** @param {number} x @param {number} y @param {PointerEvent} event */
function clicked(x, y, event) {
  const hit = scene && picked(stage, dancers, x, y, scene.canvas);
  const joint = hit?.dancer.joints[hit.joint];
  if (!event.shiftKey) ui.joints.clear();
  if (hit && joint?.smpl !== undefined) {
    const name = event.ctrlKey || event.metaKey ? NAMES[joint.smpl] : (joint.group ?? NAMES[joint.smpl]);
    if (event.shiftKey && ui.joints.has(name)) ui.joints.delete(name);
    else ui.joints.add(name);
    if (ui.mode === 'takes' && dancers.length > 1) ui.focus = hit.dancer.id;
  }
  tell('selection', 'cast');
}

// In a gap of the timeline the nearest part waits, as a ghost.
/** @param {number} time */
function wait(time) {
  if (ui.mode !== 'timeline' || !dancers.length) return;
  const gap = (/** @type {any} */ d) =>
    d.from === undefined || d.shows(time) ? 0 : Math.min(Math.abs(d.from - time), Math.abs(d.upto - time));
  const nobody = dancers.every(d => !d.shows(time));
  const nearest = nobody ? dancers.reduce((a, b) => (gap(b) < gap(a) ? b : a)) : null;
  for (const dancer of dancers) dancer.faint = dancer === nearest;
}

function empty() {
  const isLoading = !store.ready || store.state.jobs.some(isBusy);
  find('stage-hint').hidden = dancers.length > 0;
  find('stage-hint').textContent = isLoading
    ? 'The first dance is on its way'
    : 'Drop a motion file here, or make a new dance on the right';
}

const soil = () => {
  stage.state.dirty = true;
};

// Who has a character's mesh; all others are capsules, as is one whose frames still come.
function dress() {
  for (const dancer of dancers) dancer.character = dancer.isPart || dancer.loaded.live ? null : character(dancer.id, dress);
  skins?.keep(new Set(dancers.map(dancer => dancer.character)));
  stage.state.dirty = true;
  tell('meshes');
}

/** @param {import('./scene.js').View} camera */
function drawSkins(camera) {
  const { time } = stage.state;
  for (const { isClothed, character, shift, lasts } of dancers) {
    if (!isClothed || !character || !scene) continue;
    // made for the first character: most stages have none
    skins ??= new Skins(scene, soil);
    skins.draw(camera, character, Math.min(time, lasts), shift);
  }
}

// ---- pictures ----
export function draw(plain = false) {
  if (!scene) return null;
  wait(stage.state.time);
  const { time, mesh } = stage.state;
  for (const dancer of dancers) dancer.isClothed = mesh && dancer.character !== null && dancer.shows(time);
  stage.compose(plain);
  const view = stage.camera(scene.canvas.width, scene.canvas.height);
  scene.draw(view, stage.things, stage.colours, plain);
  return view;
}

function show() {
  if (!scene) return;
  scene.resize();
  const view = draw();
  if (view && labels) labels.place(view.view, scene.canvas.clientWidth, scene.canvas.clientHeight);
}

let before = 0;
/** @param {number} stamp */
function tick(stamp) {
  requestAnimationFrame(tick);
  const dt = clamp((stamp - before) / 1000, 0, 0.1),
    begun = performance.now();
  before = stamp;
  stage.advance(dt);
  if (!stage.state.dirty) return;
  stage.state.dirty = false;
  show();
  for (const does of frames) does(stage.state.time);
  costs.push(performance.now() - begun);
  if (costs.length > 600) costs.splice(0, 300);
}

export function openStage() {
  const canvas = /** @type {HTMLCanvasElement} */ (find('stage'));
  try {
    scene = new Scene(canvas, true);
  } catch (error) {
    find('stage-pane').append(
      h('p', { class: 'trouble', role: 'alert' }, `Nothing to see: ${error instanceof Error ? error.message : error}.`),
    );
    return;
  }
  scene.more = drawSkins;
  labels = new Labels(find('labels'), stage);
  labels.top = 48;
  stage.margin = { high: 0.22, low: 0.0 };
  if (matchMedia('(prefers-reduced-motion: reduce)').matches) stage.play(false);
  listenToPointers(canvas, stage, clicked);
  canvas.addEventListener('webglcontextlost', e => e.preventDefault());
  canvas.addEventListener('webglcontextrestored', () => {
    scene?.build();
    skins?.build();
    stage.state.dirty = true;
  });
  new ResizeObserver(() => {
    stage.state.dirty = true;
  }).observe(canvas);
  on(['cast', 'timeline'], recast);
  on(['frames'], grown);
  on(['clips', 'dances'], dress);
  on(['selection'], select);
  recast();
  requestAnimationFrame(tick);
}

// The parts of the body that are selected, as a request lists them; all where none is.
export const selectedJoints = () => (ui.joints.size ? [...ui.joints].join(',') : 'all');
