// What is dragged inside the page: a browser tells what it is only where it is dropped.

const TYPE = 'application/x-kinelm';

/** @typedef {{ kind: 'clip', id: string } | { kind: 'music', id: string } | { kind: 'part', id: string, from: number, to: number }
 *   | { kind: 'label', field: string, value: string }} Dragged */

/** @type {Dragged | null} */
let dragged = null;

export const whatIsDragged = () => dragged;

/** @param {HTMLElement} element @param {() => Dragged} what @param {string} [not] where a drag doesn't begin: a selector */
export function draggable(element, what, not) {
  let from = /** @type {EventTarget | null} */ (null);
  element.draggable = true;
  element.addEventListener('pointerdown', e => {
    from = e.target;
  });
  element.addEventListener('dragstart', e => {
    if (not && from instanceof Element && from.closest(not)) {
      e.preventDefault();
      return;
    }
    dragged = what();
    e.dataTransfer?.setData(TYPE, JSON.stringify(dragged));
    if (e.dataTransfer) e.dataTransfer.effectAllowed = 'copy';
    element.classList.add('dragged');
    document.documentElement.classList.add('dragging-card');
  });
  element.addEventListener('dragend', () => {
    dragged = null;
    element.classList.remove('dragged');
    document.documentElement.classList.remove('dragging-card');
  });
}
