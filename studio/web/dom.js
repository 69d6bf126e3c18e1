// Elements made by script: text stays text, whatever a file is called.

/** @typedef {Node | string | number | null | undefined | false} Kid */

/**
 * An element. Properties that begin with `on` listen, `style` takes pairs, `class`, `role`, `data-*` and `aria-*` are
 * attributes; `false` and `null` leave an attribute out.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag @param {Record<string, any> | null} [props] @param {...(Kid | Kid[])} kids
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, props, ...kids) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props ?? {})) set(element, name, value);
  for (const kid of kids.flat()) {
    if (kid !== null && kid !== undefined && kid !== false) element.append(kid instanceof Node ? kid : String(kid));
  }
  return element;
}

/** @param {HTMLElement} element @param {string} name @param {any} value */
function set(element, name, value) {
  if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
  else if (name === 'style') for (const [key, of] of Object.entries(value)) element.style.setProperty(key, String(of));
  else if (value === true && !name.startsWith('aria-')) element.setAttribute(name, '');
  else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  else if (value === false && name.startsWith('aria-')) element.setAttribute(name, 'false');
}

/** @param {string} id @returns {HTMLElement} */
export function find(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`the page has no #${id}`);
  return element;
}

// 24 x 24, lines of 1.8.
const ICONS = {
  play: 'M8 5.5v13l11-6.5z',
  pause: 'M7 5.5h3.6v13H7zM13.4 5.5H17v13h-3.6z',
  back: 'M15 6l-6 6 6 6',
  on: 'M9 6l6 6-6 6',
  undo: 'M9 7L4.5 11.5 9 16M5 11.5h9a5 5 0 0 1 0 10h-3',
  redo: 'M15 7l4.5 4.5L15 16M19 11.5h-9a5 5 0 0 0 0 10h3',
  more: 'M5 12h.01M12 12h.01M19 12h.01',
  close: 'M6 6l12 12M18 6L6 18',
  check: 'M5 12.5l4.5 4.5L19 7.5',
  plus: 'M12 5v14M5 12h14',
  minus: 'M5 12h14',
  music: 'M9 18V6l10-2v12M9 18a2.5 2.5 0 1 1-5 0 2.5 2.5 0 0 1 5 0zM19 16a2.5 2.5 0 1 1-5 0 2.5 2.5 0 0 1 5 0z',
  upload: 'M12 16V5M7.5 9.5L12 5l4.5 4.5M5 19h14',
  save: 'M12 5v11M7.5 11.5L12 16l4.5-4.5M5 19h14',
  select: 'M6 4l12 8-5.2 1.2L10 19z',
  brush:
    'M19 4.5c-4 2-8 6-9.5 9.5l1.5 1.5c3.5-1.5 7.5-5.5 9.5-9.5zM8.5 14.5c-2.5 0-3 2-3 3.5 0 1-1 1.5-1.5 1.5 3 1.5 7 .5 7-3z',
  pin: 'M12 21v-6M8 4h8l-1 5 3 4H6l3-4z',
  diamond: 'M12 5l6 7-6 7-6-7z',
  cut: 'M6 8.5a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5zM6 20.5a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5zM8 7.5L19 18M8 16.5L19 6',
  magnet: 'M6 4v8a6 6 0 0 0 12 0V4h-4v8a2 2 0 0 1-4 0V4zM6 8h4M14 8h4',
  film: 'M4 6h11v12H4zM15 10.5l5-3v9l-5-3z',
  help: 'M9.2 9.2a2.9 2.9 0 1 1 4.3 2.5c-1 .6-1.5 1.2-1.5 2.3M12 17.5v.01',
  search: 'M10.5 17a6.5 6.5 0 1 0 0-13 6.5 6.5 0 0 0 0 13zM15.5 15.5L20 20',
  loop: 'M17 4l3 3-3 3M4 12V10a3 3 0 0 1 3-3h13M7 20l-3-3 3-3M20 12v2a3 3 0 0 1-3 3H4',
  theme: 'M12 4a8 8 0 1 0 0 16zM12 4a8 8 0 0 1 0 16',
  power: 'M12 4v8M7 7a7 7 0 1 0 10 0',
  home: 'M4.5 11.5L12 5l7.5 6.5M7 9.8V19h10V9.8',
  dice: 'M5 5h14v14H5zM9 9h.01M15 9h.01M12 12h.01M9 15h.01M15 15h.01',
  warn: 'M12 5l8 14H4zM12 10.5v4M12 17v.01',
};

/** @param {keyof typeof ICONS} name */
export function icon(name) {
  const svg = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  const path = document.createElementNS('http://www.w3.org/2000/svg', 'path');
  svg.setAttribute('viewBox', '0 0 24 24');
  svg.setAttribute('aria-hidden', 'true');
  svg.setAttribute('class', `icon ${name}`);
  path.setAttribute('d', ICONS[name]);
  svg.append(path);
  return svg;
}

/**
 * A button with an icon alone; its name is read out and shown as a tip.
 * @param {keyof typeof ICONS} name @param {string} label @param {(e: MouseEvent) => void} click
 * @param {Record<string, any>} [props]
 */
export function iconButton(name, label, click, props) {
  return h(
    'button',
    { type: 'button', class: 'icon-button', title: label, 'aria-label': label, onclick: click, ...props },
    icon(name),
  );
}
