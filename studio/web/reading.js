// How a clip is read: in words, and in a panel that states it, with what becomes of the clip.

import { post } from './api.js';
import { showClip } from './cast.js';
import { find, h, iconButton } from './dom.js';
import { length, mapName, rate } from './format.js';
import { clipOf, on, store } from './store.js';
import { attempt } from './toast.js';

/** @typedef {import('./types.js').Clip} Clip @typedef {import('./types.js').Reading} Reading */

const AXES = ['x', '-x', 'y', '-y', 'z', '-z'],
  UNITS = ['m', 'dm', 'cm', 'mm', 'in', 'ft', 'cmu'];

/**
 * @typedef {{ key: keyof Reading, name: string, help: string, kind: 'number' | 'text' | 'choice', choices?: () => string[],
 *   empty: string, step?: string, label?: (value: string) => string }} Field
 */

/** @type {Field[]} */
const FIELDS = [
  { key: 'fps_source', name: 'Frame rate', kind: 'number', empty: 'as the file says', help: 'Its true rate, where the file says a wrong one.' },
  { key: 'skip', name: 'Begin at frame', kind: 'number', step: '1', empty: 'behind a rest pose', help: 'Frames to leave out at the start.' },
  { key: 'up', name: 'Up', kind: 'choice', empty: 'as it stands', choices: () => AXES, help: 'The axis of the file that points up.' },
  { key: 'unit', name: 'Unit', kind: 'text', empty: 'as its legs tell', choices: () => UNITS, help: 'm, dm, cm, mm, in, ft, cmu, or metres as 0.0725 m.' },
  { key: 'floor', name: 'Floor', kind: 'number', empty: 'where its feet stand', help: 'Its height in metres.' },
  { key: 'map', name: 'Skeleton map', kind: 'choice', empty: 'as it is recognised', choices: () => store.state.maps, label: mapName, help: 'Which joints are which. For one of your own, drop its .toml in the window.' },
  { key: 'mirror_axis', name: 'Mirrored along', kind: 'choice', empty: 'not mirrored', choices: () => ['x', 'y', 'z'], help: 'As an export from a left-handed program is.' },
  { key: 'root', name: 'Root', kind: 'text', empty: 'the body', help: 'One of several figures by its root, or a joint to begin at.' },
  { key: 'take', name: 'Take', kind: 'text', empty: 'the longest', help: 'One of several animations of a GLB or FBX, by its name.' },
];

/** @type {Record<keyof Reading, (value: any) => string>} */
const WORDS = {
  fps_source: fps => `at ${rate(fps)}`,
  skip: frames => `from frame ${frames} on`,
  up: axis => `${axis} up`,
  unit: unit => `in ${unit}`,
  floor: metres => `floor at ${Number(metres.toFixed(3))} m`,
  map: map => `map ${mapName(map)}`,
  mirror_axis: axis => `mirrored along ${axis}`,
  root: name => `root ${name}`,
  take: name => `take ${name}`,
};

// What is stated of a clip, on its card or in the timeline's text.
/** @param {Reading | undefined} reading */
export function stated(reading) {
  const all = FIELDS.filter(({ key }) => reading?.[key] !== undefined).map(({ key }) => WORDS[key](reading?.[key]));
  return all.length ? `Read ${all.join(', ')}` : '';
}

// States something more of a clip.
/** @param {Clip} clip @param {Reading} more */
export const state = (clip, more) => attempt(() => post(`/api/clips/${clip.id}/reading`, { ...clip.reading, ...more }));

/** @param {Clip | undefined} clip @returns {Record<string, string>} */
function facts(clip) {
  if (clip?.state !== 'ready') return {};
  return {
    Length: length(clip.seconds ?? 0),
    Rate: rate(clip.fps ?? 0),
    Frames: String(clip.frames ?? 0),
    Rig: clip.rig ?? 'unknown',
    Joints: String(clip.joints ?? 0),
    Floor: `${(clip.floor ?? 0).toFixed(2)} m`,
    Doubts: String(clip.doubts.length),
  };
}

/** @param {Field} field @param {Clip} clip @param {(value: string) => void} says */
function control({ key, name, help, kind, empty, choices, step, label }, clip, says) {
  const value = clip.reading?.[key] === undefined ? '' : String(clip.reading[key]),
    all = [...new Set([...(choices?.() ?? []), ...(value && kind === 'choice' ? [value] : [])])];
  const input =
    kind === 'choice'
      ? h(
          'select',
          { name: key },
          h('option', { value: '' }, empty),
          ...all.map(of => h('option', { value: of, selected: of === value }, label?.(of) ?? of)),
        )
      : h('input', { type: kind, name: key, value, placeholder: empty, step: step ?? 'any', list: choices ? `all-${key}` : null });
  input.addEventListener('change', () => says(input.value.trim()));
  return h(
    'label',
    { class: 'field' },
    h('span', null, name),
    input,
    choices && kind === 'text' && h('datalist', { id: `all-${key}` }, ...all.map(of => h('option', { value: of }))),
    h('small', null, help),
  );
}

/** @type {(() => void) | null} */
let close = null;
/** @type {(() => void) | null} */
let draw = null;
on(['clips'], () => draw?.());

// The panel: each change is a step of its own, and the stage shows the clip as it is read then.
/** @param {string} id */
export function openReading(id) {
  close?.();
  const first = clipOf(id),
    before = facts(first);
  if (!first) return;
  if (first.state === 'ready') showClip(id);
  const told = h('div', { class: 'told', role: 'status' }),
    fields = h('fieldset'),
    gone = () => {
      panel.remove();
      close = draw = null;
    };
  const panel = h(
    'dialog',
    { class: 'reading', 'aria-label': `How ${first.name} is read` },
    h('header', null, h('h2', null, `How ${first.name} is read`), iconButton('close', 'Close', () => gone())),
    told,
    fields,
  );
  panel.addEventListener('keydown', e => {
    if (e.key === 'Escape') gone();
    e.stopPropagation();
  });
  let last = '';
  const show = () => {
    const clip = clipOf(id);
    if (!clip) return gone();
    fields.disabled = clip.state === 'reading';
    const now = facts(clip),
      lines = Object.entries(now).map(([name, value]) => {
        const was = before[name];
        return [h('dt', null, name), h('dd', null, was && was !== value && h('s', null, was), value)];
      });
    if (clip.state === 'reading') told.setAttribute('aria-busy', 'true');
    else {
      told.removeAttribute('aria-busy');
      told.replaceChildren(clip.error ? h('p', { class: 'failed' }, clip.error) : h('dl', null, ...lines.flat()));
    }
    const key = JSON.stringify([clip.reading, store.state.maps]);
    if (key === last) return;
    last = key;
    const focus = document.activeElement?.getAttribute('name');
    fields.replaceChildren(
      ...FIELDS.map(field =>
        control(field, clip, async value => {
          const { [field.key]: _, ...others } = clip.reading ?? {};
          const said = value === '' ? {} : { [field.key]: field.kind === 'number' ? Number(value) : value };
          fields.disabled = true;
          const done = await attempt(() => post(`/api/clips/${id}/reading`, { ...others, ...said }));
          fields.disabled = false;
          // what was refused isn't so
          if (done === undefined) last = '';
          draw?.();
        }),
      ),
    );
    if (focus) /** @type {HTMLElement | null} */ (fields.querySelector(`[name="${focus}"]`))?.focus();
  };
  find('library').after(panel);
  panel.show();
  close = gone;
  draw = show;
  show();
}
