// The music of the stage, in step with the dancers.

import { post } from './api.js';
import { find } from './dom.js';
import { Player } from './sound.js';
import { onFrame, stage } from './stage-view.js';
import { clipOf, on, store } from './store.js';
import { attempt } from './toast.js';

/** @type {Player | null} */
let player = null;
let playing = '';

export const thePlayer = () => player;

// The beats in the time of the dance; none without music.
export function beats() {
  const { music } = store.state;
  return music ? (clipOf(music.clip)?.beats ?? []).map(beat => beat - music.from_s) : [];
}

/** @param {string | null} clip @param {number} [from_s] the music's time where the dance begins */
export const setMusic = (clip, from_s = 0) => attempt(() => post('/api/music', { clip, from_s }));

function change() {
  const { music } = store.state,
    clip = clipOf(music?.clip);
  const key = music && clip ? `${music.clip} ${music.from_s} ${clip.beats?.length ?? 0}` : '';
  if (key === playing) return;
  playing = key;
  if (player) {
    player.audio.pause();
    player.audio.removeAttribute('src');
  }
  const button = find('sound');
  button.hidden = key === '';
  player =
    music && clip
      ? new Player(
          { src: `/api/clips/${music.clip}/sound`, name: clip.name, from: music.from_s, beats: clip.beats ?? [] },
          { ticks: null, pulse: find('pulse'), button, length: Infinity },
        )
      : null;
  stage.sound = player;
  stage.state.dirty = true;
}

export function openMusic() {
  on(['music', 'clips'], change);
  onFrame(time => player?.show(time));
}
