// Small moving figures, on cards: drawn flat, as the graphics card serves few canvases at a time.

import { Dancer, madeBy } from './dancer.js';

const STEP_S = 1 / 24,
  YAW = 0.42;
const still = matchMedia('(prefers-reduced-motion: reduce)');

/** @type {Set<Small>} those that can be seen */
const shown = new Set();
const seen = new IntersectionObserver(entries => {
  for (const { target, isIntersecting } of entries) {
    const one = owners.get(target);
    if (!one) continue;
    if (isIntersecting) shown.add(one);
    else shown.delete(one);
    one.dirty = true;
  }
});
/** @type {WeakMap<Element, Small>} */
const owners = new WeakMap();

let before = 0;
/** @param {number} stamp */
function tick(stamp) {
  requestAnimationFrame(tick);
  if (stamp - before < 1000 * STEP_S) return;
  before = stamp;
  for (const one of shown) one.step(stamp / 1000);
}
requestAnimationFrame(tick);

export function repaintSmall() {
  for (const one of shown) one.dirty = true;
}

export class Small {
  /** @param {string} label what a screen reader says of it */
  constructor(label) {
    this.canvas = document.createElement('canvas');
    this.canvas.className = 'small';
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', label);
    this.paint = '--figure-0';
    /** @type {Dancer | null} */
    this.dancer = null;
    /** @type {number[]} */
    this.order = [];
    this.depths = new Float32Array(0);
    /** @type {number | null} a moment that is asked for, instead of the clock's */
    this.at = null;
    this.from = 0;
    this.upto = Infinity;
    this.dirty = true;
    owners.set(this.canvas, this);
    seen.observe(this.canvas);
  }

  /** @param {string} id @param {import('./figures.js').Loaded} loaded @param {import('./types.js').Make} [make] */
  show(id, loaded, make) {
    if (this.dancer?.loaded === loaded) return;
    this.dancer = new Dancer(id, loaded, '', '');
    const made = make && !this.dancer.made ? madeBy(make) : null;
    if (made) this.dancer.marks(made);
    this.order = this.dancer.bones.map((_, i) => i);
    this.depths = new Float32Array(this.order.length);
    this.dirty = true;
  }

  /** @param {number} now seconds */
  step(now) {
    const { dancer } = this;
    if (!dancer) return;
    dancer.grow();
    const end = Math.min(dancer.lasts, this.upto),
      long = Math.max(0.05, end - this.from + 0.4);
    const time = this.at ?? (still.matches ? (this.from + end) / 2 : this.from + Math.min(now % long, end - this.from));
    if (still.matches && this.at === null && !this.dirty) return;
    this.dirty = false;
    this.draw(dancer, time);
  }

  /** @param {Dancer} dancer @param {number} time */
  draw(dancer, time) {
    const { canvas } = this,
      scale = Math.min(devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * scale),
      height = Math.round(canvas.clientHeight * scale);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const pen = canvas.getContext('2d');
    if (!pen) return;
    const style = getComputedStyle(canvas),
      p = dancer.now;
    const own = style.getPropertyValue(this.paint),
      body = style.getPropertyValue('--body'),
      back = style.getPropertyValue('--card');
    dancer.places(time, p);
    const size = (0.8 * height) / (1.08 * dancer.height),
      c = Math.cos(YAW),
      s = Math.sin(YAW);
    const cx = c * p[0] - s * p[2];
    const x = (/** @type {number} */ i) => width / 2 + size * (c * p[3 * i] - s * p[3 * i + 2] - cx);
    const y = (/** @type {number} */ i) =>
      0.93 * height - size * (p[3 * i + 1] - 0.08 * (s * p[3 * i] + c * p[3 * i + 2] - s * p[0] - c * p[2]));
    const { bones } = dancer;
    bones.forEach(({ a, b }, i) => {
      this.depths[i] = s * (p[3 * a] + p[3 * b]) + c * (p[3 * a + 2] + p[3 * b + 2]);
    });
    this.order.sort((i, j) => this.depths[i] - this.depths[j]);
    pen.clearRect(0, 0, width, height);
    pen.fillStyle = style.getPropertyValue('--edge');
    pen.beginPath();
    pen.ellipse(width / 2, 0.93 * height, 0.26 * height, 0.045 * height, 0, 0, 7);
    pen.fill();
    pen.lineCap = 'round';
    for (const i of this.order) {
      const { a, b, ra, rb } = bones[i],
        wide = size * (ra + rb);
      pen.beginPath();
      pen.moveTo(x(a), y(a));
      pen.lineTo(x(b), y(b));
      // a rim in the card's colour keeps limbs apart
      pen.strokeStyle = back;
      pen.lineWidth = wide + 1.6 * scale;
      pen.stroke();
      pen.strokeStyle = dancer.isGiven(bones[i], a, time) ? body : own;
      pen.lineWidth = wide;
      pen.stroke();
    }
  }

  remove() {
    seen.unobserve(this.canvas);
    shown.delete(this);
    this.canvas.remove();
  }
}
