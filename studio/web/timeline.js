// The timeline's pane: tools, lanes and rows over one axis of time.

import { change } from './card.js';
import { clipsLane } from './clips-lane.js';
import { find, h, icon, iconButton } from './dom.js';
import { whatIsDragged } from './drag.js';
import { cut, freeSelected, giveSelected, keyPose, landed, removeSegment } from './edits.js';
import { between, joints as said } from './format.js';
import { addLabel, labelsLane, musicLane } from './labels-lane.js';
import { setMusic } from './music.js';
import { openPaint } from './paint.js';
import { openRows } from './rows.js';
import { openPlayhead, playOnly, ruler } from './ruler.js';
import { keptDances, motionClips, on, store, tell, ui } from './store.js';
import { axis, fit, onAxis, settle, slide, snapped, timeAt, wholeTime, zoom } from './timeline-view.js';

/** @type {{ id: 'select' | 'free' | 'give', icon: 'select' | 'brush' | 'pin', name: string, tip: string }[]} */
const TOOLS = [
  { id: 'select', icon: 'select', name: 'Select', tip: 'Select joints and a time (A)' },
  { id: 'free', icon: 'brush', name: 'Make anew', tip: 'Paint what is to be made anew (R)' },
  { id: 'give', icon: 'pin', name: 'Give', tip: 'Paint what is given from a clip (E)' },
];

/** @param {'select' | 'free' | 'give'} tool */
export function setTool(tool) {
  ui.tool = tool;
  tell('tool');
}

export function toggleSnap() {
  ui.snap = !ui.snap;
  tell('tool');
}

function tools() {
  const buttons = TOOLS.map(({ id, icon: of, name, tip }) =>
    h(
      'button',
      {
        type: 'button',
        class: `tool ${id}`,
        title: tip,
        'aria-pressed': ui.tool === id,
        onclick: () => setTool(id),
      },
      icon(of),
      name,
    ),
  );
  const giver = h('select', {
    id: 'giver',
    'aria-label': 'The clip that is given from',
    title: 'The clip that is given from',
  });
  giver.addEventListener('change', () => {
    ui.giver = giver.value || null;
  });
  const snap = iconButton('magnet', 'Snap to beats, edges and the playhead (Q)', toggleSnap, {
    'aria-pressed': ui.snap,
  });
  const draw = () => {
    buttons.forEach((button, i) => button.setAttribute('aria-pressed', String(TOOLS[i].id === ui.tool)));
    snap.setAttribute('aria-pressed', String(ui.snap));
    giver.hidden = ui.tool !== 'give';
    find('rows').dataset.tool = ui.tool;
    const all = [...motionClips(), ...keptDances()];
    giver.replaceChildren(
      h('option', { value: '' }, 'the clip that is there'),
      ...all.map(one => h('option', { value: one.id, selected: one.id === ui.giver }, one.name)),
    );
  };
  on(['tool', 'clips', 'dances'], draw);
  return {
    parts: [h('span', { class: 'segments', role: 'group', 'aria-label': 'Tool' }, ...buttons), giver],
    snap,
    draw,
  };
}

// What is selected, and what can be done with it.
function selection() {
  const box = h('span', { class: 'selection', role: 'status' });
  const draw = () => {
    const isSome = ui.joints.size > 0 || ui.range !== null;
    box.hidden = !isSome;
    if (!isSome) return;
    const what = ui.joints.size ? said([...ui.joints].join(',')) : 'whole body';
    const when = ui.range ? `, ${between(ui.range[0], ui.range[1])}` : '';
    const { range } = ui;
    box.replaceChildren(
      ...[
        h('b', { title: `${what}${when}` }, `${what}${when}`),
        h(
          'button',
          { type: 'button', class: 'free', title: 'To be made anew (Shift R)', onclick: freeSelected },
          'Make anew',
        ),
        h('button', { type: 'button', title: 'As the clip has it (Shift E)', onclick: giveSelected }, 'Give'),
        range &&
          h(
            'button',
            { type: 'button', title: 'Play this time over and over', onclick: () => playOnly(range) },
            'Loop',
          ),
      ].filter(part => part !== null),
    );
  };
  on(['selection'], draw);
  draw();
  return box;
}

// The file itself, for those who like to write it.
function text() {
  const area = h('textarea', { 'aria-label': 'The timeline’s file', spellcheck: 'false', rows: 22 });
  area.value = store.timeline.text;
  const notes = [...new Set(store.timeline.notes)].map(note => h('li', null, note));
  const dialog = h(
    'dialog',
    { class: 'text', 'aria-label': 'The timeline’s file' },
    h('h2', null, 'timeline.toml'),
    area,
    notes.length > 0 && h('ul', { class: 'notes' }, ...notes),
    h(
      'div',
      { class: 'row end' },
      h('button', { type: 'button', class: 'quiet', onclick: () => dialog.close() }, 'Close'),
      h(
        'button',
        {
          type: 'button',
          class: 'strong',
          onclick: async () => {
            if (await change({ op: 'text', text: area.value })) dialog.close();
          },
        },
        'Save',
      ),
    ),
  );
  dialog.addEventListener('close', () => dialog.remove());
  document.body.append(dialog);
  dialog.showModal();
}

function trouble() {
  const box = h('p', { class: 'trouble-line', role: 'alert', hidden: true });
  on(['timeline'], () => {
    const first = store.timeline.trouble[0];
    box.hidden = !first;
    if (first) box.textContent = `The timeline can’t be made like this. ${first.line ? `Line ${first.line}: ` : ''}${first.text}`;
  });
  return box;
}

/** @param {HTMLElement} body */
function listenToDrops(body) {
  const over = (/** @type {DragEvent} */ e) => {
    const track = /** @type {HTMLElement | null} */ (e.target instanceof Element ? e.target.closest('.track') : null);
    return {
      row: track?.dataset.row ?? null,
      lane: track?.id ?? '',
      time: Math.min(snapped(timeAt(e.clientX - find('ruler').getBoundingClientRect().left)), wholeTime()),
    };
  };
  body.addEventListener('dragover', e => {
    const what = whatIsDragged();
    if (!what) return;
    e.preventDefault();
    const { row, time } = over(e),
      mark = find('drop-mark');
    mark.hidden = false;
    mark.style.transform = `translateX(${((time - axis.from) * axis.scale).toFixed(1)}px)`;
    body.querySelectorAll('.over').forEach(one => one.classList.remove('over'));
    if (row && what.kind !== 'music' && what.kind !== 'label')
      e.target instanceof Element && e.target.closest('.track')?.classList.add('over');
  });
  const gone = () => {
    find('drop-mark').hidden = true;
    body.querySelectorAll('.over').forEach(one => one.classList.remove('over'));
  };
  body.addEventListener('dragleave', e => {
    if (!(e.relatedTarget instanceof Node) || !body.contains(e.relatedTarget)) gone();
  });
  body.addEventListener('drop', e => {
    const what = whatIsDragged();
    gone();
    if (!what) return;
    e.preventDefault();
    const { row, time } = over(e);
    if (what.kind === 'music') setMusic(what.id, -time);
    else if (what.kind === 'label')
      addLabel(
        what.field,
        what.value,
        ui.range ?? [time, Math.min(time + 4, Math.max(time + 1, store.timeline.seconds))],
      );
    else landed(what, time, row);
  });
}

function size() {
  const bar = find('timeline-size'),
    root = document.documentElement,
    KEY = 'kinelm-timeline-height';
  const set = (/** @type {number} */ pixels) => {
    const height = Math.round(Math.min(Math.max(150, pixels), innerHeight * 0.6));
    root.style.setProperty('--timeline', `${height}px`);
    bar.setAttribute('aria-valuenow', String(height));
    localStorage.setItem(KEY, String(height));
  };
  const kept = Number(localStorage.getItem(KEY));
  if (kept) set(kept);
  bar.addEventListener('pointerdown', e => bar.setPointerCapture(e.pointerId));
  bar.addEventListener('pointermove', e => {
    if (bar.hasPointerCapture(e.pointerId)) set(innerHeight - e.clientY);
  });
  bar.addEventListener('keydown', e => {
    const by = { ArrowUp: 20, ArrowDown: -20 }[e.key];
    if (by === undefined) return;
    e.preventDefault();
    e.stopPropagation();
    set(find('timeline').offsetHeight + by);
  });
}

export function openTimeline() {
  const rows = h('div', { id: 'rows', role: 'grid', 'aria-label': 'Joints over time' }),
    { parts, snap, draw } = tools();
  const lanes = [ruler(), clipsLane(), labelsLane(), musicLane()];
  const body = h(
    'div',
    { id: 'lanes' },
    ...lanes.map(({ head, track }, i) => {
      const line = h('div', { class: `row${i ? '' : ' top'}` }, head, track);
      return line;
    }),
    rows,
  );
  const over = h(
    'div',
    { class: 'over-tracks', 'aria-hidden': 'true' },
    h('span', { id: 'drop-mark', hidden: true }),
    h('span', { id: 'playhead' }),
  );
  find('timeline').append(
    h(
      'div',
      { id: 'tools', role: 'toolbar', 'aria-label': 'Timeline' },
      ...parts,
      h(
        'span',
        { class: 'group' },
        iconButton('diamond', 'Key pose at the playhead (K)', () => keyPose()),
        iconButton('cut', 'Cut at the playhead (X)', () => cut()),
        iconButton('close', 'Remove the selected block (Delete)', () => removeSegment()),
      ),
      snap,
      selection(),
      h('span', { class: 'spring' }),
      h('button', { type: 'button', class: 'quiet', title: 'The file that this timeline is', onclick: text }, 'Text'),
      h(
        'span',
        { class: 'group' },
        iconButton('minus', 'Less time across', () => zoom(1 / 1.5)),
        h('button', { type: 'button', title: 'All of the time', onclick: fit }, 'Fit'),
        iconButton('plus', 'More time across', () => zoom(1.5)),
      ),
    ),
    trouble(),
    h('div', { id: 'body' }, body, over),
  );
  draw();
  openRows(rows);
  openPaint(rows);
  openPlayhead();
  listenToDrops(body);
  size();
  onAxis(() => {
    body.style.setProperty('--t0', String(axis.from));
    body.style.setProperty('--pps', `${axis.scale}px`);
  });
  new ResizeObserver(() => {
    axis.width = find('ruler').clientWidth;
    over.style.width = `${axis.width}px`;
    settle();
  }).observe(find('ruler'));
  body.addEventListener(
    'wheel',
    e => {
      const x = e.clientX - find('ruler').getBoundingClientRect().left;
      if (e.ctrlKey || e.metaKey) zoom(Math.exp(-Math.max(-100, Math.min(100, e.deltaY)) * 0.004), x);
      else if (e.shiftKey || Math.abs(e.deltaX) > Math.abs(e.deltaY))
        slide(e.shiftKey ? e.deltaY + e.deltaX : e.deltaX);
      else return;
      e.preventDefault();
    },
    { passive: false },
  );
  let whole = 0;
  on(['timeline', 'cast', 'frames'], () => {
    const now = wholeTime();
    if (now !== whole) settle();
    whole = now;
  });
}
