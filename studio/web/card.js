// A card of the library: a small moving figure, what is known of the file, its doubts with their buttons.

import { edit, post } from './api.js';
import { strip } from './brush.js';
import { focusOn, showClip } from './cast.js';
import { compareWith } from './compare.js';
import { h, icon, iconButton } from './dom.js';
import { draggable } from './drag.js';
import { loadSmall } from './figures.js';
import { capital, counted, length, rate } from './format.js';
import { setTimeline } from './live.js';
import { howMany, makeOn } from './make-form.js';
import { menu } from './menu.js';
import { setMusic } from './music.js';
import { openReading, state, stated } from './reading.js';
import { Small } from './small.js';
import { stage } from './stage-view.js';
import { characterOf, nameOf, seedOf, store, tell, ui } from './store.js';
import { attempt, toast } from './toast.js';

/** @typedef {import('./types.js').Clip} Clip @typedef {import('./types.js').Dance} Dance */

/** @type {Promise<unknown>} */
let before = Promise.resolve();

// One after the other: the studio refuses an edit of a timeline that is being edited.
/** @param {...import('./types.js').Edit} edits */
export async function change(...edits) {
  const now = before.then(() => attempt(() => edit(...edits)));
  before = now;
  const timeline = await now;
  if (timeline) setTimeline(timeline);
  return timeline;
}

// A timeline of this clip alone; the one before comes back by undo.
/** @param {string} id */
export async function workOn(id) {
  const edits = store.timeline.segments.length
    ? [
        { op: 'text', text: '' },
        { op: 'use_clip', id },
      ]
    : [{ op: 'use_clip', id }];
  if (await change(...edits)) {
    Object.assign(ui, { mode: 'timeline', segment: null, range: null });
    tell('cast', 'selection');
  }
}

// The whole of a clip behind a moment of the timeline.
/** @param {string} id @param {number} seconds @param {number} from */
export async function putAt(id, seconds, from) {
  if (!store.timeline.segments.length) return workOn(id);
  const timeline = await change({ op: 'give', clip: id, joints: 'all', from, to: from + seconds, at: 0 });
  if (timeline) Object.assign(ui, { mode: 'timeline' });
  tell('cast');
}

/** @param {Dance} dance */
export function exportItems(dance) {
  const to = (/** @type {string} */ format) => `/api/dances/${dance.id}/export?format=${format}`,
    on = characterOf(dance.id);
  return [
    { label: 'Export BVH', hint: `on ${dance.source || dance.rig ? 'the clip’s own' : 'SMPL’s'} rig`, href: to('bvh'), does() {} },
    { label: 'Export for Blender', hint: 'a BVH in metres', href: to('bvh&for=blender'), does() {} },
    {
      label: 'Export GLB',
      hint: on ? `${nameOf(on)} itself, with this dance` : 'for Blender, Unity, the web',
      href: to('glb'),
      does() {},
    },
    { label: 'Export VRMA', hint: 'for VRM avatars', href: to('vrma'), does() {} },
    { label: 'Export npz', hint: 'AMASS, for research', href: to('npz'), does() {} },
  ];
}

/** @param {string} id @param {string} name */
export async function rename(id, name) {
  const dialog = h('dialog', { class: 'ask', 'aria-label': 'Rename' });
  const input = h('input', { type: 'text', value: name, 'aria-label': 'Name', maxlength: 80 });
  input.addEventListener('keydown', e => {
    if (e.key === 'Enter') {
      e.preventDefault();
      dialog.close('ok');
    }
  });
  dialog.append(
    h('label', null, 'Name', input),
    h(
      'div',
      { class: 'row end' },
      h('button', { type: 'button', class: 'quiet', onclick: () => dialog.close() }, 'Cancel'),
      h('button', { type: 'button', class: 'strong', onclick: () => dialog.close('ok') }, 'Rename'),
    ),
  );
  document.body.append(dialog);
  dialog.addEventListener('close', () => {
    dialog.remove();
    if (dialog.returnValue === 'ok' && input.value.trim())
      attempt(() => post(`/api/clips/${id}/rename`, { name: input.value.trim() }));
  });
  dialog.showModal();
  input.select();
}

// What a character can be made to dance: a line for each value of the model's first label.
/** @param {Clip} clip @returns {import('./menu.js').Item[]} */
function danceItems(clip) {
  if (!clip.character || !clip.rig) return [];
  const [name, values] = Object.entries(store.state.model.labels)[0] ?? ['', []];
  const item = (/** @type {string} */ what, /** @type {Record<string, string>} */ labels) => ({
    label: `${what} on this character`,
    hint: howMany(),
    does: () => makeOn(clip.id, labels),
  });
  return [...(values.length ? values.map(value => item(capital(value), { [name]: value })) : [item('A dance', {})]), null];
}

/** @param {Clip} clip @param {{ mirror?: boolean, speed?: number }} change */
async function derive(clip, change) {
  const made = await attempt(() => post(`/api/clips/${clip.id}/derive`, change));
  if (made) toast(`${nameOf(made.id)} is in the library.`);
}

/** @param {Clip} clip */
function retime(clip) {
  const input = h('input', { type: 'number', value: 1.5, min: 0.5, max: 2, step: 0.05 });
  const close = (/** @type {string} */ how) => () => dialog.close(how);
  const dialog = h(
    'dialog',
    { class: 'ask', 'aria-label': 'Retime' },
    h('label', null, 'Speed, 0.5 to 2 times its own', input),
    h(
      'div',
      { class: 'row end' },
      h('button', { type: 'button', class: 'quiet', onclick: close('') }, 'Cancel'),
      h('button', { type: 'button', class: 'strong', onclick: close('ok') }, 'Make the clip'),
    ),
  );
  input.addEventListener('keydown', e => {
    if (e.key !== 'Enter') return;
    e.preventDefault();
    dialog.close('ok');
  });
  dialog.addEventListener('close', () => {
    dialog.remove();
    if (dialog.returnValue === 'ok') derive(clip, { speed: Number(input.value) });
  });
  document.body.append(dialog);
  dialog.showModal();
  input.select();
}

/** @param {Clip} clip */
function facts(clip) {
  if (clip.state === 'reading') return 'being read';
  if (clip.state === 'failed') return 'can’t be read';
  const rig = clip.rig ? clip.rig.toUpperCase() : 'unknown rig';
  return clip.music
    ? [length(clip.seconds ?? 0), counted(clip.beats?.length ?? 0, 'beat')].join(' · ')
    : [length(clip.seconds ?? 0), rate(clip.fps ?? 0), rig].join(' · ');
}

/** @param {Clip} clip */
function doubts(clip) {
  const all = clip.doubts.map(doubt =>
    h(
      'li',
      null,
      icon('warn'),
      h('span', null, doubt.text),
      doubt.fix &&
        h(
          'button',
          {
            type: 'button',
            class: 'fix',
            onclick: () => state(clip, doubt.fix?.body ?? {}),
          },
          doubt.fix.label,
        ),
    ),
  );
  if (clip.error) all.unshift(h('li', null, icon('warn'), h('span', null, clip.error)));
  return all.length ? h('ul', { class: 'doubts', 'aria-label': 'Doubts' }, ...all) : null;
}

/** @param {Clip} clip */
export function clipCard(clip) {
  const ready = clip.state === 'ready',
    motion = ready && !clip.music,
    moves = (clip.frames ?? 0) > 1,
    said = stated(clip.reading),
    small = motion ? new Small(`${clip.name}, dancing`) : null;
  const open = motion ? () => showClip(clip.id) : clip.music ? () => setMusic(clip.id) : null;
  const more = iconButton(
    'more',
    `More for ${clip.name}`,
    () =>
      menu(more, [
        ...(motion ? danceItems(clip) : []),
        ...(motion
          ? [
              { label: 'Work on this', hint: 'a timeline of it alone', does: () => workOn(clip.id) },
              {
                label: 'Put on the timeline',
                hint: 'at the playhead',
                does: () => putAt(clip.id, clip.seconds ?? 0, stage.state.time),
              },
              { label: 'Show on the stage', does: () => showClip(clip.id) },
              { label: 'Compare a student with this', hint: 'lag, tempo, where they differ', does: () => compareWith(clip.id, clip.name) },
              ...(clip.rig && moves
                ? [{ label: 'Mirror', hint: 'left for right, as a new clip', does: () => derive(clip, { mirror: true }) }]
                : []),
              ...(moves ? [{ label: 'Retime', hint: 'at half to twice its speed, as a new clip', does: () => retime(clip) }] : []),
            ]
          : []),
        ...(clip.music
          ? [
              store.state.music?.clip === clip.id
                ? { label: 'Dance without music', does: () => setMusic(null) }
                : { label: 'Dance to this', does: () => setMusic(clip.id) },
              { label: 'Begin at the playhead', does: () => setMusic(clip.id, -stage.state.time) },
            ]
          : []),
        ...(clip.music
          ? []
          : [{ label: 'How it is read', hint: 'rate, unit, floor, map …', does: () => openReading(clip.id) }]),
        null,
        { label: 'Rename', does: () => rename(clip.id, clip.name) },
        {
          label: 'Remove',
          hint: 'the file stays where it is',
          does: () => attempt(() => post(`/api/clips/${clip.id}/remove`)),
        },
      ]),
    { 'aria-haspopup': 'menu' },
  );
  const card = h(
    'li',
    { class: `card ${clip.state}`, 'data-id': clip.id },
    h(
      'span',
      { class: 'picture' },
      small?.canvas ?? icon(clip.music ? 'music' : clip.state === 'failed' ? 'warn' : 'upload'),
    ),
    h(
      'span',
      { class: 'about' },
      h(
        'button',
        { type: 'button', class: 'name', title: clip.name, disabled: !open, onclick: open ?? (() => {}) },
        clip.name,
      ),
      h('small', null, facts(clip)),
      said && h('small', { class: 'stated' }, said),
    ),
    more,
    motion &&
      strip(clip.id, clip.name, clip.seconds ?? 1, time => {
        if (small) small.at = time;
      }),
    doubts(clip),
  );
  if (small)
    loadSmall(clip.id).then(
      loaded => small.show(clip.id, loaded),
      () => {},
    );
  if (motion) draggable(card, () => ({ kind: 'clip', id: clip.id }), '.brush');
  else if (clip.music) draggable(card, () => ({ kind: 'music', id: clip.id }));
  return { card, small };
}

/** @param {Dance} dance */
export function keptCard(dance) {
  const small = new Small(`${dance.name}, dancing`);
  small.paint = '--take-0';
  const more = iconButton(
    'more',
    `More for ${dance.name}`,
    () =>
      menu(more, [
        { label: 'Work on this', hint: 'a timeline of it alone', does: () => workOn(dance.id) },
        {
          label: 'Put on the timeline',
          hint: 'at the playhead',
          does: () => putAt(dance.id, dance.seconds, stage.state.time),
        },
        { label: 'Compare a student with this', hint: 'lag, tempo, where they differ', does: () => compareWith(dance.id, dance.name) },
        ...(store.state.jobs.some(job => job.dances.includes(dance.id))
          ? [{ label: 'Show beside its variations', does: () => focusOn(dance.id) }]
          : []),
        null,
        { label: 'Rename', does: () => rename(dance.id, dance.name) },
        {
          label: 'Remove',
          hint: 'undo brings it back',
          does: async () => {
            if ((await attempt(() => post(`/api/clips/${dance.id}/remove`))) !== undefined)
              toast(`${dance.name} is removed.`);
          },
        },
      ]),
    { 'aria-haspopup': 'menu' },
  );
  const out = h(
    'button',
    {
      type: 'button',
      class: 'export',
      'aria-haspopup': 'menu',
      'aria-label': `Export ${dance.name}`,
      onclick: () => menu(out, exportItems(dance)),
    },
    icon('save'),
    'Export',
  );
  const card = h(
    'li',
    { class: 'card ready', 'data-id': dance.id },
    h('span', { class: 'picture' }, small.canvas),
    h(
      'span',
      { class: 'about' },
      h('button', { type: 'button', class: 'name', title: dance.name, onclick: () => showClip(dance.id) }, dance.name),
      h('small', null, [length(dance.seconds), seedOf(dance)].filter(Boolean).join(' · ')),
      out,
    ),
    more,
  );
  loadSmall(dance.id).then(
    loaded => small.show(dance.id, loaded),
    () => {},
  );
  draggable(card, () => ({ kind: 'clip', id: dance.id }));
  return { card, small };
}
