// The library's pane: clips and music, kept dances, what moves alike, and the labels of the model.

import { found, forgetFound, onFound } from './brush.js';
import { showClip } from './cast.js';
import { clipCard, keptCard } from './card.js';
import { find, h, icon, iconButton } from './dom.js';
import { draggable } from './drag.js';
import { chosen, send, uploads } from './drop.js';
import { load } from './figures.js';
import { between, capital, clock } from './format.js';
import { addLabel } from './labels-lane.js';
import { Small } from './small.js';
import { stage } from './stage-view.js';
import { keptDances, nameOf, on, store, ui } from './store.js';

/** @typedef {{ card: HTMLElement, small: Small | null }} Card */

// A list that keeps the cards of what hasn't changed, so that figures dance on and focus stays.
/** @template {{ id: string }} T @param {HTMLElement} box @param {(one: T) => Card} make */
function list(box, make) {
  /** @type {Map<string, { key: string, made: Card }>} */
  let cards = new Map();
  /** @param {T[]} all */
  return all => {
    const next = new Map();
    for (const one of all) {
      const key = JSON.stringify(one),
        old = cards.get(one.id);
      if (old && old.key !== key) old.made.small?.remove();
      next.set(one.id, old?.key === key ? old : { key, made: make(one) });
    }
    for (const [id, { made }] of cards) if (!next.has(id)) made.small?.remove();
    cards = next;
    const nodes = [...next.values()].map(({ made }) => made.card);
    if (nodes.length !== box.children.length || nodes.some((node, i) => node !== box.children[i]))
      box.replaceChildren(...nodes);
  };
}

let filter = '';

/** @param {import('./types.js').Match} match */
function matchCard(match) {
  const small = new Small(`${nameOf(match.clip)} from ${clock(match.from_s)}`);
  Object.assign(small, { from: match.from_s, upto: match.to_s });
  load(match.clip).then(
    loaded => small.show(match.clip, loaded),
    () => {},
  );
  const watch = () => {
    showClip(match.clip);
    Object.assign(stage.state, { from: match.from_s, upto: match.to_s });
    load(match.clip).then(
      () => {
        stage.seek(match.from_s);
        stage.play(true);
      },
      () => {},
    );
  };
  const card = h(
    'li',
    { class: 'card ready' },
    h('span', { class: 'picture' }, small.canvas),
    h(
      'span',
      { class: 'about' },
      h('button', { type: 'button', class: 'name', onclick: watch }, nameOf(match.clip)),
      h('small', null, `${between(match.from_s, match.to_s)} · ${Math.round(100 * Math.max(0, match.score))} % alike`),
    ),
  );
  draggable(card, () => ({ kind: 'part', id: match.clip, from: match.from_s, to: match.to_s }));
  return { card, small };
}

/** @type {Small[]} */
let matches = [];
function showFound() {
  const box = find('found');
  matches.forEach(small => small.remove());
  box.hidden = !found.of;
  if (!found.of) return;
  box.parentElement?.scrollTo(0, 0);
  const cards = found.matches.map(matchCard);
  matches = cards.map(card => card.small);
  const none = found.busy ? 'Looking …' : 'Nothing in the library is like it.';
  box.replaceChildren(
    h('h3', null, 'Moves like this', iconButton('close', 'Close', forgetFound)),
    h('p', { class: 'quiet' }, `${nameOf(found.of.id)}, ${between(found.of.from, found.of.to)}`),
    cards.length ? h('ul', { class: 'cards' }, ...cards.map(card => card.card)) : h('p', { class: 'quiet' }, none),
  );
}

function showLabels() {
  const box = find('label-shelf'),
    fields = Object.entries(store.state.model.labels);
  box.hidden = fields.length === 0;
  const chips = fields.flatMap(([field, values]) =>
    values.map(value => {
      const chip = h(
        'button',
        {
          type: 'button',
          class: 'chip',
          title: `Drag ${value} onto the timeline, or press it to label the selected time`,
          onclick: () => addLabel(field, value, ui.range ?? [stage.state.time, stage.state.time + 4]),
        },
        value,
      );
      draggable(chip, () => ({ kind: 'label', field, value }));
      return chip;
    }),
  );
  box.replaceChildren(
    h('h3', null, capital(fields.map(([field]) => field).join(', '))),
    h('p', { class: 'chips' }, ...chips),
  );
}

/** @param {boolean} folder */
function picker(folder) {
  const input = h('input', {
    type: 'file',
    multiple: true,
    hidden: true,
    webkitdirectory: folder,
    'aria-label': folder ? 'Add a folder' : 'Add files',
  });
  input.addEventListener('change', () => {
    const files = [...(input.files ?? [])];
    send(folder ? chosen(files) : files);
    input.value = '';
  });
  return input;
}

export function openLibrary() {
  const files = picker(false),
    folder = picker(true),
    clips = h('ul', { class: 'cards', 'aria-label': 'Clips' });
  const kept = h('ul', { class: 'cards', 'aria-label': 'Kept dances' }),
    pending = h('p', { class: 'quiet pending', role: 'status' });
  const search = h('input', {
    type: 'search',
    id: 'filter',
    placeholder: 'Find by name',
    'aria-label': 'Find clips by name',
  });
  const keptTitle = h('h3', null, 'Kept dances'),
    hint = h(
      'div',
      { class: 'hint' },
      icon('upload'),
      h('p', null, h('b', null, 'Drop motion files or folders anywhere.')),
      h('p', null, 'BVH, FBX, GLB, AMC, npz, pkl or json; and music: mp3, ogg, flac, wav or m4a.'),
    );
  find('library').append(
    h(
      'header',
      null,
      h('h2', null, 'Library'),
      h('button', { type: 'button', class: 'quiet', onclick: () => files.click() }, icon('plus'), 'Files'),
      h('button', { type: 'button', class: 'quiet', onclick: () => folder.click() }, icon('plus'), 'Folder'),
      files,
      folder,
    ),
    search,
    h(
      'div',
      { class: 'scroll' },
      h('section', { id: 'found', 'aria-label': 'Moves like this', hidden: true }),
      clips,
      pending,
      hint,
      keptTitle,
      kept,
      h('section', { id: 'label-shelf', 'aria-label': 'Labels' }),
    ),
  );
  const showClips = list(clips, clipCard),
    showKept = list(kept, keptCard);
  const draw = () => {
    const is = (/** @type {{ name: string }} */ one) => one.name.toLowerCase().includes(filter);
    showClips(store.state.clips.filter(is));
    const dances = keptDances().filter(is);
    showKept(dances);
    keptTitle.hidden = dances.length === 0;
    hint.hidden = store.state.clips.length > 0 || uploads.size > 0;
    search.hidden = store.state.clips.length + keptDances().length < 6 && filter === '';
    pending.textContent = uploads.size
      ? `Adding ${[...uploads].slice(0, 3).join(', ')}${uploads.size > 3 ? ` and ${uploads.size - 3} more` : ''}`
      : '';
    for (const [box, of] of /** @type {[HTMLElement, string][]} */ ([
      [clips, 'clip'],
      [kept, 'clip'],
    ])) {
      for (const card of box.children)
        card.classList.toggle('shown', of === ui.mode && card.getAttribute('data-id') === ui.clip);
    }
  };
  search.addEventListener('input', () => {
    filter = search.value.toLowerCase();
    draw();
  });
  on(['clips', 'dances', 'cast', 'music'], draw);
  on(['model'], showLabels);
  onFound(showFound);
  draw();
}
