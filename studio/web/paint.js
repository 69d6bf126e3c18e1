// Painting on the rows: a drag selects joints and time, or makes them free, or gives them; over several rows at once.

import { h } from './dom.js';
import { free, give } from './edits.js';
import { simplest } from './groups.js';
import { stage } from './stage-view.js';
import { tell, ui } from './store.js';
import { axis, frameTime, snapped, timeAt, wholeTime } from './timeline-view.js';

const CLICK = 4; // pixels that a click may move

/** @param {HTMLElement} rows */
export function openPaint(rows) {
  /** @type {{ row: HTMLElement, x: number, time: number, more: boolean } | null} */
  let begun = null;
  /** @type {HTMLElement[]} */
  let marks = [];
  let last = { names: /** @type {string[]} */ ([]), from: 0, to: 0 };

  const trackOf = (/** @type {Element | null} */ element) =>
    /** @type {HTMLElement | null} */ (element?.closest('[data-row]') ?? null);
  const at = (/** @type {PointerEvent} */ e, /** @type {HTMLElement} */ track) => {
    const x = e.clientX - track.getBoundingClientRect().left;
    return Math.min(snapped(timeAt(Math.min(Math.max(0, x), axis.width))), wholeTime());
  };
  const clear = () => {
    marks.forEach(mark => mark.remove());
    marks = [];
  };

  rows.addEventListener('pointerdown', e => {
    const row = trackOf(/** @type {Element} */ (e.target));
    if (!row || e.button !== 0) return;
    rows.setPointerCapture(e.pointerId);
    begun = { row, x: e.clientX, time: at(e, row), more: e.shiftKey || e.ctrlKey || e.metaKey };
    last = { names: [row.dataset.row ?? ''], from: begun.time, to: begun.time };
  });
  rows.addEventListener('pointermove', e => {
    if (!begun || !rows.hasPointerCapture(e.pointerId)) return;
    if (!marks.length && Math.abs(e.clientX - begun.x) < CLICK) return;
    const all = /** @type {HTMLElement[]} */ ([...rows.querySelectorAll('[data-row]')]),
      first = all.indexOf(begun.row);
    const under = all.findIndex(track => {
      const box = track.getBoundingClientRect();
      return e.clientY >= box.top && e.clientY < box.bottom;
    });
    const to = under < 0 ? (e.clientY < begun.row.getBoundingClientRect().top ? 0 : all.length - 1) : under;
    const swept = all.slice(Math.min(first, to), Math.max(first, to) + 1),
      time = at(e, begun.row);
    last = {
      names: swept.map(track => track.dataset.row ?? ''),
      from: Math.min(begun.time, time),
      to: Math.max(begun.time, time),
    };
    clear();
    marks = swept.map(track => {
      const mark = h('i', { class: `painting ${ui.tool}`, style: { '--a': last.from, '--b': last.to } });
      track.append(mark);
      return mark;
    });
  });
  const end = (/** @type {PointerEvent} */ e) => {
    if (!begun) return;
    const { names, from, to } = last,
      { more } = begun,
      isClick = marks.length === 0;
    begun = null;
    clear();
    if (e.type === 'pointercancel') return;
    const swept = simplest(names);
    if (isClick) {
      stage.seek(Math.min(from, stage.whole));
      if (ui.tool !== 'select') return;
      if (!more) ui.joints.clear();
      names.forEach(name => ui.joints.add(name));
      ui.range = null;
      tell('selection', 'cast');
    } else if (to - from < 0.5 * frameTime()) return;
    else if (ui.tool === 'free') free(swept.join(','), from, to);
    else if (ui.tool === 'give') give(swept.join(','), from, to);
    else {
      if (!more) ui.joints.clear();
      names.forEach(name => ui.joints.add(name));
      ui.range = [from, to];
      tell('selection', 'cast');
    }
  };
  rows.addEventListener('pointerup', end);
  rows.addEventListener('pointercancel', end);
}
