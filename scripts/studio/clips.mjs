// Files for the tests: a dance of the model's own, a long one, and those of which something is doubted.

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

/** The same in a GLB as another program writes it: its mesh, of capsules, is a user's character. */
export function character(from, path) {
  execFileSync(KINELM, ['convert', from, path], { stdio: 'pipe' });
  const file = readFileSync(path),
    own = '"generator":"kinelm ',
    at = file.indexOf(own);
  if (at < 0) throw new Error('a GLB without its generator');
  file.write('sculpt', at + own.length - 'kinelm '.length);
  writeFileSync(path, file);
  return path;
}

/** A BVH's lines: its hierarchy, and the numbers of its frames. */
function parts(from) {
  const lines = readFileSync(from, 'utf8').trimEnd().split('\n'),
    motion = lines.findIndex(line => line.trim() === 'MOTION');
  const numbers = lines.slice(motion + 3).map(line => line.trim().split(/\s+/).map(Number));
  const order = /CHANNELS\s+6\s+(.*)/.exec(lines.join('\n'))[1].trim().split(/\s+/);
  return { head: lines.slice(0, motion), time: lines[motion + 2], numbers, order };
}

function write(path, { head, time, numbers }) {
  const rows = numbers.map(row => row.map(number => number.toFixed(5)).join(' '));
  writeFileSync(path, [...head, 'MOTION', `Frames: ${rows.length}`, time, ...rows, ''].join('\n'));
  return path;
}

/** The same at a rate that its file alone says. */
export function saying(from, path, fps) {
  return write(path, { ...parts(from), time: `Frame Time: ${(1 / fps).toFixed(8)}` });
}

/** The same behind a rest pose, out of which some frames still come, the first fastest. */
export function resting(from, path, smeared = 3) {
  const own = parts(from),
    places = own.order.map(name => name.endsWith('position'));
  const begin = own.numbers[0],
    rest = begin.map((number, i) => (places[i] ? number : 0));
  const out = Array.from({ length: smeared + 1 }, (_, k) =>
    begin.map((number, i) => rest[i] + (number - rest[i]) * (k && 1 - 0.4 ** k)),
  );
  return write(path, { ...own, numbers: [...out, ...own.numbers] });
}

/** The same with z up: every axis is called by the name of the next. */
export function lying(from, path) {
  const own = parts(from),
    next = { X: 'Y', Y: 'Z', Z: 'X' };
  const head = own.head.map(line => {
    const offset = /^(\s*OFFSET\s+)(\S+)\s+(\S+)\s+(\S+)/.exec(line);
    if (offset) return `${offset[1]}${offset[4]} ${offset[2]} ${offset[3]}`;
    return line.replace(/\b([XYZ])(position|rotation)\b/g, (_, axis, of) => next[axis] + of);
  });
  return write(path, { ...own, head });
}

/** The same in a format whose axes are known, lying all the same. */
export function unsure(from, path) {
  execFileSync(KINELM, ['convert', lying(from, `${path}.bvh`), path, '--up', 'y'], { stdio: 'pipe' });
  return path;
}

/** The same with left and right exchanged in the names of its joints. */
export function mirrored(from, path) {
  const own = parts(from),
    other = { left: 'right', right: 'left', Left: 'Right', Right: 'Left', L: 'R', R: 'L' };
  const swap = line =>
    /^\s*(ROOT|JOINT)/.test(line) ? line.replace(/left|right|Left|Right|\bL_|\bR_/g, of => other[of] ?? `${other[of[0]]}_`) : line;
  return write(path, { ...own, head: own.head.map(swap) });
}

/** The same in the air, skating. */
export function skating(from, path) {
  const own = parts(from),
    [x, y] = ['Xposition', 'Yposition'].map(name => own.order.indexOf(name)),
    metre = own.numbers[0][y] > 10 ? 100 : 1;
  const moved = own.numbers.map((row, frame) =>
    row.map((number, i) => number + (i === x ? 0.03 * metre * frame : i === y ? 2 * metre : 0)),
  );
  return write(path, { ...own, numbers: moved });
}

/** The same with legs of no known unit. */
export function unitless(from, path) {
  const own = parts(from),
    metre = own.numbers[0][own.order.indexOf('Yposition')] > 10 ? 100 : 1;
  const small = line =>
    line.replace(/^(\s*OFFSET\s+)(.*)$/, (_, word, all) => word + all.trim().split(/\s+/).map(n => ((3 / metre) * n).toFixed(6)).join(' '));
  return write(path, { ...own, head: own.head.map(small) });
}
