// A film of the stage: what is played, once from its beginning to its end, as WebM.

import { h } from './dom.js';
import { thePlayer } from './music.js';
import { onFrame, stage, theScene } from './stage-view.js';
import { toast } from './toast.js';

const KINDS = ['video/webm;codecs=vp9,opus', 'video/webm;codecs=vp8,opus', 'video/webm'];

/** @type {MediaRecorder | null} */
let recorder = null;
let end = 0,
  wasLooping = true,
  lastTime = 0;

export const isFilming = () => recorder !== null;

// Begins a film, or ends it early.
/** @param {string} name of the file @param {() => void} changed */
export function film(name, changed) {
  if (recorder) {
    stop();
    return;
  }
  const scene = theScene(),
    kind = KINDS.find(kind => window.MediaRecorder?.isTypeSupported(kind));
  if (!scene || !kind || !stage.figures.length) {
    toast(kind ? 'There is nobody on the stage.' : 'This browser can’t record films.', { kind: 'trouble' });
    return;
  }
  const stream = scene.canvas.captureStream(60),
    audio = thePlayer()?.audio;
  // a browser that can give the sound of an element records it too
  const heard = /** @type {any} */ (audio)?.captureStream?.();
  for (const track of heard?.getAudioTracks() ?? []) stream.addTrack(track);
  /** @type {Blob[]} */
  const parts = [];
  scene.backdrop = stage.colours.sky;
  recorder = new MediaRecorder(stream, { mimeType: kind, videoBitsPerSecond: 8e6 });
  recorder.ondataavailable = e => parts.push(e.data);
  recorder.onstop = () => {
    scene.backdrop = null;
    recorder = null;
    stage.state.loop = wasLooping;
    stage.state.dirty = true;
    save(new Blob(parts, { type: 'video/webm' }), `${name}.webm`);
    changed();
  };
  wasLooping = stage.state.loop;
  stage.state.loop = false;
  end = stage.end;
  lastTime = -1;
  stage.seek(stage.begin);
  recorder.start();
  stage.play(true);
  changed();
}

export function stop() {
  if (recorder?.state === 'recording') recorder.stop();
}

/** @param {Blob} blob @param {string} name */
export function save(blob, name) {
  const href = URL.createObjectURL(blob),
    link = h('a', { href, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(href), 60e3);
  toast(`${name} is in your downloads.`);
}

export function openRecorder() {
  onFrame(time => {
    if (!recorder || recorder.state !== 'recording') return;
    // it has come to its end, or somebody paused it
    if (time >= end || (!stage.state.playing && time === lastTime)) stop();
    lastTime = time;
  });
}
