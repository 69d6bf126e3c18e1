// The lane of clips: the timeline's segments as blocks, which are moved, trimmed, cut and removed.

import { clipPaint, nameIn } from './cast.js';
import { h } from './dom.js';
import { moveSegment } from './edits.js';
import { clock, joints as said, unsaid } from './format.js';
import { on, store, tell, ui } from './store.js';
import { axis, frameTime, snapped } from './timeline-view.js';

/** @typedef {import('./types.js').Segment} Segment */

// Each block in the first line where it has room.
/** @param {Segment[]} segments */
function lines(segments) {
  /** @type {number[]} */
  const ends = [];
  return segments.map(segment => {
    const free = ends.findIndex(end => segment.from >= end - 1e-6),
      line = free < 0 ? ends.length : free;
    ends[line] = segment.to;
    return line;
  });
}

/** @param {number} index */
export function selectSegment(index) {
  ui.segment = index;
  tell('selection');
}

/** @param {HTMLElement} box @param {Segment} segment @param {(from: number, to: number, at: number) => void} show */
function movable(box, segment, show) {
  let startX = 0,
    part = 'body',
    moved = false;
  let now = { from: segment.from, to: segment.to, at: segment.at };
  const settle = (/** @type {number} */ dx) => {
    const dt = dx / axis.scale,
      long = segment.to - segment.from,
      least = 2 * frameTime();
    if (part === 'body') {
      const start = snapped(segment.from + dt, segment.index),
        end = snapped(segment.to + dt, segment.index);
      // the end that snaps to something counts
      const from = Math.max(
        0,
        Math.abs(start - segment.from - dt) <= Math.abs(end - segment.to - dt) ? start : end - long,
      );
      now = { from, to: from + long, at: segment.at };
    } else if (part === 'start') {
      const from = Math.min(
        Math.max(snapped(segment.from + dt, segment.index), segment.from - segment.at),
        segment.to - least,
      );
      now = { from, to: segment.to, at: segment.at + from - segment.from };
    } else {
      now = { ...now, to: Math.max(snapped(segment.to + dt, segment.index), segment.from + least) };
    }
    show(now.from, now.to, now.at);
  };
  box.addEventListener('pointerdown', e => {
    if (e.button !== 0) return;
    e.stopPropagation();
    box.setPointerCapture(e.pointerId);
    startX = e.clientX;
    moved = false;
    part =
      e.target instanceof Element && e.target.closest('.trim')
        ? e.target.classList.contains('start')
          ? 'start'
          : 'end'
        : 'body';
  });
  box.addEventListener('pointermove', e => {
    if (!box.hasPointerCapture(e.pointerId) || (!moved && Math.abs(e.clientX - startX) < 4)) return;
    moved = true;
    settle(e.clientX - startX);
  });
  box.addEventListener('pointerup', () => {
    if (moved) moveSegment(segment.index, now);
    selectSegment(segment.index);
  });
  box.addEventListener('keydown', e => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (by !== undefined && !e.altKey) {
      part = e.shiftKey ? 'end' : 'body';
      const dt = by * Math.max(frameTime(), 0.05);
      const to = segment.to + dt,
        from = e.shiftKey ? segment.from : Math.max(0, segment.from + dt);
      moveSegment(segment.index, { from, to: e.shiftKey ? to : from + segment.to - segment.from, at: segment.at });
    } else if (e.key === 'Enter' || e.key === ' ') selectSegment(segment.index);
    else return;
    e.preventDefault();
    e.stopPropagation();
  });
}

/** @param {Segment} segment @param {number} line */
function block(segment, line) {
  const label = `${nameIn(segment)}${segment.joints && segment.joints !== 'all' ? `: ${said(segment.joints)}` : ''}`;
  const box = h(
    'div',
    {
      class: `block${segment.assumed.length ? ' assumed' : ''}${ui.segment === segment.index ? ' chosen' : ''}`,
      role: 'button',
      tabindex: 0,
      'data-keep': `segment ${segment.index}`,
      'aria-pressed': ui.segment === segment.index,
      title: `${label}, ${clock(segment.from)} to ${clock(segment.to)}, from its ${clock(segment.at)} on${unsaid(segment)}`,
      'aria-label': `${label}, ${clock(segment.from)} to ${clock(segment.to)}. Arrows move it, Shift and arrows trim it, Delete removes it`,
      style: { '--a': segment.from, '--b': segment.to, '--line': line, '--own': `var(${clipPaint(segment.clip)})` },
    },
    h('span', { class: 'trim start' }),
    h('span', { class: 'text' }, label),
    h('span', { class: 'trim end' }),
  );
  movable(box, segment, (from, to) => {
    box.style.setProperty('--a', String(from));
    box.style.setProperty('--b', String(to));
  });
  return box;
}

export function clipsLane() {
  const track = h('div', { class: 'track lane', id: 'clips-lane' });
  let last = '';
  const draw = () => {
    const segments = store.timeline.segments.filter(segment => segment.clip),
      key = JSON.stringify([segments, ui.segment, store.timeline.clips]);
    if (key === last) return;
    last = key;
    const at = lines(segments),
      count = Math.max(1, ...at.map(line => line + 1));
    const focus = document.activeElement?.getAttribute('data-keep');
    track.replaceChildren(...segments.map((segment, i) => block(segment, at[i])));
    track.style.setProperty('--lines', String(count));
    if (!segments.length) track.append(h('span', { class: 'wish' }, 'Drop a clip here'));
    if (focus) /** @type {HTMLElement | null} */ (track.querySelector(`[data-keep="${CSS.escape(focus)}"]`))?.focus();
  };
  on(['timeline', 'selection'], draw);
  draw();
  return { head: h('span', { class: 'head' }, 'Clips'), track };
}
