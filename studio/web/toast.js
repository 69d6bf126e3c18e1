// Short messages, read out too; an action may be offered with one.

import { Refused } from './api.js';
import { find, h, iconButton } from './dom.js';

/** @param {string} text @param {{ kind?: 'note' | 'trouble', action?: { label: string, does: () => void } }} [more] */
export function toast(text, { kind = 'note', action } = {}) {
  const box = h(
    'div',
    { class: `toast ${kind}`, role: kind === 'trouble' ? 'alert' : 'status' },
    h('span', null, text),
  );
  const gone = () => box.remove();
  if (action)
    box.append(
      h(
        'button',
        {
          type: 'button',
          class: 'quiet',
          onclick: () => {
            gone();
            action.does();
          },
        },
        action.label,
      ),
    );
  box.append(iconButton('close', 'Close', gone));
  const all = find('toasts');
  // a note takes the place of the one before, and so does the same again
  for (const other of [...all.children]) {
    if ((kind === 'note' && other.matches('.note')) || other.querySelector('span')?.textContent === text)
      other.remove();
  }
  all.append(box);
  while (all.children.length > 3) all.firstChild?.remove();
  setTimeout(gone, kind === 'trouble' ? 14000 : 7000);
}

// Carries something out; what is refused is said.
/** @template T @param {() => Promise<T>} does @returns {Promise<T | undefined>} */
export async function attempt(does) {
  try {
    return await does();
  } catch (error) {
    // what the studio or the system refuses is no mistake of the page
    if (error instanceof Refused || error instanceof DOMException)
      toast(error.message.charAt(0).toUpperCase() + error.message.slice(1), { kind: 'trouble' });
    else reportError(error);
    return undefined;
  }
}
