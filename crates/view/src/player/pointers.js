// Mouse, pen and touch on the stage: orbit, pan, zoom, and a click.

import { clamp } from './figure.js';

const CLICK = 5;                                     // pixels that a click may move

/**
 * @param {HTMLCanvasElement} canvas @param {import('./stage.js').Stage} stage
 * @param {(x: number, y: number, event: PointerEvent) => void} [click] where, in pixels of the canvas
 */
export function listenToPointers(canvas, stage, click) {
  /** @type {Map<number, number[]>} */
  const down = new Map();                            // pointer -> [x, y]
  let way = 0;
  canvas.addEventListener('pointerdown', e => {
    down.set(e.pointerId, [e.clientX, e.clientY]);
    way = down.size > 1 ? Infinity : 0;
    try { canvas.setPointerCapture(e.pointerId); } catch { /* a pointer that is gone already, or one of the self-test */ }
    canvas.classList.add('dragging');
  });
  canvas.addEventListener('pointermove', e => {
    const was = down.get(e.pointerId);
    if (!was) return;
    const dx = e.clientX - was[0], dy = e.clientY - was[1];
    const other = [...down].find(([id]) => id !== e.pointerId);
    way += Math.hypot(dx, dy);
    if (other) {
      const apart = (/** @type {number[]} */ p) => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) + 1;
      stage.zoom(apart(was) / apart([e.clientX, e.clientY]));
      stage.pan(dx / 2, dy / 2, canvas.clientHeight);
    } else if (e.shiftKey || e.buttons & 6) {
      stage.pan(dx, dy, canvas.clientHeight);
    } else if (!click || way > CLICK) {
      stage.orbit(dx, dy);
    }
    down.set(e.pointerId, [e.clientX, e.clientY]);
  });
  /** @param {PointerEvent} e */
  const up = e => {
    if (!down.delete(e.pointerId)) return;
    canvas.classList.toggle('dragging', down.size > 0);
    if (click && way <= CLICK && e.type === 'pointerup' && e.button === 0) click(e.offsetX, e.offsetY, e);
  };
  canvas.addEventListener('pointerup', up);
  canvas.addEventListener('pointercancel', up);
  canvas.addEventListener('contextmenu', e => e.preventDefault());
  canvas.addEventListener('dblclick', () => stage.resetView());
  canvas.addEventListener('wheel', e => {
    e.preventDefault();
    stage.zoom(Math.exp(clamp(e.deltaY * (e.deltaMode ? 20 : 1), -200, 200) * 0.0012));
  }, { passive: false });
}
