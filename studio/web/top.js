// The bar at the top: the project, undo and redo, help and the menu.

import { post } from './api.js';
import { find, h, icon, iconButton } from './dom.js';
import { help, undo } from './keys.js';
import { menu } from './menu.js';
import { on, store } from './store.js';
import { setTheme, theme } from './theme.js';
import { attempt } from './toast.js';

export function openTop() {
  const back = iconButton('undo', 'Undo', () => undo('undo')),
    again = iconButton('redo', 'Redo', () => undo('redo'));
  const more = iconButton(
    'more',
    'Menu',
    () =>
      menu(more, [
        .../** @type {const} */ (['system', 'light', 'dark']).map(of => ({
          label: { system: 'Colours as the system has them', light: 'Light', dark: 'Dark' }[of],
          hint: theme() === of ? 'now' : undefined,
          does: () => setTheme(of),
        })),
        null,
        { label: 'Keys', hint: '?', does: help },
        { label: 'End the studio', hint: 'everything is saved', does: stop },
      ]),
    { 'aria-haspopup': 'menu' },
  );
  find('top-right').append(h('span', { class: 'group' }, back, again), iconButton('help', 'Keys (?)', help), more);
  const line = find('connection');
  on(['undo'], () => {
    const { undo: n, redo: m, undo_name, redo_name } = store.state.undo;
    const says = (
      /** @type {HTMLElement} */ button,
      /** @type {string} */ verb,
      /** @type {string | null} */ name,
      /** @type {string} */ key,
    ) => {
      const text = name ? `${verb}: ${name} (${key})` : `${verb} (${key})`;
      button.title = text;
      button.setAttribute('aria-label', text);
    };
    back.toggleAttribute('disabled', n === 0);
    again.toggleAttribute('disabled', m === 0);
    says(back, 'Undo', undo_name, 'Ctrl Z');
    says(again, 'Redo', redo_name, 'Ctrl Shift Z');
  });
  on(['model'], () => {
    find('project').textContent = store.state.project;
    find('model').textContent = store.state.model.name ? `model: ${store.state.model.name}` : '';
    document.title = store.state.project ? `${store.state.project} · kinelm studio` : 'kinelm studio';
  });
  on(['connection'], () => {
    line.hidden = store.connected || stopped;
    line.textContent = 'The studio doesn’t answer. Trying again … If you have started it anew, open the page that it names.';
  });
}

let stopped = false;
async function stop() {
  if ((await attempt(() => post('/api/stop'))) === undefined) return;
  stopped = true;
  document.body.replaceChildren(
    h(
      'p',
      { class: 'ended', role: 'status' },
      icon('check'),
      'The studio has ended. Everything is saved; this page can be closed.',
    ),
  );
}
