// What is to be made, and how: a sentence of help for each choice.

import { post } from './api.js';
import { find, h, icon, iconButton } from './dom.js';
import { capital, joints as said, rate } from './format.js';
import { PARTS } from './groups.js';
import { keptDances, motionClips, nameOf, on, store, tell, ui } from './store.js';
import { drawn, openPen, pathField, pathRows, takePath } from './pen.js';
import { attempt } from './toast.js';
import { clipIdOf } from './cast.js';

/** @typedef {import('./types.js').Make} Make @typedef {import('./types.js').Kind} Kind */

/** @type {Record<string, { name: string, help: string }>} */
const KINDS = {
  timeline: {
    name: 'What the timeline leaves free',
    help: 'The orange parts of the timeline are made; all else stays as it is.',
  },
  free: { name: 'A new dance', help: '' },
  given: {
    name: 'A dance that follows a clip',
    help: 'The chosen joints move as in the clip from beginning to end; all others are made.',
  },
  loop: { name: 'A loop of a clip', help: 'The last seconds are made anew so that the end leads into the beginning.' },
};

/** @type {Record<string, string>} */
const HELP = {
  clip: 'The clip or kept dance that it is made of.',
  rig: 'Whose skeleton it is on, at whose frame rate. Without a clip it is SMPL’s body.',
  fps: 'Frames a second. Auto is the clip’s own rate.',
  joints: 'These come from the clip. Press a limb on the stage, or choose here.',
  seconds: 'How long the dance is, in seconds.',
  loop: 'Whether the dancer comes back to the same spot, or goes on across the floor as in a walk.',
  loop_over: 'How many seconds at the end are made anew. More time, a softer way back.',
  variations: 'How many dances are made side by side, to choose from.',
  seed: 'The number that decides: the same seed gives the same dance. Empty: another one each time.',
  temperature: 'How daring the choices are. 1 is as learned; lower is calmer, higher is wilder.',
  top_p: 'Leaves out what is unlikely. 0.8 is safe, 1 leaves nothing out.',
  guidance: 'How strongly labels count. Left empty it is 2; 1 is as learned, in half the time.',
  feet: 'Lock holds feet still while they stand on the floor. Off leaves them as they are made.',
  best: 'Makes this many and shows the best of them, with a score: 0 is as good as real dances, more is worse.',
};

const PRESETS = [2, 4, 6, 8],
  RATES = [24, 25, 30, 50, 60, 90, 100, 120, 240];
const SMPL = 'smpl';

/** What is chosen; empty fields are left to the studio. */
export const choice = {
  kind: /** @type {Kind} */ ('free'),
  clip: /** @type {string | null} */ (null),
  rig: /** @type {string | null} */ (null),
  joints: new Set(['root', 'spine']),
  variations: 4,
  labels: /** @type {Record<string, string>} */ ({}),
  loop: /** @type {'back' | 'pose'} */ ('back'),
  numbers: /** @type {Record<string, string>} */ ({
    seconds: '8',
    fps: '',
    loop_over: '2',
    seed: '',
    temperature: '',
    top_p: '',
    guidance: '',
    best: '',
  }),
  feet: /** @type {'' | 'lock' | 'off'} */ (''),
};
let chosenByHand = false;

export const hasFree = () => store.timeline.rows.some(row => row.spans.some(span => span.state !== 'given'));

// The clip that is made of: the chosen one, else the one at hand.
function theClip() {
  const all = [...motionClips(), ...keptDances()],
    has = (/** @type {string | null | undefined} */ id) => all.some(one => one.id === id);
  if (has(choice.clip)) return choice.clip;
  const rig = store.timeline.segments.find(segment => segment.clip),
    own = rig ? clipIdOf(rig) : null;
  // a dance that was kept just now is the one to go on with
  return [ui.mode === 'clip' ? ui.clip : ui.focus, own, all[0]?.id].find(has) ?? null;
}

// Those on whose rig something can be made.
const rigs = () => [...motionClips().filter(clip => clip.rig), ...keptDances()];

// The clip whose rig a new dance is on: the chosen one, else the one at hand; none for SMPL's body.
function theRig() {
  if (choice.rig === SMPL) return null;
  const has = (/** @type {string | null} */ id) => rigs().some(one => one.id === id);
  return [choice.rig, theClip()].find(has) ?? null;
}

/** @returns {Make} */
export function request() {
  const { kind, numbers } = choice,
    make = /** @type {Make} */ ({ kind, variations: choice.variations });
  const number = (/** @type {string} */ name) =>
    numbers[name] === '' || !Number.isFinite(Number(numbers[name])) ? undefined : Number(numbers[name]);
  if (kind === 'given' || kind === 'loop') make.clip = theClip() ?? undefined;
  if (kind === 'free') make.clip = theRig() ?? undefined;
  if (kind === 'free' || kind === 'given') make.fps = number('fps');
  if (kind === 'given') make.joints = [...choice.joints].join(',');
  // along a path it is as long as that
  if (kind === 'free') make.path = pathRows();
  if (kind === 'free' && !make.path) make.seconds = number('seconds') ?? 8;
  if (kind === 'loop') Object.assign(make, { loop: choice.loop, loop_over: number('loop_over') });
  const labels = Object.entries(choice.labels).filter(([, value]) => value);
  if (labels.length && kind !== 'timeline') make.labels = Object.fromEntries(labels);
  for (const name of /** @type {const} */ (['seed', 'temperature', 'top_p', 'guidance', 'best'])) {
    const value = number(name);
    if (value !== undefined) make[name] = value;
  }
  if (choice.feet) make.feet = choice.feet;
  return make;
}

export async function makeNow() {
  const make = request();
  const answer = await attempt(() => post('/api/make', make));
  if (!answer) return;
  // Enter is to keep what is chosen now, not to make again
  if (document.activeElement instanceof HTMLElement && document.activeElement.closest('form'))
    document.activeElement.blur();
  Object.assign(ui, { set: answer.job, focus: null, solo: false, versus: [], mode: 'takes' });
  tell('cast', 'jobs');
}

// Dances from nothing on a character, with these labels; the form then says how they are made.
/** @param {string} id of its clip @param {Record<string, string>} labels */
export function makeOn(id, labels) {
  Object.assign(choice, { kind: 'free', rig: id, labels });
  takePath(undefined);
  chosenByHand = true;
  draw();
  return makeNow();
}

// How many dances that will be, and how long.
export const howMany = () =>
  `${choice.numbers.seconds || 8} s${choice.variations > 1 ? `, ${choice.variations} variations` : ''}`;

// These settings again.
/** @param {Make} make */
export function takeOver(make) {
  choice.kind = make.kind === 'edit' ? 'timeline' : make.kind;
  if (make.kind === 'free') choice.rig = make.clip ?? SMPL;
  else if (make.clip) choice.clip = make.clip;
  if (make.joints) choice.joints = new Set(make.joints.split(','));
  takePath(make.path);
  choice.variations = make.variations;
  choice.labels = { ...make.labels };
  choice.loop = make.loop ?? 'back';
  choice.feet = make.feet ?? '';
  for (const name of Object.keys(choice.numbers)) {
    const value = /** @type {any} */ (make)[name];
    choice.numbers[name] = value === undefined || value === null ? '' : String(value);
  }
  chosenByHand = true;
  draw();
}

// ---- fields ----
/** @param {string} name @param {string} label @param {Node} control */
function field(name, label, control) {
  const help = h('small', { id: `help-${name}` }, HELP[name]);
  if (control instanceof HTMLElement) control.setAttribute('aria-describedby', help.id);
  return h('label', { class: `field ${name}` }, h('span', null, label), control, help);
}

/** @param {string} name @param {string} label @param {{ min: number, max: number, step: number, placeholder?: string }} limits */
function numberField(name, label, { min, max, step, placeholder }) {
  const input = h('input', {
    type: 'number',
    id: `field-${name}`,
    value: choice.numbers[name],
    min,
    max,
    step,
    placeholder: placeholder ?? 'auto',
  });
  input.addEventListener('input', () => {
    choice.numbers[name] = input.value;
  });
  if (name !== 'seed') return field(name, label, input);
  const dice = iconButton('dice', 'Another seed', () => {
    input.value = choice.numbers.seed = String(Math.floor(Math.random() * 1e6));
  });
  const box = field(name, label, input);
  box.insertBefore(dice, box.lastChild);
  return box;
}

/** @param {string} value @param {[string, string][]} options @param {(value: string) => void} set @param {string} [label] */
function select(value, options, set, label) {
  const box = h(
    'select',
    label ? { 'aria-label': label } : null,
    ...options.map(([of, text]) => h('option', { value: of, selected: of === value }, text)),
  );
  box.addEventListener('change', () => set(box.value));
  return box;
}

function jointField() {
  const chips = PARTS.map(part =>
    h(
      'button',
      {
        type: 'button',
        class: 'chip',
        'aria-pressed': choice.joints.has(part),
        onclick: () => {
          if (!choice.joints.delete(part)) choice.joints.add(part);
          draw();
        },
      },
      said(part),
    ),
  );
  return h(
    'div',
    { class: 'field joints', role: 'group', 'aria-label': 'Joints from the clip' },
    h('span', null, 'From the clip'),
    h('p', { class: 'chips' }, ...chips),
    h('small', null, HELP.joints),
  );
}

function fields() {
  const { kind } = choice,
    all = [...motionClips(), ...keptDances()],
    parts = [];
  if (kind === 'given' || kind === 'loop') {
    const options = /** @type {[string, string][]} */ (all.map(one => [one.id, one.name]));
    parts.push(
      field(
        'clip',
        'Clip',
        select(theClip() ?? '', options.length ? options : [['', 'none yet']], value => {
          choice.clip = value;
        }),
      ),
    );
  }
  if (kind === 'given') parts.push(jointField());
  if (kind === 'free') {
    const options = /** @type {[string, string][]} */ (rigs().map(one => [one.id, one.name]));
    const control = select(theRig() ?? SMPL, [...options, [SMPL, 'SMPL’s body']], value => {
      choice.rig = value;
      draw();
    });
    control.id = 'field-rig';
    parts.push(field('rig', 'Rig', control));
    if (!drawn.points.length) parts.push(numberField('seconds', 'Seconds', { min: 1, max: 600, step: 1 }));
    if (store.state.model.paths) parts.push(pathField());
  }
  if (kind === 'loop') {
    const back = /** @type {[string, string][]} */ ([
      ['back', 'to the same spot'],
      ['pose', 'to the same pose, further on'],
    ]);
    parts.push(
      field(
        'loop',
        'Comes back',
        select(choice.loop, back, value => {
          choice.loop = value === 'pose' ? 'pose' : 'back';
        }),
      ),
      numberField('loop_over', 'Seconds anew', { min: 0.5, max: 60, step: 0.5 }),
    );
  }
  if (kind !== 'timeline') {
    for (const [name, values] of Object.entries(store.state.model.labels)) {
      const options = /** @type {[string, string][]} */ ([['', 'any'], ...values.map(value => [value, value])]);
      const control = select(choice.labels[name] ?? '', options, value => {
        choice.labels[name] = value;
      });
      parts.push(
        h(
          'label',
          { class: 'field' },
          h('span', null, capital(name)),
          control,
          h('small', null, `What kind of ${name} the dance is.`),
        ),
      );
    }
  }
  return parts;
}

function finer() {
  const feet = /** @type {[string, string][]} */ ([
    ['', 'auto'],
    ['lock', 'lock'],
    ['off', 'off'],
  ]);
  const { kind, numbers } = choice,
    parts = [];
  if (kind === 'free' || kind === 'given') {
    const own = [...motionClips(), ...keptDances()].find(one => one.id === (kind === 'free' ? theRig() : theClip()))?.fps;
    const auto = /** @type {[string, string]} */ (['', `auto (${rate(own ?? store.state.model.new_fps)})`]);
    const rates = RATES.map(fps => /** @type {[string, string]} */ ([String(fps), rate(fps)]));
    const control = select(numbers.fps, [auto, ...rates], value => {
      numbers.fps = value;
    });
    control.id = 'field-fps';
    parts.push(field('fps', 'Frame rate', control));
  }
  return [
    ...parts,
    numberField('seed', 'Seed', { min: 0, max: 4294967295, step: 1, placeholder: 'any' }),
    numberField('temperature', 'Temperature', { min: 0.1, max: 3, step: 0.05, placeholder: '1' }),
    numberField('top_p', 'Top-p', { min: 0.05, max: 1, step: 0.05 }),
    numberField('guidance', 'Guidance', { min: 0, max: 10, step: 0.5 }),
    field(
      'feet',
      'Feet',
      select(choice.feet, feet, value => {
        choice.feet = value === 'lock' || value === 'off' ? value : '';
      }),
    ),
    numberField('best', 'Best of', { min: Math.max(2, choice.variations), max: 16, step: 1, placeholder: 'no choice' }),
  ];
}

/** @type {HTMLElement} */
let form;
let finerIsOpen = false;

export function draw() {
  const kind = select(
    choice.kind,
    Object.entries(KINDS).map(([of, { name }]) => [of, name]),
    value => {
      choice.kind = /** @type {Kind} */ (value);
      chosenByHand = true;
      draw();
    },
    'What to make',
  );
  kind.id = 'make-kind';
  const count = h(
    'span',
    { class: 'segments', role: 'group', 'aria-label': 'Variations' },
    ...[1, ...PRESETS].map(n =>
      h(
        'button',
        {
          type: 'button',
          'aria-pressed': choice.variations === n,
          onclick: () => {
            choice.variations = n;
            draw();
          },
        },
        n,
      ),
    ),
  );
  const blocked =
    choice.kind === 'timeline'
      ? !store.timeline.segments.length || !hasFree()
      : (choice.kind === 'given' || choice.kind === 'loop') && !theClip();
  const rig = theRig(),
    free = `A dance from nothing, on ${rig ? `the rig of ${nameOf(rig)}` : 'SMPL’s body'}.`;
  const why = !blocked
    ? KINDS[choice.kind].help || free
    : choice.kind === 'timeline'
      ? 'Nothing is free yet: paint over the timeline’s rows with “Make anew”.'
      : 'Add a clip, or keep a dance first.';
  const more = h(
    'details',
    { class: 'finer', open: finerIsOpen },
    h('summary', null, 'Finer settings'),
    h('div', { class: 'fields' }, ...finer()),
  );
  more.addEventListener('toggle', () => {
    finerIsOpen = more.open;
  });
  const focus = document.activeElement?.id;
  form.replaceChildren(
    h('label', { class: 'kind' }, kind),
    h('p', { class: 'quiet' }, why),
    h(
      'div',
      { class: 'fields' },
      ...fields(),
      h('div', { class: 'field' }, h('span', null, 'Variations'), count, h('small', null, HELP.variations)),
    ),
    more,
    h(
      'button',
      { type: 'submit', class: 'strong', id: 'make-now', disabled: blocked, title: 'Make (Ctrl Enter)' },
      icon('play'),
      choice.variations > 1 ? `Make ${choice.variations} variations` : 'Make',
    ),
  );
  if (focus) document.getElementById(focus)?.focus();
}

export function openForm() {
  form = find('make-form');
  form.addEventListener('submit', e => {
    e.preventDefault();
    makeNow();
  });
  openPen(draw);
  let had = false;
  on(['timeline'], () => {
    // painting something free is a wish to have it made
    if (hasFree() && !had && (!chosenByHand || choice.kind !== 'timeline')) choice.kind = 'timeline';
    else if (!hasFree() && choice.kind === 'timeline')
      choice.kind = store.timeline.segments.length ? 'timeline' : 'free';
    had = hasFree();
    draw();
  });
  on(['clips', 'dances', 'model'], () => {
    if (!form.contains(document.activeElement) || document.activeElement === document.body) draw();
  });
  draw();
}
