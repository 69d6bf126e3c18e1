// The lanes of labels and of music.

import { change } from './card.js';
import { h } from './dom.js';
import { clock, unsaid } from './format.js';
import { beats, setMusic } from './music.js';
import { clipOf, on, store, tell, ui } from './store.js';
import { axis, frameTime, snapped } from './timeline-view.js';
import { toast } from './toast.js';

/** @typedef {import('./types.js').Segment} Segment */

// Labels a time: what is made there is of this kind.
/** @param {string} field @param {string} value @param {[number, number]} range */
export function addLabel(field, value, [from, to]) {
  if (!store.timeline.segments.length) {
    toast('Labels need a clip on the timeline. For a new dance, choose the label on the right.');
    return;
  }
  const taken = store.timeline.segments.find(
    s => s.labels[field] && s.from < to - 1e-6 && s.to > from + 1e-6 && !s.clip,
  );
  if (taken) change({ op: 'set', index: taken.index, key: 'labels', value: { ...taken.labels, [field]: value } });
  else change({ op: 'add', segment: { from: snapped(from), to: snapped(to), labels: { [field]: value } } });
}

/** @param {HTMLElement} box @param {(dt: number, done: boolean) => void} moved */
function dragged(box, moved) {
  let start = 0;
  box.addEventListener('pointerdown', e => {
    e.stopPropagation();
    box.setPointerCapture(e.pointerId);
    start = e.clientX;
  });
  box.addEventListener('pointermove', e => {
    if (box.hasPointerCapture(e.pointerId)) moved((e.clientX - start) / axis.scale, false);
  });
  box.addEventListener('pointerup', e => moved((e.clientX - start) / axis.scale, true));
}

/** @param {Segment} segment */
function label(segment) {
  const words = Object.values(segment.labels).join(', '),
    chosen = ui.segment === segment.index;
  const box = h(
    'div',
    {
      class: `block label-block${segment.assumed.length ? ' assumed' : ''}${chosen ? ' chosen' : ''}`,
      role: 'button',
      tabindex: 0,
      'aria-pressed': chosen,
      'data-keep': `segment ${segment.index}`,
      title: `${words}, ${clock(segment.from)} to ${clock(segment.to)}: drag to move, drag an end to trim${unsaid(segment)}`,
      'aria-label': `Label ${words}, ${clock(segment.from)} to ${clock(segment.to)}. Delete removes it`,
      style: { '--a': segment.from, '--b': segment.to, '--line': 0 },
    },
    h('span', { class: 'trim start' }),
    h('span', { class: 'text' }, words),
    h('span', { class: 'trim end' }),
  );
  let part = 'body';
  box.addEventListener(
    'pointerdown',
    e => {
      part =
        e.target instanceof Element && e.target.closest('.trim')
          ? e.target.classList.contains('start')
            ? 'start'
            : 'end'
          : 'body';
    },
    true,
  );
  dragged(box, (dt, done) => {
    const long = segment.to - segment.from;
    const from =
      part === 'end'
        ? segment.from
        : Math.min(snapped(segment.from + dt, segment.index), part === 'start' ? segment.to - frameTime() : Infinity);
    const to =
      part === 'start'
        ? segment.to
        : part === 'end'
          ? Math.max(snapped(segment.to + dt, segment.index), segment.from + frameTime())
          : from + long;
    box.style.setProperty('--a', String(from));
    box.style.setProperty('--b', String(to));
    if (!done) return;
    ui.segment = segment.index;
    tell('selection');
    if (Math.abs(from - segment.from) + Math.abs(to - segment.to) > 1e-6) {
      const edits = [
        { op: 'set', index: segment.index, key: 'from', value: from },
        { op: 'set', index: segment.index, key: 'to', value: to },
      ];
      change(...(from > segment.from ? edits.reverse() : edits));
    }
  });
  box.addEventListener('keydown', e => {
    if (e.key !== 'Enter' && e.key !== ' ') return;
    ui.segment = segment.index;
    tell('selection');
    e.preventDefault();
    e.stopPropagation();
  });
  return box;
}

export function labelsLane() {
  const track = h('div', { class: 'track lane', id: 'labels-lane' }),
    head = h('span', { class: 'head' }, 'Labels');
  const draw = () => {
    const labelled = store.timeline.segments.filter(segment => Object.keys(segment.labels).length);
    track.replaceChildren(...labelled.map(label));
    if (!labelled.length) track.append(h('span', { class: 'wish' }, 'Drop a label here'));
  };
  on(['timeline', 'selection'], draw);
  on(['model'], () => {
    const none = Object.keys(store.state.model.labels).length === 0;
    for (const part of [head, track]) part.hidden = none;
  });
  draw();
  return { head, track };
}

export function musicLane() {
  const track = h('div', { class: 'track lane', id: 'music-lane' }),
    head = h('span', { class: 'head' }, 'Music');
  const draw = () => {
    const { music } = store.state,
      clip = clipOf(music?.clip);
    for (const part of [head, track]) part.hidden = !music && !store.state.clips.some(clip => clip.music);
    if (!music || !clip) {
      track.replaceChildren(h('span', { class: 'wish' }, 'Drop music here'));
      return;
    }
    const from = -music.from_s,
      to = from + (clip.seconds ?? 0);
    const box = h(
      'div',
      {
        class: 'block music-block',
        role: 'button',
        tabindex: 0,
        style: { '--a': from, '--b': to, '--line': 0 },
        title: `${clip.name}: drag to set where it begins`,
        'aria-label': `${clip.name}, begins at ${from.toFixed(2)} s. Arrows move it, Delete takes it away`,
      },
      h('span', { class: 'text' }, clip.name),
    );
    dragged(box, (dt, done) => {
      box.style.transform = `translateX(${(dt * axis.scale).toFixed(1)}px)`;
      if (done && Math.abs(dt) * axis.scale > 3) setMusic(music.clip, music.from_s - dt);
      else if (done) box.style.transform = '';
    });
    box.addEventListener('keydown', e => {
      const by = { ArrowLeft: 1, ArrowRight: -1 }[e.key];
      if (by !== undefined) setMusic(music.clip, music.from_s + by * (e.shiftKey ? 1 : 0.05));
      else if (e.key === 'Delete' || e.key === 'Backspace') setMusic(null);
      else return;
      e.preventDefault();
      e.stopPropagation();
    });
    track.replaceChildren(box, ...beats().map(beat => h('i', { class: 'beat', style: { '--a': beat } })));
  };
  on(['music', 'clips'], draw);
  draw();
  return { head, track };
}
