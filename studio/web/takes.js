// The variations side by side: each dances while it is sampled; keep, reject, compare, go back.

import { post } from './api.js';
import { exportItems, workOn } from './card.js';
import { TAKES, clipIdOf, focusOn, takes } from './cast.js';
import { find, h, icon, iconButton } from './dom.js';
import { load, loaded, loadSmall } from './figures.js';
import { capital, counted, joints } from './format.js';
import { takeOver } from './make-form.js';
import { menu } from './menu.js';
import { Small } from './small.js';
import { onFrame } from './stage-view.js';
import { currentSet, danceOf, isBusy, nameOf, on, sets, sourceOf, store, tell, ui } from './store.js';
import { attempt, toast } from './toast.js';

/** @typedef {import('./types.js').Job} Job */

// ---- choosing ----
/** @param {string | null} id */
export async function keep(id) {
  const dance = danceOf(id);
  if (!dance || dance.kept) return;
  const kept = await attempt(() => post(`/api/dances/${dance.id}/keep`));
  if (kept)
    toast(`Kept as ${kept.kept_name ?? kept.name}.`, { action: { label: 'Work on it', does: () => workOn(dance.id) } });
}

/** @param {string | null} id */
export async function reject(id) {
  const dance = danceOf(id),
    all = takes(),
    at = all.findIndex(take => take.id === id);
  if (!dance || dance.kept) return;
  if ((await attempt(() => post(`/api/dances/${dance.id}/reject`))) === undefined) return;
  const next = all[at + 1] ?? all[at - 1];
  if (ui.focus === id) Object.assign(ui, { focus: next?.id ?? null, solo: ui.solo && Boolean(next) });
  ui.versus = ui.versus.filter(one => one !== id);
  tell('cast');
}

/** @param {string | null} id */
export function compare(id) {
  if (!id) return;
  ui.versus = ui.versus.includes(id) ? ui.versus.filter(one => one !== id) : [...ui.versus, id].slice(-2);
  ui.mode = 'takes';
  tell('cast');
}

// The n-th of the set; the same once more shows it alone, and once more all again.
/** @param {number} n from 1 */
export function choose(n) {
  const take = takes().find(take => take.n === n - 1);
  if (!take) return;
  focusOn(take.id, ui.focus === take.id && !ui.solo);
  focusWanted = true;
}

/** @param {number} by */
export function chooseNext(by) {
  const all = takes(),
    at = all.findIndex(take => take.id === ui.focus);
  const next = at < 0 ? all[by > 0 ? 0 : all.length - 1] : all[Math.min(Math.max(0, at + by), all.length - 1)];
  if (next) focusOn(next.id, ui.solo);
}

// To an earlier or a later set.
/** @param {number} by */
export function goBack(by) {
  const all = sets(),
    at = all.findIndex(job => job.id === currentSet()?.id),
    to = all[at + by];
  if (!to) return;
  Object.assign(ui, { set: to.id, focus: null, solo: false, versus: [], mode: 'takes' });
  tell('cast', 'jobs');
}

export function cancel() {
  const running = store.state.jobs.filter(isBusy);
  for (const job of running) attempt(() => post(`/api/jobs/${job.id}/cancel`));
  return running.length > 0;
}

// ---- what a set is called ----
/** @param {Job} job */
export function title(job) {
  const { make } = job,
    of = make.clip ? nameOf(make.clip) : '';
  if (job.kind === 'free') return 'A new dance';
  if (job.kind === 'given') return `${of}: ${joints(make.joints ?? 'root,torso')} given`;
  if (job.kind === 'loop') return `A loop of ${of}`;
  if (job.kind === 'timeline') return 'The timeline';
  const free = (make.free ?? []).map(span => joints(span.split('@')[0])).join(' and ');
  return `Another ${free} for ${of}`;
}

/** @param {Job} job */
function head(job) {
  const all = sets(),
    at = all.findIndex(one => one.id === job.id),
    running = isBusy(job);
  return h(
    'header',
    null,
    h('h3', { title: title(job) }, capital(title(job))),
    all.length > 1 &&
      h(
        'span',
        { class: 'group pages' },
        iconButton('back', 'The set before (,)', () => goBack(-1), { disabled: at <= 0 }),
        h('small', { 'aria-label': `Set ${at + 1} of ${all.length}` }, `${at + 1}/${all.length}`),
        iconButton('on', 'The set after (.)', () => goBack(1), { disabled: at >= all.length - 1 }),
      ),
    h('small', null, job.make.seed === undefined ? '' : `seed ${job.make.seed}`),
    !running && iconButton('redo', 'Use these settings again', () => takeOver(job.make)),
  );
}

/** @param {Job} job */
function progress(job) {
  const box = h(
    'div',
    { class: 'progress' },
    h('span', { class: 'bar', role: 'progressbar', 'aria-valuemin': 0, 'aria-valuemax': 100 }, h('i', null)),
    h('small', null, ''),
    h(
      'button',
      {
        type: 'button',
        class: 'quiet',
        title: 'Stop at once (Esc)',
        onclick: () => attempt(() => post(`/api/jobs/${job.id}/cancel`)),
      },
      'Cancel',
    ),
  );
  showProgress(box, job);
  return box;
}

// In place: a button that is replaced while it is pressed isn't pressed.
/** @param {Element} box @param {Job} job */
function showProgress(box, job) {
  const waiting = job.state === 'waiting',
    part = job.of ? job.frames / job.of : 0;
  const text = waiting ? 'Waits for the one before' : job.frames >= job.of && job.of ? 'Being written' : 'Being made';
  const bar = /** @type {HTMLElement} */ (box.querySelector('.bar'));
  bar.setAttribute('aria-label', text);
  bar.setAttribute('aria-valuenow', String(Math.round(100 * part)));
  /** @type {HTMLElement} */ (bar.firstElementChild).style.width = `${100 * part}%`;
  /** @type {HTMLElement} */ (box.querySelector('small')).textContent = text;
}

// ---- cards ----
/** @type {Map<string, Small>} */
let smalls = new Map();

/** @param {Job} job @param {{ id: string, n: number }} take */
function card(job, { id, n }) {
  const source =
    sourceOf(job) ?? (job.kind === 'timeline' ? store.timeline.segments.map(clipIdOf).find(Boolean) : null);
  const dance = danceOf(id),
    there = loaded(id),
    name = job.dances.length > 1 ? `Variation ${n + 1}` : (dance?.name ?? 'The dance');
  const small = smalls.get(id) ?? new Small(name),
    chosen = ui.focus === id,
    paint = `--take-${n % TAKES}`;
  smalls.set(id, small);
  small.paint = paint;
  if (there) small.show(id, there, job.make);
  else if (source) {
    // until its first frame comes, what it is made from, faintly
    small.paint = '--line';
    loadSmall(source).then(
      clip => {
        if (!loaded(id)) small.show(id, clip);
      },
      () => {},
    );
  }
  const state = !dance ? (job.state === 'cancelled' ? 'cancelled' : 'being made') : dance.kept ? 'kept' : '';
  const score =
    dance?.score === undefined
      ? null
      : h(
          'span',
          { class: 'score', title: dance.verdict ?? 'The score: 0 is as good as real dances' },
          `score ${dance.score.toFixed(1)}`,
        );
  const versus = iconButton(
    'loop',
    `vs: compare ${name} with another (V)`,
    e => {
      e.stopPropagation();
      compare(id);
    },
    { class: 'icon-button versus', 'aria-pressed': ui.versus.includes(id) },
  );
  versus.replaceChildren('vs');
  const out = dance?.kept
    ? iconButton(
        'save',
        `Export ${name}`,
        e => {
          e.stopPropagation();
          menu(out, exportItems(dance));
        },
        { 'aria-haspopup': 'menu' },
      )
    : h('span');
  const said = `${n + 1}: ${name}${state ? `, ${state}` : ''}${dance?.score === undefined ? '' : `, score ${dance.score.toFixed(1)}`}`;
  const box = h(
    'div',
    {
      class: `take${chosen ? ' chosen' : ''}${dance?.kept ? ' kept' : ''}`,
      role: 'group',
      'aria-label': name,
      'data-id': id,
      style: { '--own': `var(${paint})` },
    },
    h(
      'button',
      {
        type: 'button',
        class: 'choose',
        'aria-pressed': chosen,
        'aria-label': said,
        title: `Choose ${name} (${n + 1}); once more: it alone`,
        onclick: () => focusOn(id, ui.focus === id && !ui.solo),
        // Enter keeps the one that is chosen
        onkeydown: (/** @type {KeyboardEvent} */ e) => {
          if (e.key === 'Enter' && chosen) {
            e.preventDefault();
            keep(id);
          }
        },
      },
      small.canvas,
      h('span', { class: 'number', 'aria-hidden': 'true' }, n + 1),
      score,
    ),
    h(
      'span',
      { class: 'foot' },
      h('small', null, state),
      dance && !dance.kept && job.dances.length > 1 && versus,
      dance &&
        !dance.kept &&
        iconButton('close', `Reject ${name} (X)`, e => {
          e.stopPropagation();
          reject(id);
        }),
      dance &&
        !dance.kept &&
        iconButton(
          'check',
          `Keep ${name} (Enter)`,
          e => {
            e.stopPropagation();
            keep(id);
          },
          { class: 'icon-button keep' },
        ),
      dance?.kept && out,
    ),
  );
  return box;
}

let notesAreOpen = false;

// What there is to say of the chosen dance, else of the first.
/** @param {Job | undefined} job */
function note(job) {
  const own = job?.dances.includes(ui.focus ?? '') ? danceOf(ui.focus) : undefined,
    dance = own ?? job?.dances.map(danceOf).find(dance => dance?.note);
  if (!job || !dance?.note) return null;
  const of = job.dances.length > 1 ? ` on ${job.dances.indexOf(dance.id) + 1}` : '';
  return h(
    'details',
    {
      class: 'notes',
      open: notesAreOpen,
      ontoggle: (/** @type {Event} */ e) => {
        notesAreOpen = /** @type {HTMLDetailsElement} */ (e.currentTarget).open;
      },
    },
    h('summary', null, `Notes${of}`),
    ...dance.note.split('\n').map(line => h('p', null, line)),
  );
}

/** @type {HTMLElement} */
let box;
let last = '';
// the chosen card is to have the focus, so that Enter keeps it
let focusWanted = false;

function draw() {
  const job = currentSet(),
    all = takes(),
    failed = [...store.state.jobs].sort((a, b) => b.started - a.started)[0];
  const running = isBusy(job);
  const key = JSON.stringify([
    job && { ...job, frames: 0, of: 0, since: 0 },
    all.map(({ id }) => [danceOf(id), Boolean(loaded(id))]),
    ui.focus,
    ui.solo,
    ui.versus,
    sets().length,
    failed?.text,
    failed?.state,
  ]);
  if (key === last) {
    // only its progress is new
    const bar = box.querySelector('.progress');
    if (bar && job && running) showProgress(bar, job);
    refresh(job);
    return;
  }
  last = key;
  const hadFocus = focusWanted || box.contains(document.activeElement),
    next = new Map();
  for (const [id, small] of smalls) {
    if (all.some(take => take.id === id)) next.set(id, small);
    else small.remove();
  }
  smalls = next;
  const rejected = job ? job.dances.length - all.length : 0;
  box.replaceChildren(
    ...[
      failed?.state === 'failed' && (!job || failed.started > job.started)
        ? h('p', { class: 'failed', role: 'alert' }, icon('warn'), failed.text ?? 'It could not be made.')
        : null,
      job ? head(job) : h('p', { class: 'quiet' }, 'What you make appears here, frame by frame.'),
      job && running ? progress(job) : null,
      job
        ? h(
            'div',
            { id: 'grid', role: 'group', 'aria-label': 'Variations', 'data-count': all.length },
            ...all.map(take => card(job, take)),
          )
        : null,
      rejected
        ? h('p', { class: 'quiet' }, `${counted(rejected, 'variation')} rejected. Undo brings the last one back.`)
        : null,
      note(job),
    ].filter(part => part !== null),
  );
  focusWanted = false;
  if (hadFocus)
    /** @type {HTMLElement | null} */ (
      box.querySelector('.take.chosen .choose') ?? box.querySelector('.choose')
    )?.focus();
}

// Figures that came since.
/** @param {Job | undefined} job */
function refresh(job) {
  if (!job) return;
  for (const [id, small] of smalls) {
    const there = loaded(id);
    if (there) {
      small.paint = `--take-${job.dances.indexOf(id) % TAKES}`;
      small.show(id, there, job.make);
    } else if (danceOf(id))
      load(id).then(
        () => tell('frames'),
        () => {},
      );
  }
}

export function openTakes() {
  box = find('takes');
  // all at the stage's moment, so that they can be compared
  onFrame(time => {
    for (const small of smalls.values()) small.at = time;
  });
  on(['cast', 'jobs', 'dances', 'frames'], draw);
  box.addEventListener('keydown', e => {
    if (!(e.target instanceof Element) || !e.target.closest('.choose')) return;
    const columns = takes().length > 1 ? 2 : 1,
      by = { ArrowLeft: -1, ArrowRight: 1, ArrowUp: -columns, ArrowDown: columns }[e.key];
    if (by === undefined) return;
    e.preventDefault();
    e.stopPropagation();
    focusWanted = true;
    chooseNext(by);
  });
  draw();
}
