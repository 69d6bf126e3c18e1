// Files for the tests: a dance of the model's own, and one whose rate is stated wrongly, and a long one.

import { execFileSync } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { KINELM } from './lib.mjs';

/** A dance of some seconds, as a BVH at 30 frames a second. */
export function dance(folder, name, seconds, seed = 5) {
  const path = join(folder, name);
  execFileSync(
    KINELM,
    ['generate', '--seconds', String(seconds), '--fps', '30', '--seed', String(seed), '--out', path],
    { stdio: 'pipe' },
  );
  return path;
}

/** The same, hopping as one does at 30 frames a second, in a file that says 120. */
export function hopping(from, path) {
  const lines = readFileSync(from, 'utf8').trimEnd().split('\n'),
    motion = lines.findIndex(line => line.trim() === 'MOTION');
  const order = /CHANNELS\s+6\s+(.*)/.exec(lines.join('\n'))[1].split(/\s+/),
    y = order.indexOf('Yposition');
  const stands = Number(lines[motion + 3].trim().split(/\s+/)[y]),
    metre = stands > 10 ? 100 : 1,
    FLIGHT = 0.8,
    EVERY = 1.6;
  lines[motion + 2] = `Frame Time: ${(1 / 120).toFixed(8)}`;
  for (let i = motion + 3, frame = 0; i < lines.length; i++, frame++) {
    const numbers = lines[i].trim().split(/\s+/),
      t = (frame / 30) % EVERY;
    if (t < FLIGHT) numbers[y] = (Number(numbers[y]) + metre * 4.905 * t * (FLIGHT - t)).toFixed(5);
    lines[i] = numbers.join(' ');
  }
  writeFileSync(path, `${lines.join('\n')}\n`);
  return path;
}

/** A dance five minutes long, from the frames of a shorter one to and fro. */
export function longer(from, path, seconds) {
  const lines = readFileSync(from, 'utf8').trimEnd().split('\n'),
    motion = lines.findIndex(line => line.trim() === 'MOTION');
  const frames = lines.slice(motion + 3),
    fps = Math.round(1 / Number(lines[motion + 2].split(':')[1])),
    all = [];
  for (let way = frames; all.length < seconds * fps; way = [...way].reverse()) all.push(...way);
  const kept = all.slice(0, seconds * fps);
  writeFileSync(
    path,
    [...lines.slice(0, motion + 1), `Frames: ${kept.length}`, lines[motion + 2], ...kept, ''].join('\n'),
  );
  return path;
}
