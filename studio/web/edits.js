// What is done to the timeline: from the pane, by keys, and by dropping.

import { change, putAt } from './card.js';
import { clipIdOf } from './cast.js';
import { simplest } from './groups.js';
import { danceShown } from './rows.js';
import { selectedJoints, stage } from './stage-view.js';
import { clipOf, danceOf, motionClips, nameOf, store, tell, ui } from './store.js';
import { frameTime, snapped } from './timeline-view.js';
import { toast } from './toast.js';

const POSE_S = 0.1; // a key pose: two frames of a model at 20 a second

// The segment that has a clip at a time, or the nearest.
/** @param {string | null} clip an id; null: any @param {number} time */
function nearest(clip, time) {
  const all = store.timeline.segments.filter(segment => segment.clip && (!clip || clipIdOf(segment) === clip));
  const away = (/** @type {import('./types.js').Segment} */ s) => Math.max(0, s.from - time, time - s.to);
  return all.reduce(
    (/** @type {import('./types.js').Segment | null} */ best, s) => (best && away(best) <= away(s) ? best : s),
    null,
  );
}

// The clip that joints are given from: the chosen one, else the one that is nearest.
/** @param {number} time */
export function giver(time) {
  if (ui.giver && (clipOf(ui.giver) || danceOf(ui.giver))) return ui.giver;
  const segment = nearest(null, time);
  return segment ? clipIdOf(segment) : (motionClips()[0]?.id ?? null);
}

// With an empty timeline, the dance on show begins one: it is kept for that.
function begun() {
  if (store.timeline.segments.length) return [];
  const dance = danceShown();
  return dance ? [{ op: 'use_clip', id: dance.id }] : null;
}

/** @param {string} joints @param {number} from @param {number} to */
export async function free(joints, from, to) {
  const first = begun();
  if (!first) {
    toast('The timeline is empty: drop a clip on it first.');
    return;
  }
  if (await change(...first, { op: 'free', joints, from, to })) shown();
  if (first.length) toast(`${nameOf(first[0].id)} is kept, and the timeline begins with it.`);
}

/** @param {string} joints @param {number} from @param {number} to */
export async function give(joints, from, to) {
  const clip = giver(from),
    first = begun();
  if (!clip || first?.length !== 0) {
    toast('There is nothing to give yet: drop a clip on the timeline first.');
    return;
  }
  const segment = nearest(clip, from),
    offset = segment ? segment.at - segment.from : -from;
  const seconds = (clipOf(clip) ?? danceOf(clip))?.seconds ?? Infinity;
  // what the clip has of this time
  const begin = Math.max(from, -offset),
    end = Math.min(to, seconds - offset);
  if (end - begin < 0.5 * frameTime()) {
    toast('The clip has nothing at this time.');
    return;
  }
  if (await change({ op: 'give', clip, joints, from: begin, to: end, at: begin + offset })) shown();
}

function shown() {
  if (ui.mode === 'clip') ui.mode = 'timeline';
  tell('cast');
}

// What is selected, or the time at the playhead.
function chosenTime() {
  return (
    ui.range ??
    /** @type {[number, number]} */ ([
      stage.state.time,
      Math.min(stage.state.time + 2, Math.max(stage.whole, store.timeline.seconds)),
    ])
  );
}

export const freeSelected = () => free(simplest(selectedJoints().split(',')).join(','), ...chosenTime());
export const giveSelected = () => give(simplest(selectedJoints().split(',')).join(','), ...chosenTime());

export function keyPose() {
  const from = snapped(stage.state.time);
  return give(simplest(selectedJoints().split(',')).join(','), from, from + Math.max(POSE_S, 2 * frameTime()));
}

/** @param {'from' | 'to'} side */
export function markRange(side) {
  const { time } = stage.state,
    [from, to] = ui.range ?? [0, Math.max(stage.whole, store.timeline.seconds)];
  ui.range =
    side === 'from'
      ? [time, Math.max(to, time + frameTime())]
      : [Math.min(from, Math.max(0, time - frameTime())), time];
  tell('selection');
}

export function clearSelection() {
  ui.joints.clear();
  Object.assign(ui, { range: null, segment: null });
  tell('selection', 'cast');
}

export const chosenSegment = () => store.timeline.segments.find(segment => segment.index === ui.segment);

export async function cut() {
  const { time } = stage.state,
    inside = (/** @type {import('./types.js').Segment} */ s) => time > s.from && time < s.to;
  const own = chosenSegment(),
    segment = own && inside(own) ? own : store.timeline.segments.find(inside);
  if (segment) await change({ op: 'split', index: segment.index, at: snapped(time) });
  else toast('There is nothing to cut at the playhead.');
}

export async function removeSegment() {
  const segment = chosenSegment();
  if (!segment) return false;
  ui.segment = null;
  await change({ op: 'remove', index: segment.index });
  tell('selection');
  return true;
}

/** @param {number} index @param {{ from: number, to: number, at: number }} to */
export function moveSegment(index, to) {
  const segment = store.timeline.segments.find(segment => segment.index === index);
  if (!segment) return;
  const keys = /** @type {('from' | 'to' | 'at')[]} */ (['from', 'to', 'at']).filter(
    key => Math.abs(segment[key] - to[key]) > 1e-6,
  );
  const tidy = (/** @type {number} */ s) => Number(s.toFixed(4));
  // a time that grows sets its end first, so that no step is empty
  if (to.from > segment.from) keys.sort((a, b) => Number(b === 'to') - Number(a === 'to'));
  if (keys.length) change(...keys.map(key => ({ op: 'set', index, key, value: tidy(to[key]) })));
}

// Something that was dragged from the library lands on the timeline.
/** @param {import('./drag.js').Dragged} what @param {number} time @param {string | null} row the joints of the row, if it fell on one */
export async function landed(what, time, row) {
  const seconds = 'id' in what ? ((clipOf(what.id) ?? danceOf(what.id))?.seconds ?? 0) : 0;
  if (what.kind === 'clip' && !row) await putAt(what.id, seconds, time);
  else if (what.kind === 'clip' && row) {
    const first = begun();
    if (first?.length) await change(...first);
    // a part of the body comes at its own time of the clip
    const begin = store.timeline.seconds ? Math.min(time, store.timeline.seconds) : 0;
    const long = Math.min(seconds, store.timeline.seconds ? store.timeline.seconds - begin : seconds);
    if (long > 0) await change({ op: 'give', clip: what.id, joints: row, from: begin, to: begin + long, at: 0 });
  } else if (what.kind === 'part') {
    await change({
      op: 'give',
      clip: what.id,
      joints: row ?? 'all',
      from: time,
      to: time + what.to - what.from,
      at: what.from,
    });
  }
  if (what.kind === 'clip' || what.kind === 'part') Object.assign(ui, { mode: 'timeline' });
  tell('cast');
}
