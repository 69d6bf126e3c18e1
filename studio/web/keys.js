// The keyboard: what each key does, and the sheet that says so.

import { post } from './api.js';
import { cut, clearSelection, freeSelected, giveSelected, keyPose, markRange, removeSegment } from './edits.js';
import { h, iconButton } from './dom.js';
import { makeNow } from './make-form.js';
import { stage } from './stage-view.js';
import { tell, ui } from './store.js';
import { cancel, choose, chooseNext, compare, goBack, keep, reject } from './takes.js';
import { playOnly } from './ruler.js';
import { setTool, toggleSnap } from './timeline.js';
import { attempt, toast } from './toast.js';
import { mute, playOrPause, speedBy, step, toggle } from './transport.js';

// One after the other, as they were pressed. The server knows if there is a step: the page's own count lags behind the change
// that it has just seen.
let undone = Promise.resolve();

/** @param {'undo' | 'redo'} which */
export function undo(which) {
  undone = undone.then(async () => {
    const now = await attempt(() => post(`/api/${which}`));
    if (!now) return;
    // what was just undone is now the first to redo
    const name = which === 'undo' ? now.redo_name : now.undo_name;
    toast(`${which === 'undo' ? 'Undone' : 'Done again'}: ${name}.`);
  });
  return undone;
}

// Escape leaves what is nearest: a job, a comparison, one alone, a selection.
function leave() {
  if (cancel()) return;
  if (ui.versus.length || ui.solo) Object.assign(ui, { versus: [], solo: false });
  else if (ui.joints.size || ui.range || ui.segment !== null) clearSelection();
  else ui.focus = null;
  tell('cast', 'selection');
}

/** @typedef {[keys: string, does: string, act: (e: KeyboardEvent) => unknown]} Key */

/** @type {[string, Key[]][]} */
const SHEET = [
  [
    'Playing',
    [
      ['Space', 'play or pause', playOrPause],
      ['ArrowLeft', 'a frame back', () => step(-1)],
      ['ArrowRight', 'a frame on', () => step(1)],
      ['Shift+ArrowLeft', 'a second back', () => stage.seek(stage.state.time - 1)],
      ['Shift+ArrowRight', 'a second on', () => stage.seek(stage.state.time + 1)],
      ['Home', 'to the beginning', () => stage.seek(stage.begin)],
      ['End', 'to the end', () => stage.seek(stage.end)],
      ['[', 'slower', () => speedBy(-1)],
      [']', 'faster', () => speedBy(1)],
      ['L', 'loop', () => toggle('loop')],
      ['M', 'sound', mute],
    ],
  ],
  [
    'The stage',
    [
      ['O', 'overlay', () => toggle('overlay')],
      ['G', 'ghost of the original', () => toggle('ghost')],
      ['T', 'trails', () => toggle('trails')],
      ['N', 'contacts with the floor', () => toggle('contacts')],
      ['P', 'in place', () => toggle('inPlace')],
      ['B', 'meshes of characters, or capsules', () => toggle('mesh')],
      ['C', 'the camera follows', () => toggle('follow')],
      ['F', 'the camera as it was', () => stage.resetView()],
    ],
  ],
  [
    'Choosing',
    [
      ['1', 'variation 1 to 8; once more: it alone', () => choose(1)],
      ['Enter', 'keep the chosen one', () => keep(ui.focus)],
      [
        'X',
        'reject it, or cut the timeline',
        () => (ui.focus && ui.mode === 'takes' && ui.segment === null ? reject(ui.focus) : cut()),
      ],
      ['V', 'compare it with another', () => compare(ui.focus)],
      [',', 'the set before', () => goBack(-1)],
      ['.', 'the set after', () => goBack(1)],
      ['J', 'the next variation', () => chooseNext(1)],
      ['Shift+J', 'the variation before', () => chooseNext(-1)],
    ],
  ],
  [
    'The timeline',
    [
      ['A', 'select', () => setTool('select')],
      ['R', 'paint: make anew', () => setTool('free')],
      ['E', 'paint: give', () => setTool('give')],
      ['I', 'the selection begins here', () => markRange('from')],
      ['U', 'the selection ends here', () => markRange('to')],
      ['Shift+R', 'make the selection anew', freeSelected],
      ['Shift+E', 'give the selection', giveSelected],
      ['K', 'key pose at the playhead', keyPose],
      ['Delete', 'remove the selected block', removeSegment],
      ['Q', 'snap', toggleSnap],
      ['Shift+L', 'loop the selected time', () => playOnly(ui.range ?? null)],
    ],
  ],
  [
    'All',
    [
      ['Ctrl+Enter', 'make', makeNow],
      ['Escape', 'cancel; leave the selection', leave],
      ['Ctrl+Z', 'undo', () => undo('undo')],
      ['Ctrl+Shift+Z', 'redo', () => undo('redo')],
      ['?', 'this sheet', () => help()],
    ],
  ],
];

/** @type {Map<string, (e: KeyboardEvent) => unknown>} */
const acts = new Map(SHEET.flatMap(([, keys]) => keys.map(([key, , act]) => /** @type {const} */ ([key, act]))));
for (let n = 2; n <= 8; n++) acts.set(String(n), () => choose(n));
acts.set('Backspace', () => removeSegment());
acts.set('Ctrl+Y', () => undo('redo'));

/** @param {KeyboardEvent} e */
function nameOf(e) {
  const key = e.key === ' ' ? 'Space' : e.key.length === 1 ? e.key.toUpperCase() : e.key;
  const isSign = e.key.length === 1 && !/[a-z]/i.test(e.key);
  return `${e.ctrlKey || e.metaKey ? 'Ctrl+' : ''}${e.altKey ? 'Alt+' : ''}${e.shiftKey && !isSign ? 'Shift+' : ''}${key}`;
}

/** @param {KeyboardEvent} e */
function pressed(e) {
  const name = nameOf(e),
    act = acts.get(name),
    target = e.target instanceof HTMLElement ? e.target : document.body;
  if (!act || e.defaultPrevented || document.querySelector('dialog[open]')) return;
  const writes = target.matches('input:not([type=checkbox]), textarea, select'),
    isGlobal = name.startsWith('Ctrl+');
  // fields keep their own keys, undo too
  if (writes && name !== 'Ctrl+Enter' && name !== 'Escape') return;
  // a button is pressed by these itself; on a variation, space plays all the same
  if (
    (name === 'Enter' || name === 'Space') &&
    target.matches('button, a, summary, [role=button]') &&
    !(name === 'Space' && target.matches('.choose'))
  )
    return;
  if (writes && name === 'Escape') {
    target.blur();
    return;
  }
  if (!isGlobal && target.closest('[role=menu]')) return;
  e.preventDefault();
  act(e);
}

/** @type {Record<string, string>} */
const SHOWN = { ArrowLeft: '←', ArrowRight: '→', Escape: 'Esc', 1: '1 … 8' };

export function help() {
  const keys = (/** @type {string} */ name) => name.split('+').map(part => h('kbd', null, SHOWN[part] ?? part));
  const dialog = h(
    'dialog',
    { class: 'sheet', 'aria-label': 'Keys' },
    h(
      'header',
      null,
      h('h2', null, 'Keys'),
      iconButton('close', 'Close', () => dialog.close()),
    ),
    h(
      'div',
      { class: 'columns' },
      ...SHEET.map(([title, all]) =>
        h(
          'section',
          null,
          h('h3', null, title),
          h('dl', null, ...all.flatMap(([name, does]) => [h('dt', null, ...keys(name)), h('dd', null, does)])),
        ),
      ),
    ),
    h(
      'p',
      { class: 'quiet' },
      'On the stage: drag to orbit, wheel to zoom, right drag to move. Press a limb to select it, with Shift more of them, with Ctrl one joint.',
    ),
  );
  dialog.addEventListener('close', () => dialog.remove());
  dialog.addEventListener('click', e => {
    if (e.target === dialog) dialog.close();
  });
  document.body.append(dialog);
  dialog.showModal();
}

export function openKeys() {
  document.addEventListener('keydown', pressed);
}
