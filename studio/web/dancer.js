// A dancer of the studio: a figure that knows what of it is made, and may dance a part of a clip at another time.

import { Figure } from './figure.js';
import { idsOf, spanOf } from './groups.js';
import { store } from './store.js';

/** @typedef {import('./figures.js').Loaded} Loaded */

// Joints by SMPL id, and those that they hang on.
const ENDS = [
  [22, 20],
  [23, 21],
  [10, 7],
  [11, 8],
  [15, 12],
  [6, 3],
];

export class Dancer extends Figure {
  /** @param {string} id of the clip or dance @param {Loaded} loaded @param {string} title @param {string} note */
  constructor(id, loaded, title, note) {
    super({ ...loaded.head, title, note, frames: 0 }, loaded.numbers);
    this.id = id;
    this.loaded = loaded;
    this.joints = loaded.head.joints ?? [];
    this.top = loaded.top;
    this.isPart = false;
    this.paint = '--figure-0'; // the name of its colour
    /** @type {import('./character.js').Character | null} whose mesh it wears */
    this.character = null;
    /** @type {number[][][] | null} (points) when each joint is made; null: as a whole, throughout */
    this.made = null;
    const contacts = loaded.head.contacts;
    if (contacts?.length) {
      const standing = /** @type {number[][][]} */ (Array.from({ length: this.points }, () => []));
      for (const { point, spans } of contacts) standing[point] = spans;
      this.contacts = standing;
    }
    if (loaded.head.made?.length) {
      const made = /** @type {number[][][]} */ (Array.from({ length: this.points }, () => []));
      for (const { points, from, to } of loaded.head.made) for (const point of points) made[point].push([from, to]);
      this.made = this.withEnds(made);
    }
    this.grow();
  }

  // Takes up the frames that came since.
  grow() {
    this.numbers = this.loaded.numbers;
    this.frames = Math.max(1, this.loaded.frames);
    this.top = this.loaded.top;
  }

  highest() {
    return 0; // the worker that decoded it has looked
  }

  /** @param {import('./figure.js').Bone | import('./figure.js').Ball} _part @param {number} joint @param {number} time */
  isGiven(_part, joint, time) {
    if (!this.made) return false;
    for (const span of this.made[joint]) if (time >= span[0] && time < span[1]) return false;
    return true;
  }

  // What of it is made: joints by SMPL id, and when.
  /** @param {{ joints: Iterable<number>, from: number, to: number }[]} spans */
  marks(spans) {
    const made = /** @type {number[][][]} */ (Array.from({ length: this.points }, () => []));
    for (const { joints, from, to } of spans) {
      const ids = new Set(joints);
      this.joints.forEach((joint, point) => {
        if (joint?.smpl !== undefined && ids.has(joint.smpl)) made[point].push([from, to]);
      });
    }
    this.made = this.withEnds(made);
  }

  // Joints that a model may not know go with those before them.
  /** @param {number[][][]} made */
  withEnds(made) {
    for (const [end, before] of ENDS) {
      const from = this.joints.findIndex(joint => joint?.smpl === before);
      this.joints.forEach((joint, point) => {
        if (joint?.smpl === end && !made[point].length && from >= 0) made[point] = made[from];
      });
    }
    return made;
  }
}

// The part of a clip that a segment of the timeline gives, at its time in the dance.
export class Part extends Dancer {
  /** @param {string} id @param {Loaded} loaded @param {string} title @param {import('./types.js').Segment} segment */
  constructor(id, loaded, title, segment) {
    super(id, loaded, title, '');
    this.isPart = true;
    /** @type {number[][][] | null} */
    this.made = null; // in the timeline it is given, however it was made
    const [from, to] = segment.given ?? [segment.from, segment.to];
    this.from = from;
    this.upto = to;
    this.offset = segment.at - segment.from;
    this.turn = segment.place?.turn_rad ?? 0;
    this.move = [segment.place?.x ?? 0, segment.place?.z ?? 0];
    const ids = idsOf(segment.joints ?? 'all');
    this.isWhole = ids.size >= 24;
    this.has = (/** @type {number} */ point) => this.isWhole || ids.has(this.joints[point]?.smpl ?? -1);
    if (!this.isWhole && this.joints.length) {
      this.bones = this.bones.filter(bone => this.has(bone.a));
      this.balls = this.balls.filter(ball => this.has(ball.at));
    }
  }

  get lasts() {
    return this.upto;
  }

  /** @param {import('./figure.js').Bone} bone */
  covers(bone) {
    return this.has(bone.a);
  }

  /** @param {number} time */
  shows(time) {
    return time >= this.from && time <= this.upto;
  }

  /** @param {number} time @param {Float32Array} out @param {number} [from] @param {number} [upto] */
  places(time, out, from = 0, upto = this.points) {
    super.places(Math.min(Math.max(time, this.from), this.upto) + this.offset, out, from, upto);
    const c = Math.cos(this.turn),
      s = Math.sin(this.turn),
      [mx, mz] = this.move;
    for (let i = 0; i < (upto - from) * 3; i += 3) {
      const x = out[i],
        z = out[i + 2];
      out[i] = c * x + s * z + mx;
      out[i + 2] = c * z - s * x + mz;
    }
  }
}

// What a job makes, as long as its dances can't say it themselves; null: everything.
/** @param {import('./types.js').Make} make */
export function madeBy(make) {
  const all = idsOf('all');
  if (make.kind === 'edit') return (make.free ?? []).map(spanOf).map(span => ({ ...span, joints: idsOf(span.joints) }));
  if (make.kind === 'given') {
    const given = idsOf(make.joints ?? '');
    return [{ joints: [...all].filter(id => !given.has(id)), from: 0, to: Infinity }];
  }
  if (make.kind === 'timeline') {
    return store.timeline.rows.flatMap(row =>
      row.joints.flatMap(joint =>
        joint.spans
          .filter(span => span.state === 'generated')
          .map(({ from, to }) => ({ joints: idsOf(joint.name), from, to })),
      ),
    );
  }
  return null;
}
