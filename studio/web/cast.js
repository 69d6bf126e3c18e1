// Who is on the stage, by what the page shows: the dances of a set, two of them, one; a clip; or what the timeline gives.

import { Dancer, Part, madeBy } from './dancer.js';
import { forget, isLost, load, loaded } from './figures.js';
import { clipOf, currentSet, danceOf, nameOf, sourceOf, store, tell, ui } from './store.js';

/** @typedef {import('./types.js').Segment} Segment */

// Colours for dances side by side, and for the clips of a timeline.
export const TAKES = 8,
  CLIPS = 6;

/** @type {Map<string, Dancer>} */
let known = new Map();

// Shows the timeline, or takes again where it is empty.
/** @param {'takes' | 'timeline' | 'clip'} mode */
export function showMode(mode) {
  ui.mode = mode;
  tell('cast');
}

/** @param {string} id */
export function showClip(id) {
  if (isLost(id)) forget(id);
  Object.assign(ui, { mode: 'clip', clip: id });
  tell('cast');
}

/** @param {string | null} id @param {boolean} [solo] */
export function focusOn(id, solo = false) {
  const job = id ? store.state.jobs.find(job => job.dances.includes(id)) : null;
  Object.assign(ui, { focus: id, solo: solo && id !== null, mode: 'takes' });
  if (job) ui.set = job.id;
  tell('cast');
}

// What is there of a figure; the rest is sent for.
/** @param {string} id @param {boolean} complete whether it has a file yet */
function ask(id, complete) {
  const there = loaded(id);
  // one that is being read has its figure afterwards
  if ((!there || there.live) && complete && !isLost(id) && clipOf(id)?.state !== 'reading') {
    load(id).then(
      () => tell('cast', 'frames'),
      () => {},
    );
  }
  return there;
}

/** @returns {Dancer[]} */
export function cast() {
  const before = known;
  known = new Map();
  const mode =
    ui.mode === 'clip' && (clipOf(ui.clip) || danceOf(ui.clip))
      ? 'clip'
      : ui.mode === 'timeline' && store.timeline.segments.some(segment => segment.clip)
        ? 'timeline'
        : currentSet()
          ? 'takes'
          : 'timeline';
  /** @template {Dancer} D @param {string} key @param {import('./figures.js').Loaded} there @param {() => D} make @returns {D} */
  const kept = (key, there, make) => {
    const old = /** @type {D | undefined} */ (before.get(key));
    const one = old?.loaded === there ? old : make();
    known.set(key, one);
    return one;
  };
  if (mode === 'clip') return ofClip(ui.clip ?? '', kept);
  return mode === 'timeline' ? ofTimeline(kept) : ofSet(kept);
}

/**
 * Makes a dancer, or takes the one that is there already.
 * @typedef {<D extends Dancer>(key: string, there: import('./figures.js').Loaded, make: () => D) => D} Keep
 */

/** @param {string} id @param {Keep} kept */
function ofClip(id, kept) {
  const there = ask(id, true);
  if (!there) return [];
  const dancer = kept(`clip ${id}`, there, () => new Dancer(id, there, '', ''));
  dancer.title = nameOf(id);
  dancer.paint = danceOf(id) ? '--take-0' : '--figure-0';
  dancer.original = originalOf(danceOf(id)?.source ?? null, kept);
  return [dancer];
}

// The dances of the set that are on the stage, by id and number.
export function takes() {
  const job = currentSet();
  if (!job) return [];
  const all = job.dances.map((id, n) => ({ id, n })).filter(({ id }) => !danceOf(id)?.rejected);
  return all;
}

export function staged() {
  const all = takes(),
    versus = all.filter(({ id }) => ui.versus.includes(id));
  if (versus.length > 1) return versus;
  const alone = ui.solo ? all.filter(({ id }) => id === ui.focus) : [];
  return alone.length ? alone : all;
}

/** @param {Keep} kept */
function ofSet(kept) {
  const job = currentSet();
  if (!job) return [];
  const dancers = [];
  for (const { id, n } of staged()) {
    const dance = danceOf(id),
      there = ask(id, dance !== undefined);
    if (!there) continue;
    const dancer = kept(`take ${id}`, there, () => {
      const made = madeBy(job.make),
        one = new Dancer(id, there, '', '');
      if (made && !one.made) one.marks(made);
      return one;
    });
    dancer.title = job.dances.length > 1 ? String(n + 1) : (dance?.name ?? 'A new dance');
    dancer.note = dance?.kept ? 'kept' : '';
    dancer.paint = `--take-${n % TAKES}`;
    if (job.kind === 'free') dancer.made = null;
    const source = dance?.source ?? sourceOf(job);
    dancer.original = originalOf(source, kept, job.kind === 'timeline');
    // dances of one source share its path
    dancer.world = source ? 1 : 100 + n;
    dancers.push(dancer);
  }
  // until the first frame comes one sees what they are made from
  const source = sourceOf(job),
    there = dancers.length === 0 && source ? ask(source, true) : null;
  if (source && there) {
    const dancer = kept(`clip ${source}`, there, () => new Dancer(source, there, '', ''));
    dancer.title = nameOf(source);
    dancer.paint = '--body';
    dancers.push(dancer);
  }
  return dancers;
}

// What a dance was made from, as a ghost; of a timeline, the clip where its first segment has it.
/** @param {string | null} source @param {Keep} kept */
function originalOf(source, kept, placed = false) {
  const there = source ? ask(source, true) : null;
  if (!source || !there) return null;
  const segment = placed ? store.timeline.segments.find(segment => clipIdOf(segment) === source) : undefined;
  const key = `ghost ${source} ${segment ? segment.from - segment.at : ''}`;
  const ghost = kept(key, there, () =>
    segment ? new Part(source, there, '', wholeOf(segment)) : new Dancer(source, there, '', ''),
  );
  ghost.paint = '--ghost';
  return ghost;
}

/** @param {Segment} segment @returns {Segment} the whole clip where a segment has a part of it */
const wholeOf = segment => ({
  ...segment,
  from: segment.from - segment.at,
  to: segment.from - segment.at + 3600,
  at: 0,
  joints: null,
  given: undefined,
});

/** @param {Segment} segment */
export const clipIdOf = segment => (segment.clip ? (store.timeline.clips[segment.clip]?.clip ?? null) : null);

// What a segment's clip is called in the library.
/** @param {Segment} segment */
export function nameIn(segment) {
  const id = clipIdOf(segment);
  return id ? nameOf(id) : (segment.clip ?? '');
}

// The colour of a clip of the timeline.
/** @param {string | null} name */
export const clipPaint = name =>
  `--figure-${Math.max(0, Object.keys(store.timeline.clips).indexOf(name ?? '')) % CLIPS}`;

/** @param {Keep} kept */
function ofTimeline(kept) {
  const parts = [];
  for (const segment of store.timeline.segments) {
    const id = clipIdOf(segment),
      there = id ? ask(id, true) : null;
    if (!id || !there) continue;
    const part = kept(`part ${JSON.stringify(segment)}`, there, () => new Part(id, there, '', segment));
    part.title = nameOf(id);
    part.paint = clipPaint(segment.clip);
    part.original = part.isWhole ? null : originalOf(id, kept, true);
    part.world = 1;
    // one name for the parts of one body
    part.named =
      part.isWhole || !parts.some(other => other.id === id && other.from < part.upto && other.upto > part.from);
    parts.push(part);
  }
  return parts;
}
