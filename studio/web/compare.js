// Two cards compared: the first is the teacher, the second the student, who is chosen in a dialog.

import { post } from './api.js';
import { showClip } from './cast.js';
import { h } from './dom.js';
import { clock } from './format.js';
import { stage } from './stage-view.js';
import { keptDances, motionClips } from './store.js';
import { attempt } from './toast.js';

/** @param {string} id @param {string} name of the teacher */
export function compareWith(id, name) {
  const others = [...keptDances(), ...motionClips()].filter(other => other.id !== id);
  const dialog = h('dialog', { class: 'ask', 'aria-label': `Compare with ${name}` });
  const student = h('select', { 'aria-label': 'Student' }, ...others.map(other => h('option', { value: other.id }, other.name)));
  const figures = h('div', { class: 'compared', 'aria-live': 'polite' });
  const page = h('a', { class: 'strong', hidden: true, download: '' }, 'Save the page');
  const go = h('button', { type: 'button', class: 'strong', disabled: !others.length, onclick: () => compare() }, 'Compare');
  const jump = (/** @type {number} */ at) => {
    dialog.close();
    showClip(id);
    stage.seek(at);
  };
  async function compare() {
    const chosen = student.value;
    go.disabled = true;
    const answer = await attempt(() => post('/api/compare', { teacher: id, student: chosen }));
    go.disabled = false;
    if (!answer || chosen !== student.value) return;
    figures.replaceChildren(
      h('table', null, ...answer.facts.map((/** @type {string[]} */ [of, value]) => h('tr', null, h('th', { scope: 'row' }, of), h('td', null, value)))),
      ...answer.moments.map((/** @type {{ at_s: number, says: string }} */ { at_s, says }) =>
        h('button', { type: 'button', class: 'quiet', onclick: () => jump(at_s) }, `${clock(at_s)} ${says}`),
      ),
    );
    page.href = `/api/compare/${id}/${chosen}`;
    page.hidden = false;
  }
  student.onchange = () => {
    figures.replaceChildren();
    page.hidden = true;
  };
  dialog.append(
    h('label', null, `Student, beside ${name}`, student),
    figures,
    h('div', { class: 'row end' }, h('button', { type: 'button', class: 'quiet', onclick: () => dialog.close() }, 'Close'), page, go),
  );
  document.body.append(dialog);
  dialog.addEventListener('close', () => dialog.remove());
  dialog.showModal();
}
