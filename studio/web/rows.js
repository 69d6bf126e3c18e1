// The rows of the body: groups that open into joints, and over time what gives each or that it is made.

import { clipPaint, staged, takes } from './cast.js';
import { madeBy } from './dancer.js';
import { h } from './dom.js';
import { capital, clock, joints as said } from './format.js';
import { GROUPS, NAMES, PARTS } from './groups.js';
import { currentSet, danceOf, isBusy, on, secondsOf, store, tell, ui } from './store.js';

/** @typedef {import('./types.js').Row} Row @typedef {import('./types.js').Span} Span */

// What is shown in place of an empty timeline: the chosen dance, or the first.
export function danceShown() {
  const all = staged().length ? staged() : takes(),
    chosen = all.find(({ id }) => id === ui.focus) ?? all[0];
  return chosen ? (danceOf(chosen.id) ?? null) : null;
}

/** @param {import('./types.js').Dance | null} dance null: one that is on its way @returns {Row[]} */
function rowsOf(dance) {
  const job = currentSet(),
    unsaid = job && (!dance || job.dances.includes(dance.id)) ? madeBy(job.make) : null;
  const seconds = dance?.seconds ?? secondsOf(job),
    coded = new Set(store.state.model.joints.map(joint => joint.smpl));
  const all = dance?.made.length ? dance.made : (unsaid ?? [{ joints: GROUPS.all, from: 0, to: seconds }]);
  const made = all.map(span => ({ ids: new Set(span.joints), from: span.from, to: Math.min(span.to, seconds) }));
  const cuts = [...new Set([0, seconds, ...made.flatMap(span => [span.from, span.to])])].sort((a, b) => a - b);
  /** @param {number[]} ids @returns {Span[]} */
  const spans = ids =>
    cuts.slice(1).map((to, i) => {
      const from = cuts[i],
        middle = (from + to) / 2;
      // a group is made where all of its joints are that the model knows
      const known = ids.filter(id => coded.size === 0 || coded.has(id)),
        asked = known.length ? known : ids;
      const count = asked.filter(id =>
        made.some(span => span.ids.has(id) && middle > span.from && middle < span.to),
      ).length;
      return {
        from,
        to,
        state: count === 0 ? 'given' : count === asked.length ? 'generated' : 'partly',
        segment: null,
      };
    });
  return PARTS.map(part => ({
    group: part,
    spans: spans(GROUPS[part]),
    joints: GROUPS[part].map(id => ({ name: NAMES[id], spans: spans([id]) })),
  }));
}

export const rows = () => {
  if (store.timeline.rows.length) return store.timeline.rows;
  const dance = danceShown();
  return dance || isBusy(currentSet()) ? rowsOf(dance) : PARTS.map(part => ({ group: part, spans: [], joints: [] }));
};

const STATES = { given: 'given', generated: 'made', partly: 'partly made' };
const SHORT = 0.55; // seconds up to which what is given is a key pose

/** @param {Span} span */
function spanBox(span) {
  const clip =
    span.segment === null
      ? null
      : (store.timeline.segments.find(segment => segment.index === span.segment)?.clip ?? null);
  const isPose = span.state === 'given' && span.to - span.from <= SHORT && span.segment !== null;
  const text = `${STATES[span.state]}${clip ? ` by ${clip}` : ''}, ${clock(span.from)} to ${clock(span.to)}`;
  return h('i', {
    class: `span ${span.state}${isPose ? ' pose' : ''}`,
    role: 'img',
    'aria-label': text,
    title: capital(text),
    style: { '--a': span.from, '--b': span.to, '--own': `var(${span.segment === null ? '--body' : clipPaint(clip)})` },
  });
}

/** @param {string} name */
export function toggleRow(name) {
  if (ui.open.has(name)) ui.open.delete(name);
  else ui.open.add(name);
  tell('selection');
}

/** @param {string} name @param {boolean} more whether others stay selected */
export function selectRow(name, more) {
  const had = ui.joints.has(name);
  if (!more) ui.joints.clear();
  if (had) ui.joints.delete(name);
  else ui.joints.add(name);
  tell('selection', 'cast');
}

/** @param {string} name @param {Span[]} spans @param {boolean} isJoint @param {boolean} opens */
function rowBox(name, spans, isJoint, opens) {
  const chosen = ui.joints.has(name),
    words = capital(said(name));
  const head = h(
    'span',
    { class: 'head', role: 'rowheader' },
    isJoint
      ? null
      : h('button', {
          type: 'button',
          class: 'caret',
          'aria-expanded': ui.open.has(name),
          'aria-label': `Joints of ${words}`,
          disabled: !opens,
          'data-keep': `open ${name}`,
          onclick: () => toggleRow(name),
        }),
    h(
      'button',
      {
        type: 'button',
        class: 'pick',
        'aria-pressed': chosen,
        title: `Select ${words.toLowerCase()}`,
        'data-keep': `pick ${name}`,
        onclick: (/** @type {MouseEvent} */ e) => selectRow(name, e.shiftKey || e.ctrlKey || e.metaKey),
      },
      words,
    ),
  );
  const track = h('span', { class: 'track', role: 'gridcell', 'data-row': name }, ...spans.map(spanBox));
  if (ui.range && (chosen || ui.joints.size === 0))
    track.append(h('i', { class: 'picked', style: { '--a': ui.range[0], '--b': ui.range[1] } }));
  return h('div', { class: `row${isJoint ? ' joint' : ''}${chosen ? ' chosen' : ''}`, role: 'row' }, head, track);
}

/** @param {HTMLElement} box */
export function openRows(box) {
  let last = '';
  const draw = () => {
    const all = rows(),
      key = JSON.stringify([all, [...ui.open], [...ui.joints], ui.range, store.timeline.clips]);
    if (key === last) return;
    last = key;
    // what had the focus has it again
    const focus = document.activeElement?.getAttribute('data-keep'),
      boxes = [];
    for (const row of all) {
      boxes.push(rowBox(row.group, row.spans, false, row.joints.length > 1));
      if (ui.open.has(row.group) && row.joints.length > 1)
        boxes.push(...row.joints.map(joint => rowBox(joint.name, joint.spans, true, false)));
    }
    box.replaceChildren(...boxes);
    if (focus) /** @type {HTMLElement | null} */ (box.querySelector(`[data-keep="${CSS.escape(focus)}"]`))?.focus();
  };
  box.addEventListener('keydown', e => {
    const all = /** @type {HTMLElement[]} */ ([...box.querySelectorAll('.pick')]),
      at = all.indexOf(/** @type {HTMLElement} */ (e.target));
    if (at < 0) return;
    const name = all[at].dataset.keep?.slice(5) ?? '',
      by = { ArrowDown: 1, ArrowUp: -1 }[e.key];
    if (by) all[at + by]?.focus();
    else if ((e.key === 'ArrowRight' && !ui.open.has(name)) || (e.key === 'ArrowLeft' && ui.open.has(name)))
      toggleRow(name);
    else return;
    e.preventDefault();
    e.stopPropagation();
  });
  on(['timeline', 'selection', 'cast', 'dances'], draw);
  draw();
}
