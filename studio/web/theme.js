// Light and dark: as the system has it, unless one is chosen.

import { repaintSmall } from './small.js';
import { readColours } from './stage-view.js';

const KEY = 'kinelm-theme';
const system = matchMedia('(prefers-color-scheme: dark)');

/** @returns {'system' | 'light' | 'dark'} */
export function theme() {
  const chosen = localStorage.getItem(KEY);
  return chosen === 'light' || chosen === 'dark' ? chosen : 'system';
}

/** @param {'system' | 'light' | 'dark'} chosen */
export function setTheme(chosen) {
  localStorage.setItem(KEY, chosen);
  apply();
}

export function apply() {
  const chosen = theme(),
    dark = chosen === 'dark' || (chosen === 'system' && system.matches);
  document.documentElement.classList.toggle('dark', dark);
  readColours();
  repaintSmall();
  dispatchEvent(new Event('repaint'));
}

system.addEventListener('change', apply);
