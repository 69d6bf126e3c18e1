// What the page knows: the server's state, and what is chosen here. Views listen to topics and draw themselves again.

/** @typedef {import('./types.js').State} State */

/** @type {State} */
const NOTHING = {
  version: '',
  project: '',
  model: { name: '', fps: 20, new_fps: 0, labels: {}, joints: [], groups: [], paths: false },
  clips: [],
  dances: [],
  jobs: [],
  music: null,
  undo: { undo: 0, redo: 0, undo_name: null, redo_name: null },
  search_s: 2,
  maps: [],
  last_event: 0,
};

/** @type {import('./types.js').Timeline} */
const EMPTY = {
  text: '',
  seconds: 0,
  fps: null,
  rig: null,
  transition: 1,
  clips: {},
  segments: [],
  rows: [],
  trouble: [],
  notes: [],
};

export const store = {
  state: NOTHING,
  timeline: EMPTY,
  connected: true,
  ready: false,
};

/**
 * What is chosen on this page.
 * mode: what the stage shows. takes: the dances of a job, `set` which. focus: the chosen one. solo: it alone.
 * joints: names of groups and joints. range: seconds.
 */
export const ui = {
  mode: /** @type {'takes' | 'timeline' | 'clip'} */ ('takes'),
  set: /** @type {string | null} */ (null),
  focus: /** @type {string | null} */ (null),
  solo: false,
  versus: /** @type {string[]} */ ([]),
  clip: /** @type {string | null} */ (null),
  joints: /** @type {Set<string>} */ (new Set()),
  range: /** @type {[number, number] | null} */ (null),
  segment: /** @type {number | null} */ (null),
  tool: /** @type {'select' | 'free' | 'give'} */ ('select'),
  giver: /** @type {string | null} */ (null),
  snap: true,
  open: /** @type {Set<string>} */ (new Set()),
};

/**
 * @typedef {'clips' | 'dances' | 'jobs' | 'timeline' | 'undo' | 'music' | 'model' | 'cast' | 'selection' | 'tool' | 'frames'
 *   | 'connection' | 'meshes'} Topic
 */

/** @type {Map<Topic, (() => void)[]>} */
const listeners = new Map();
/** @type {Set<Topic>} */
const changed = new Set();

/** @param {Topic[]} topics @param {() => void} does */
export function on(topics, does) {
  for (const topic of topics) listeners.set(topic, [...(listeners.get(topic) ?? []), does]);
}

// Several changes of one moment are one: each listener is called once.
/** @param {...Topic} topics */
export function tell(...topics) {
  if (changed.size === 0) queueMicrotask(flush);
  for (const topic of topics) changed.add(topic);
}

function flush() {
  const all = new Set([...changed].flatMap(topic => listeners.get(topic) ?? []));
  changed.clear();
  for (const does of all) {
    // a view that fails leaves the others as they are
    try {
      does();
    } catch (error) {
      reportError(error);
    }
  }
}

// ---- looking things up ----
/** @param {string | null | undefined} id */
export const clipOf = id => store.state.clips.find(clip => clip.id === id);
/** @param {string | null | undefined} id */
export const danceOf = id => store.state.dances.find(dance => dance.id === id);
/** @param {string | null | undefined} id */
export const jobOf = id => store.state.jobs.find(job => job.id === id);
/** @param {string} id */
export const nameOf = id => clipOf(id)?.name ?? danceOf(id)?.name ?? id;
// The clip whose file has the mesh of a clip or dance; null without one. A dance is on the rig of what it was made from.
/** @param {string} id */
export function characterOf(id) {
  let at = /** @type {string | null} */ (id);
  for (let dance = danceOf(at); dance; dance = danceOf(at)) at = dance.rig ?? dance.source;
  return clipOf(at)?.character ? at : null;
}
export const keptDances = () => store.state.dances.filter(dance => dance.kept && !dance.rejected);
export const motionClips = () => store.state.clips.filter(clip => clip.state === 'ready' && !clip.music);

// The jobs whose dances can be looked at, the earliest first.
export function sets() {
  const shown = store.state.jobs.filter(
    job => job.state !== 'failed' && job.dances.some(id => danceOf(id) || job.state === 'running'),
  );
  return shown.sort((a, b) => a.started - b.started);
}

// The set on show: the chosen one, else the latest.
export function currentSet() {
  const all = sets();
  return all.find(job => job.id === ui.set) ?? all[all.length - 1];
}

// How long the dances of a set are, or will be.
/** @param {import('./types.js').Job | undefined} job */
export function secondsOf(job) {
  if (!job) return 0;
  const there = Math.max(0, ...job.dances.map(id => danceOf(id)?.seconds ?? 0));
  if (there || job.kind === 'timeline') return there || store.timeline.seconds;
  if (job.kind === 'free') return job.make.seconds ?? 8;
  return job.make.seconds ?? (clipOf(job.make.clip) ?? danceOf(job.make.clip))?.seconds ?? 0;
}

// The seed of a dance as one can say it: that of its job.
/** @param {import('./types.js').Dance} dance */
export function seedOf(dance) {
  const seed = jobOf(dance.job)?.make.seed;
  if (seed === undefined) return dance.seed < 1e7 ? `seed ${dance.seed}` : '';
  return `seed ${seed}`;
}

// What a job's dances are made from; a clip that only lends its rig isn't that.
/** @param {import('./types.js').Job} job */
export const sourceOf = job => (job.kind === 'free' ? null : (job.make.clip ?? null));

export const isBusy = (/** @type {import('./types.js').Job | undefined} */ job) =>
  job?.state === 'running' || job?.state === 'waiting';

/** @template {{ id: string }} T @param {T[]} all @param {T} one */
export function put(all, one) {
  const at = all.findIndex(other => other.id === one.id);
  if (at < 0) all.push(one);
  else all[at] = one;
}
