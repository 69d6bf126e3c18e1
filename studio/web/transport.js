// The bars of the stage: play and its speed below, what is shown above.

import { clipPaint, showMode, staged, takes } from './cast.js';
import { whyCapsules } from './characters.js';
import { find, h, icon, iconButton } from './dom.js';
import { clock } from './format.js';
import { thePlayer } from './music.js';
import { film, isFilming } from './record.js';
import { dancersOnStage, onFrame, stage } from './stage-view.js';
import { characterOf, currentSet, danceOf, nameOf, on, store, ui } from './store.js';
import { wholeTime } from './timeline-view.js';

const SPEEDS = [0.25, 0.5, 0.75, 1, 1.5, 2];
const SHOWN = [0.25, 0.5, 0.75, 1, 1.5, 2].map(
  speed => `${{ 0.25: '¼', 0.5: '½', 0.75: '¾', 1.5: '1½' }[speed] ?? speed}×`,
);

/** @typedef {'loop' | 'follow' | 'overlay' | 'ghost' | 'trails' | 'contacts' | 'inPlace' | 'mesh'} Toggle */

/** @type {Record<Toggle, { name: string, tip: string }>} */
const TOGGLES = {
  overlay: { name: 'Overlay', tip: 'All dancers on one spot (O)' },
  ghost: { name: 'Ghost', tip: 'What a dance was made from, as a ghost (G)' },
  trails: { name: 'Trails', tip: 'The ways of hands and feet (T)' },
  contacts: { name: 'Contacts', tip: 'Feet that stand on the floor (N)' },
  inPlace: { name: 'In place', tip: 'Dance on the spot, without the way across the floor (P)' },
  mesh: { name: 'Mesh', tip: 'Characters with their meshes, or as capsules (B)' },
  follow: { name: 'Follow', tip: 'The camera goes with the dancers (C)' },
  loop: { name: 'Loop', tip: 'Start again at the end (L)' },
};

/** @type {Map<Toggle, HTMLElement>} */
const buttons = new Map();

/** @param {Toggle} name */
export function toggle(name) {
  const { state } = stage;
  state[name] = !state[name];
  if (name === 'inPlace') stage.rooms.clear();
  buttons.get(name)?.setAttribute('aria-pressed', String(state[name]));
  state.dirty = true;
}

export const playOrPause = () => stage.play(!stage.state.playing);

// To the next frame, or the one before, of the first dancer's rate.
/** @param {number} by frames */
export function step(by) {
  const fps = dancersOnStage()[0]?.fps ?? store.state.model.fps;
  stage.play(false);
  stage.seek((Math.round(stage.state.time * fps) + by) / fps);
}

/** @param {number} by */
export function speedBy(by) {
  const select = /** @type {HTMLSelectElement} */ (find('speed'));
  select.selectedIndex = Math.min(SPEEDS.length - 1, Math.max(0, select.selectedIndex + by));
  stage.state.speed = SPEEDS[select.selectedIndex];
}

/** @param {Toggle} name */
function toggleButton(name) {
  const { name: text, tip } = TOGGLES[name];
  const button = h(
    'button',
    { type: 'button', title: tip, 'aria-pressed': stage.state[name], onclick: () => toggle(name) },
    text,
  );
  buttons.set(name, button);
  return button;
}

// What the film of the stage is called.
function filmName() {
  if (ui.mode === 'clip' && ui.clip) return nameOf(ui.clip);
  const one = staged().length === 1 ? danceOf(staged()[0].id) : null;
  return ui.mode === 'timeline' ? 'timeline' : (one?.name ?? 'variations');
}

function modes() {
  const { segments } = store.timeline,
    job = currentSet(),
    box = find('modes');
  const count = job ? takes().length : 0;
  /** @param {'takes' | 'timeline' | 'clip'} mode @param {string} text @param {string} tip */
  const button = (mode, text, tip) =>
    h(
      'button',
      {
        type: 'button',
        'aria-pressed': ui.mode === mode,
        title: tip,
        onclick: () => showMode(mode),
      },
      text,
    );
  const shown = [
    segments.length ? button('timeline', 'Timeline', 'What the timeline gives, before anything is made') : null,
    job ? button('takes', count > 1 ? `Variations ${count}` : 'Made', 'What was made') : null,
    ui.clip ? button('clip', nameOf(ui.clip), 'A clip of the library') : null,
  ].filter(one => one !== null);
  box.replaceChildren(...shown);
  box.hidden = shown.length < 2;
}

// What the colours mean.
function legend() {
  const box = find('legend'),
    all = dancersOnStage();
  const isPartly = all.some(d => d.made),
    hasGhost = all.some(d => d.original) && stage.state.ghost;
  const key = (/** @type {string} */ paint, /** @type {string} */ text) =>
    h('span', null, h('i', { style: { background: `var(${paint})` } }), text);
  const parts = [];
  if (isPartly) parts.push(key('--body', 'given'), h('span', null, h('i', { class: 'made' }), 'made'));
  if (hasGhost) parts.push(key('--ghost', 'original'));
  if (ui.mode === 'timeline')
    for (const [name, { clip }] of Object.entries(store.timeline.clips)) {
      if (store.timeline.segments.some(segment => segment.clip === name))
        parts.push(key(clipPaint(name), clip ? nameOf(clip) : name));
    }
  box.replaceChildren(...parts);
  box.hidden = parts.length === 0;
}

export function openTransport() {
  find('view-bar').append(
    h('span', { id: 'modes', class: 'segments', role: 'group', 'aria-label': 'On the stage' }),
    h('span', { class: 'spring' }),
    h(
      'span',
      { class: 'group', role: 'group', 'aria-label': 'Look' },
      .../** @type {Toggle[]} */ (['overlay', 'ghost', 'trails', 'contacts', 'inPlace', 'mesh', 'follow']).map(toggleButton),
      iconButton('home', 'The camera as it was (F, or double click)', () => stage.resetView()),
    ),
  );
  const play = h(
    'button',
    {
      id: 'play',
      class: 'round',
      type: 'button',
      title: 'Play or pause (space)',
      'aria-label': 'Play or pause',
      onclick: playOrPause,
    },
    icon('play'),
    icon('pause'),
  );
  const speed = h(
    'select',
    { id: 'speed', 'aria-label': 'Speed', title: 'Speed ([ and ])' },
    ...SPEEDS.map((of, i) => h('option', { value: of, selected: of === 1 }, SHOWN[i])),
  );
  speed.addEventListener('change', () => {
    stage.state.speed = Number(speed.value);
  });
  const filming = iconButton('film', 'Film of the stage, as WebM', () => film(filmName(), refilm), {
    id: 'film',
    'aria-pressed': false,
  });
  const refilm = () => {
    filming.setAttribute('aria-pressed', String(isFilming()));
    find('stage-pane').classList.toggle('filming', isFilming());
  };
  find('transport').append(
    play,
    iconButton('back', 'A frame back (←)', () => step(-1)),
    iconButton('on', 'A frame on (→)', () => step(1)),
    h('span', { id: 'clock', 'aria-hidden': 'true' }, h('b', { id: 'now' }, '0:00.0'), h('span', { id: 'whole' })),
    speed,
    toggleButton('loop'),
    h('button', { id: 'sound', type: 'button', 'aria-pressed': true, hidden: true }, h('i', { id: 'pulse' }), 'Sound'),
    filming,
  );
  stage.onPlay = () => document.documentElement.classList.toggle('playing', stage.state.playing);
  stage.onPlay();
  const now = find('now'),
    whole = find('whole');
  onFrame(time => {
    now.textContent = clock(time);
    whole.textContent = ` / ${clock(wholeTime())}`;
  });
  on(['cast', 'timeline', 'dances', 'jobs', 'clips'], modes);
  on(['cast', 'timeline', 'frames'], legend);
  on(['cast', 'clips', 'dances', 'meshes'], () => {
    const button = buttons.get('mesh');
    if (!button) return;
    const dressed = dancersOnStage().filter(({ id }) => characterOf(id));
    const fault = dressed.every(({ character }) => !character) && dressed.map(({ id }) => whyCapsules(id)).find(Boolean);
    button.hidden = dressed.length === 0;
    button.toggleAttribute('disabled', Boolean(fault));
    button.title = fault ? `Capsules stand for the mesh: ${fault}` : TOGGLES.mesh.tip;
  });
}

export const mute = () => {
  const player = thePlayer();
  if (player) player.mute(!player.muted);
};
