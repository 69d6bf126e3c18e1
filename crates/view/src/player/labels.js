// The names above the dancers.

import { clamp } from './figure.js';
import { ease } from './stage.js';

export class Labels {
  /** @param {HTMLElement} box @param {import('./stage.js').Stage} stage */
  constructor(box, stage) {
    this.box = box;
    this.stage = stage;
    /** @type {HTMLElement[]} */
    this.all = [];
    /** @type {{ x: number, y: number, seen: boolean }[]} */
    this.at = [];
    /** @type {number[]} */
    this.heights = [];
    this.spot = [0, 0];
    this.top = 10;                                   // pixels at the top that no label reaches
  }

  // One label a figure: its title behind a dot of its colour, a CSS colour, and its note.
  /** @param {(figure: import('./figure.js').Figure, index: number) => string} colour */
  make(colour) {
    const { figures } = this.stage;
    this.all = figures.map((f, i) => {
      const label = document.createElement('div'), title = document.createElement('b'), dot = document.createElement('i');
      label.className = 'label';
      title.append(dot, f.title);
      label.append(title);
      if (f.note) {
        const note = document.createElement('span');
        note.textContent = f.note;
        label.append(note);
      }
      label.style.setProperty('--own', colour(f, i));
      // many stand close together and have the height of the window instead
      label.style.setProperty('--lines', figures.length > 5 ? '5' : '2');
      return label;
    });
    this.at = figures.map(() => ({ x: 0, y: 0, seen: true }));
    this.box.replaceChildren(...this.all);
  }

  // 0 to 1: whether two figures stand on one spot.
  /** @param {number} i @param {number} j */
  close(i, j) {
    const { figures, oneWorld, state } = this.stage;
    return !oneWorld && figures[i].world === figures[j].world ? 1 : ease(state.overlaid);
  }

  /** @param {Float32Array} view @param {number} width @param {number} height */
  place(view, width, height) {
    const { stage, at, all, spot } = this, { figures, highest, unit, state } = stage;
    figures.forEach((f, i) => {
      const [x, z] = f.about(state.time, spot), y = highest + 0.07 * unit;
      const w = view[3] * x + view[7] * y + view[11] * z + view[15];
      at[i].x = (0.5 + 0.5 * (view[0] * x + view[4] * y + view[8] * z + view[12]) / w) * width;
      at[i].y = (0.5 - 0.5 * (view[1] * x + view[5] * y + view[9] * z + view[13]) / w) * height;
      at[i].seen = w > 0 && f.named && f.shows(state.time);
    });
    // side by side a label has the room up to its neighbours; in steps, so that its lines don't break anew all the time
    all.forEach((label, i) => {
      let apart = 340;
      for (let j = 0; j < at.length; j++) if (j !== i && at[j].seen) apart = Math.min(apart, Math.abs(at[j].x - at[i].x) + 340 * this.close(i, j));
      label.style.maxWidth = `${clamp(16 * Math.floor((apart - 8) / 16), 64, 336)}px`;
    });
    for (let i = 0; i < all.length; i++) this.heights[i] = all[i].offsetHeight + 3;
    all.forEach((label, i) => {
      // on one spot the labels stand above each other, the last on top; none leaves the window by its top
      let below = 0, above = 0;
      for (let j = 0; j < i; j++) if (at[j].seen) below += this.heights[j] * this.close(i, j);
      for (let j = i + 1; j < all.length; j++) if (at[j].seen) above += this.heights[j] * this.close(i, j);
      const bottom = Math.max(at[i].y - below, this.top + this.heights[i] + above);
      label.style.display = at[i].seen ? '' : 'none';
      label.style.transform = `translate(${at[i].x.toFixed(1)}px, ${bottom.toFixed(1)}px) translate(-50%, -100%)`;
    });
  }
}
