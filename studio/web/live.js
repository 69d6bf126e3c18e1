// The stream of events: keeps the store as the server has it.

import { get } from './api.js';
import { forget, streamed } from './figures.js';
import { isBusy, put, store, tell, ui } from './store.js';

/** @typedef {import('./types.js').State} State */

/** @type {Record<string, (data: any) => void>} */
const EVENTS = {
  clip(clip) {
    // until it is read otherwise it is shown as it was
    if (clip.state !== 'reading') forget(clip.id);
    put(store.state.clips, clip);
    tell('clips', 'cast');
  },
  clip_removed({ id }) {
    forget(id);
    store.state.clips = store.state.clips.filter(clip => clip.id !== id);
    if (ui.clip === id) Object.assign(ui, { clip: null, mode: 'takes' });
    tell('clips', 'cast');
  },
  job(job) {
    const known = store.state.jobs.find(other => other.id === job.id);
    put(store.state.jobs, job);
    if (!known || known.state !== job.state) tell('cast');
    tell('jobs');
  },
  frames(frames) {
    streamed(frames);
    tell('frames');
  },
  dance(dance) {
    const known = store.state.dances.find(other => other.id === dance.id);
    if (!known || known.name !== dance.name) forget(dance.id);
    put(store.state.dances, dance);
    tell('dances', 'cast');
  },
  dance_removed({ id }) {
    forget(id);
    store.state.dances = store.state.dances.filter(dance => dance.id !== id);
    tell('dances', 'cast');
  },
  timeline() {
    loadTimeline();
  },
  undo(undo) {
    store.state.undo = undo;
    tell('undo');
  },
  maps(maps) {
    store.state.maps = maps;
    tell('clips');
  },
  music(music) {
    store.state.music = music;
    tell('music');
  },
};

// Events that come while the state is on its way are kept: those after it are then carried out.
/** @type {{ id: number, name: string, data: any }[] | null} */
let waiting = null;

/** @param {MessageEvent} event @param {string} name */
function happened(event, name) {
  const data = JSON.parse(event.data),
    id = Number(event.lastEventId);
  // what was before the state is in it, but for the frames of dances that aren't made yet
  if (id <= store.state.last_event && name !== 'frames') return;
  if (waiting) waiting.push({ id, name, data });
  else EVENTS[name](data);
}

async function load() {
  if (waiting) return;
  waiting = [];
  try {
    const state = /** @type {State} */ (await get('/api/state'));
    store.state = state;
    store.ready = true;
    const later = waiting.filter(event => event.id > state.last_event);
    waiting = null;
    tell('clips', 'dances', 'jobs', 'undo', 'music', 'model', 'cast', 'connection');
    for (const { name, data } of later) EVENTS[name](data);
    catchUp(state);
    await loadTimeline();
  } catch {
    // the stream tries again, and so does this
    waiting = null;
  }
}

// Frames that were sampled before this page came are sent again from where their job began.
/** @param {State} state */
function catchUp(state) {
  const running = state.jobs
    .filter(isBusy)
    .map(job => job.since)
    .filter(since => since !== null);
  if (!running.length) return;
  stream?.close();
  listen(Math.min(...running));
}

let asked = 0;
export async function loadTimeline() {
  const number = ++asked;
  const timeline = await get('/api/timeline').catch(() => null);
  if (timeline && number === asked) setTimeline(timeline);
}

let known = false;
/** @param {import('./types.js').Timeline} timeline */
export function setTimeline(timeline) {
  // a timeline that begins wants to be seen
  const begins = known && !store.timeline.segments.length && timeline.segments.length > 0;
  if (begins && ui.mode === 'takes') ui.mode = 'timeline';
  known = true;
  store.timeline = timeline;
  if (ui.segment !== null && ui.segment >= timeline.segments.length) ui.segment = null;
  tell('timeline', 'cast');
}

/** @type {EventSource | null} */
let stream = null;

/** @param {number} [since] an event: those after it are sent again */
export function listen(since) {
  stream = new EventSource(since === undefined ? '/api/events' : `/api/events?since=${since}`);
  stream.addEventListener('hello', event => {
    store.connected = true;
    tell('connection');
    const { version, resumed } = JSON.parse(event.data);
    // another program: other assets
    if (store.ready && store.state.version && version !== store.state.version) location.reload();
    else if (!resumed || !store.ready) load();
  });
  for (const name of Object.keys(EVENTS)) stream.addEventListener(name, event => happened(event, name));
  stream.onerror = () => {
    store.connected = false;
    tell('connection');
  };
}
