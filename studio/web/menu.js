// A menu below a button: by mouse, and by arrows, Enter and Escape.

import { h } from './dom.js';

/** @typedef {{ label: string, hint?: string, does: () => void, href?: string, download?: string, off?: boolean } | null} Item */

/** @type {(() => void) | null} */
let close = null;

/** @param {HTMLElement} button @param {Item[]} items null is a line between groups */
export function menu(button, items) {
  close?.();
  const box = h('div', { class: 'menu', role: 'menu', 'aria-label': button.getAttribute('aria-label') ?? 'Menu' });
  const gone = () => {
    box.remove();
    button.setAttribute('aria-expanded', 'false');
    removeEventListener('pointerdown', outside, true);
    close = null;
  };
  const outside = (/** @type {PointerEvent} */ e) => {
    if (!(e.target instanceof Node) || !box.contains(e.target)) gone();
  };
  for (const item of items) {
    if (!item) {
      box.append(h('hr'));
      continue;
    }
    const { label, hint, does, href, download, off } = item;
    const pick = () => {
      gone();
      button.focus();
      does();
    };
    box.append(
      href
        ? h(
            'a',
            { role: 'menuitem', href, download: download ?? '', tabindex: -1, onclick: pick },
            label,
            hint && h('small', null, hint),
          )
        : h(
            'button',
            { type: 'button', role: 'menuitem', tabindex: -1, disabled: off, onclick: pick },
            label,
            hint && h('small', null, hint),
          ),
    );
  }
  box.addEventListener('keydown', e => {
    const all = [...box.querySelectorAll('[role=menuitem]:not([disabled])')],
      at = all.indexOf(/** @type {Element} */ (document.activeElement));
    const to = { ArrowDown: at + 1, ArrowUp: at - 1 + all.length, Home: 0, End: all.length - 1 }[e.key];
    if (to !== undefined) /** @type {HTMLElement} */ (all[to % all.length]).focus();
    else if (e.key === 'Escape' || e.key === 'Tab') {
      gone();
      button.focus();
    } else if (e.key !== 'Enter' && e.key !== ' ') return;
    e.stopPropagation();
    if (e.key !== 'Enter' && e.key !== ' ' && e.key !== 'Tab') e.preventDefault();
  });
  document.body.append(box);
  const at = button.getBoundingClientRect(),
    own = box.getBoundingClientRect();
  box.style.left = `${Math.max(8, Math.min(at.left, innerWidth - own.width - 8))}px`;
  box.style.top = `${at.bottom + own.height + 8 > innerHeight ? Math.max(8, at.top - own.height - 4) : at.bottom + 4}px`;
  button.setAttribute('aria-expanded', 'true');
  addEventListener('pointerdown', outside, true);
  close = gone;
  /** @type {HTMLElement | null} */ (box.querySelector('[role=menuitem]:not([disabled])'))?.focus();
}
