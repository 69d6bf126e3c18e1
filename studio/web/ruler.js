// The ruler: seconds and beats, what is made, the ends of what is played, and the playhead.

import { dancersOnStage, onFrame, stage } from './stage-view.js';
import { staged } from './cast.js';
import { find, h } from './dom.js';
import { clock } from './format.js';
import { beats } from './music.js';
import { danceOf, on, store, ui } from './store.js';
import { axis, frameTime, onAxis, reveal, snapped, timeAt, wholeTime, xOf } from './timeline-view.js';

const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300];

/** @type {HTMLCanvasElement} */
let canvas;
/** @type {HTMLElement} */
let made;
/** @type {Record<'from' | 'upto', HTMLElement>} */
let ends;
/** @type {HTMLElement} */
let played;

function paint() {
  const scale = Math.min(devicePixelRatio || 1, 2),
    width = canvas.clientWidth,
    height = canvas.clientHeight;
  if (!width) return;
  Object.assign(canvas, { width: Math.round(width * scale), height: Math.round(height * scale) });
  const pen = canvas.getContext('2d');
  if (!pen) return;
  const style = getComputedStyle(canvas),
    colour = (/** @type {string} */ name) => style.getPropertyValue(name);
  pen.scale(scale, scale);
  pen.font = '11px system-ui, sans-serif';
  const step = STEPS.find(step => step * axis.scale >= 58) ?? 600,
    fine = step / 5;
  for (let n = Math.floor(axis.from / fine); n * fine <= timeAt(width); n++) {
    const isLong = n % 5 === 0,
      x = Math.round(xOf(n * fine)) + 0.5;
    pen.strokeStyle = colour('--line');
    pen.beginPath();
    pen.moveTo(x, height - (isLong ? 12 : 6));
    pen.lineTo(x, height);
    pen.stroke();
    pen.fillStyle = colour('--quiet');
    const s = n * fine;
    if (isLong && x < width - 26)
      pen.fillText(
        step < 1 ? clock(s) : `${Math.floor(s / 60)}:${String(Math.round(s % 60)).padStart(2, '0')}`,
        x + 4,
        height - 6,
      );
  }
  pen.strokeStyle = colour('--beat');
  for (const beat of beats()) {
    const x = Math.round(xOf(beat)) + 0.5;
    if (x < 0 || x > width) continue;
    pen.beginPath();
    pen.moveTo(x, height - 5);
    pen.lineTo(x, height);
    pen.lineWidth = 2;
    pen.stroke();
  }
}

// Orange where something is made: of the dances on the stage, or of the timeline where it is shown.
function paintMade() {
  const spans =
    ui.mode === 'timeline'
      ? store.timeline.rows.flatMap(row =>
          row.spans.filter(span => span.state !== 'given').map(span => [span.from, span.to]),
        )
      : staged().flatMap(({ id }) => {
          const dance = danceOf(id),
            dancer = dancersOnStage().find(d => d.id === id);
          if (!dance) return dancer ? [[0, dancer.lasts]] : [];
          return dance.generated_s.length ? dance.generated_s : [[0, dance.seconds]];
        });
  const seen = new Set(),
    marks = [];
  for (const [from, to] of spans) {
    if (seen.has(`${from} ${to}`)) continue;
    seen.add(`${from} ${to}`);
    marks.push(h('i', { style: { '--a': from, '--b': Math.min(to, wholeTime()) } }));
  }
  made.replaceChildren(...marks);
}

export function paintEnds() {
  const { from, upto } = stage.state,
    whole = wholeTime(),
    end = Math.min(upto, whole);
  played.style.setProperty('--a', String(from));
  played.style.setProperty('--b', String(end));
  played.classList.toggle('all', from <= 0 && end >= whole);
  ends.from.style.setProperty('--a', String(from));
  ends.upto.style.setProperty('--a', String(end));
  for (const [name, at] of /** @type {['from' | 'upto', number][]} */ ([
    ['from', from],
    ['upto', end],
  ])) {
    ends[name].setAttribute('aria-valuenow', at.toFixed(2));
    ends[name].setAttribute('aria-valuemax', whole.toFixed(2));
    ends[name].setAttribute('aria-valuetext', clock(at));
  }
}

/** @param {'from' | 'upto'} name @param {number} time */
function setEnd(name, time) {
  const { state } = stage,
    whole = wholeTime(),
    least = 4 * frameTime();
  if (name === 'from') state.from = Math.max(0, Math.min(time, Math.min(state.upto, whole) - least));
  else state.upto = time >= whole - 1e-6 ? Infinity : Math.max(time, state.from + least);
  stage.hold_s = state.upto === Infinity ? 0.7 : 0;
  paintEnds();
}

// Plays a time over and over; null: all of it.
/** @param {[number, number] | null} range */
export function playOnly(range) {
  Object.assign(stage.state, { from: range?.[0] ?? 0, upto: range?.[1] ?? Infinity });
  if (range) stage.seek(range[0]);
  stage.hold_s = range ? 0 : 0.7;
  paintEnds();
}

/** @param {'from' | 'upto'} name */
function end(name) {
  const label = name === 'from' ? 'Loop begins' : 'Loop ends';
  const handle = h('span', {
    class: `loop-end ${name}`,
    role: 'slider',
    tabindex: 0,
    'aria-label': label,
    'aria-valuemin': 0,
    title: `${label}: drag; double click plays all again`,
  });
  handle.addEventListener('pointerdown', e => {
    handle.setPointerCapture(e.pointerId);
    e.stopPropagation();
  });
  handle.addEventListener('pointermove', e => {
    if (handle.hasPointerCapture(e.pointerId))
      setEnd(name, snapped(timeAt(e.clientX - canvas.getBoundingClientRect().left)));
  });
  handle.addEventListener('dblclick', e => {
    e.stopPropagation();
    playOnly(null);
  });
  handle.addEventListener('keydown', e => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
    if (by === undefined) return;
    e.preventDefault();
    e.stopPropagation();
    const now = name === 'from' ? stage.state.from : Math.min(stage.state.upto, wholeTime());
    setEnd(name, now + by * (e.shiftKey ? 1 : frameTime()));
  });
  return handle;
}

/** @returns {{ head: HTMLElement, track: HTMLElement }} */
export function ruler() {
  canvas = h('canvas', { class: 'ticks' });
  made = h('div', { class: 'made-bar', title: 'Orange: what is made' });
  played = h('div', { class: 'played' });
  ends = { from: end('from'), upto: end('upto') };
  const slider = h(
    'div',
    {
      class: 'scrub',
      id: 'scrub',
      role: 'slider',
      tabindex: 0,
      'aria-label': 'Time',
      'aria-valuemin': 0,
      'aria-valuenow': 0,
      title: 'Drag to move through time',
    },
    canvas,
    made,
  );
  const track = h('div', { class: 'track ruler', id: 'ruler' }, slider, played, ends.from, ends.upto);
  const seek = (/** @type {PointerEvent} */ e) => {
    stage.seek(Math.min(stage.whole, Math.max(0, snapped(timeAt(e.clientX - canvas.getBoundingClientRect().left)))));
  };
  let was = false;
  slider.addEventListener('pointerdown', e => {
    slider.setPointerCapture(e.pointerId);
    was = stage.state.playing;
    stage.play(false);
    seek(e);
  });
  slider.addEventListener('pointermove', e => {
    if (slider.hasPointerCapture(e.pointerId)) seek(e);
  });
  slider.addEventListener('pointerup', () => {
    if (was) stage.play(true);
    was = false;
  });
  slider.addEventListener('dblclick', () => playOnly(null));
  onAxis(() => {
    paint();
    paintMade();
    paintEnds();
  });
  addEventListener('repaint', paint);
  on(['music', 'clips'], paint);
  on(['dances', 'cast'], () => {
    paintMade();
    paintEnds();
  });
  return { head: h('span', { class: 'head' }, 'Time'), track };
}

export function openPlayhead() {
  const line = find('playhead'),
    track = find('scrub');
  let at = -1;
  const show = (/** @type {number} */ time) => {
    const x = xOf(time);
    if (x !== at) {
      at = x;
      line.style.transform = `translateX(${x.toFixed(1)}px)`;
      line.hidden = x < 0 || x > axis.width;
    }
  };
  onFrame(time => {
    if (stage.state.playing) reveal(time);
    show(time);
  });
  onAxis(() => show(stage.state.time));
  // a screen reader hears the time where it is asked, not sixty times a second
  setInterval(() => {
    track.setAttribute('aria-valuenow', stage.state.time.toFixed(2));
    track.setAttribute('aria-valuemax', wholeTime().toFixed(2));
    track.setAttribute('aria-valuetext', clock(stage.state.time));
  }, 500);
}
