// A clip's strip: the time of it, of which two seconds are brushed to look for what else moves like this.

import { post } from './api.js';
import { h } from './dom.js';
import { clock } from './format.js';
import { store } from './store.js';
import { attempt } from './toast.js';

/** @typedef {import('./types.js').Match} Match */

/** @type {(() => void)[]} */
const listeners = [];
export const found = {
  of: /** @type {{ id: string, from: number, to: number } | null} */ (null),
  matches: /** @type {Match[]} */ ([]),
  busy: false,
};

/** @param {() => void} does */
export const onFound = does => {
  listeners.push(does);
};
const told = () => listeners.forEach(does => does());

export function forgetFound() {
  Object.assign(found, { of: null, matches: [], busy: false });
  told();
}

/** @param {string} id @param {number} from @param {number} to */
async function look(id, from, to) {
  Object.assign(found, { of: { id, from, to }, matches: [], busy: true });
  told();
  const answer = await attempt(() => post('/api/search', { clip: id, from_s: from, to_s: to, k: 6 }));
  if (found.of?.id !== id || found.of.from !== from) return;
  Object.assign(found, { matches: answer?.matches ?? [], busy: false, of: answer ? found.of : null });
  told();
}

/** @param {string} id @param {string} name @param {number} seconds @param {(time: number | null) => void} at what is under the pointer */
export function strip(id, name, seconds, at) {
  const long = Math.min(store.state.search_s, seconds),
    mark = h('i'),
    box = h(
      'div',
      {
        class: 'brush',
        role: 'slider',
        tabindex: 0,
        'aria-label': `${name}: brush ${long.toFixed(0)} seconds to find what else moves like this`,
        'aria-valuemin': 0,
        'aria-valuemax': Math.max(0, seconds - long).toFixed(1),
        title: `Brush ${long.toFixed(0)} seconds: what else moves like this?`,
      },
      mark,
    );
  let from = 0;
  const show = () => {
    mark.style.left = `${(100 * from) / seconds}%`;
    mark.style.width = `${(100 * long) / seconds}%`;
    box.setAttribute('aria-valuenow', from.toFixed(1));
    box.setAttribute('aria-valuetext', `${clock(from)} to ${clock(from + long)}`);
  };
  /** @param {number} time */
  const set = time => {
    from = Math.min(Math.max(0, time), Math.max(0, seconds - long));
    show();
    at(from + long / 2);
  };
  const timeOf = (/** @type {PointerEvent} */ e) =>
    ((e.clientX - box.getBoundingClientRect().left) / box.clientWidth) * seconds - long / 2;
  box.addEventListener('pointerdown', e => {
    box.setPointerCapture(e.pointerId);
    box.classList.add('brushing');
    set(timeOf(e));
  });
  box.addEventListener('pointermove', e => {
    if (box.hasPointerCapture(e.pointerId)) set(timeOf(e));
  });
  box.addEventListener('pointerup', () => {
    box.classList.remove('brushing');
    at(null);
    look(id, from, from + long);
  });
  box.addEventListener('keydown', e => {
    const by = { ArrowLeft: -0.25, ArrowRight: 0.25 }[e.key];
    if (by !== undefined) set(from + by);
    else if (e.key === 'Enter') {
      at(null);
      look(id, from, from + long);
    } else return;
    e.preventDefault();
    e.stopPropagation();
  });
  show();
  return box;
}
