// Events: keep the store as the server has it.

import { get } from './api.js';
import { forget, streamed } from './figures.js';
import { isBusy, put, store, tell, ui } from './store.js';
import { listenTo } from './stream.js';

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
/** @type {import('./events.js').Happening[] | null} */
let waiting = null;
let isStale = false;

/** @param {import('./events.js').Happening} happening */
function happened({ name, id, data }) {
  if (name === 'hello') greeted(data);
  else if (name === 'lost') {
    store.connected = false;
    tell('connection');
  } else if (waiting) waiting.push({ name, id, data });
  // what was before the state is in it
  else if (id > store.state.last_event) EVENTS[name](data);
}

/** @param {{ version: string, resumed: boolean }} hello */
function greeted({ version, resumed }) {
  store.connected = true;
  tell('connection');
  // another program: other assets
  if (store.ready && store.state.version && version !== store.state.version) location.reload();
  else if (!resumed || !store.ready) load();
}

async function load() {
  // more was missed meanwhile
  if (waiting) {
    isStale = true;
    return;
  }
  waiting = [];
  const state = /** @type {State | null} */ (await get('/api/state').catch(() => null)),
    sampled = state && (await sampledBefore(state));
  const later = waiting;
  waiting = null;
  if (!state || !sampled || isStale) {
    isStale = false;
    setTimeout(load, state ? 0 : 1000);
    return;
  }
  store.state = state;
  store.ready = true;
  tell('clips', 'dances', 'jobs', 'undo', 'music', 'model', 'cast', 'connection');
  for (const { data } of sampled.events) EVENTS.frames(data);
  for (const { name, id, data } of later)
    if (id > (name === 'frames' ? sampled.last : state.last_event)) EVENTS[name](data);
  await loadTimeline();
}

// Frames that were sampled before this page came, since the first job that runs began.
/** @param {State} state @returns {Promise<{ last: number, events: { id: number, data: any }[] }>} */
async function sampledBefore(state) {
  const none = { last: state.last_event, events: [] };
  const since = state.jobs.filter(isBusy).flatMap(job => job.since ?? []);
  return since.length ? get(`/api/frames?since=${Math.min(...since)}`).catch(() => none) : none;
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

export const listen = () => listenTo(happened);
