// Files and folders from outside, dropped anywhere or chosen.

import { upload, uploadMap } from './api.js';
import { whatIsDragged } from './drag.js';
import { find } from './dom.js';
import { counted, mapName } from './format.js';
import { tell } from './store.js';
import { attempt, toast } from './toast.js';

// What is looked for in folders; single files are sent whatever they are called, and the studio says what it can't read.
const READ = /\.(bvh|amc|asf|glb|vrm|vrma|npz|pkl|json|fbx|mp3|ogg|oga|flac|wav|m4a|mp4|aac)$/i;

/** @type {Set<string>} names of files on their way */
export const uploads = new Set();

/** @param {File[]} files */
export async function send(files) {
  for (const file of files) uploads.add(file.name);
  tell('clips');
  // one after the other, so that the library has their order
  for (const file of files) {
    const isMap = file.name.toLowerCase().endsWith('.toml');
    await attempt(async () => void (await (isMap ? sendMap(file) : upload(file))));
    uploads.delete(file.name);
    tell('clips');
  }
}

// A skeleton map is no clip: clips are read with it.
/** @param {File} file */
async function sendMap(file) {
  const { map } = await uploadMap(file);
  toast(`${mapName(map)} is a map now: choose it in a clip’s menu, at “How it is read”.`);
}

/** @param {FileSystemEntry} entry @returns {Promise<File[]>} */
async function filesOf(entry) {
  if (entry.isFile) {
    return [await new Promise((done, fail) => /** @type {FileSystemFileEntry} */ (entry).file(done, fail))];
  }
  const reader = /** @type {FileSystemDirectoryEntry} */ (entry).createReader(),
    all = [];
  // a folder is read a hundred entries at a time
  for (;;) {
    const some = /** @type {FileSystemEntry[]} */ (await new Promise((done, fail) => reader.readEntries(done, fail)));
    if (!some.length) return all;
    for (const one of some) if (!one.name.startsWith('.')) all.push(...(await filesOf(one)));
  }
}

// Of folders the files that can be read; says how many were passed over.
/** @param {File[]} all */
export function chosen(all) {
  const files = all.filter(file => READ.test(file.name)),
    over = all.length - files.length;
  if (over) toast(`${counted(files.length, 'file')} added; ${over} of other kinds passed over.`);
  return files;
}

/** @param {DataTransfer} transfer */
async function dropped(transfer) {
  const entries = [...transfer.items].map(item => item.webkitGetAsEntry?.() ?? null);
  const plain = [...transfer.files];
  if (!entries.some(entry => entry?.isDirectory)) {
    await send(plain);
    return;
  }
  const all = [];
  for (const entry of entries) if (entry) all.push(...((await attempt(() => filesOf(entry))) ?? []));
  await send(chosen(all));
}

export function openDrop() {
  const veil = find('veil');
  let depth = 0;
  const isFiles = (/** @type {DragEvent} */ e) =>
    !whatIsDragged() && [...(e.dataTransfer?.types ?? [])].includes('Files');
  const over = (/** @type {number} */ by) => {
    depth = Math.max(0, depth + by);
    veil.hidden = depth === 0;
  };
  addEventListener('dragenter', e => {
    if (isFiles(e)) over(1);
  });
  addEventListener('dragleave', e => {
    if (isFiles(e)) over(-1);
  });
  addEventListener('dragover', e => {
    if (isFiles(e)) e.preventDefault();
  });
  addEventListener('drop', e => {
    over(-depth);
    if (!isFiles(e) || !e.dataTransfer) return;
    e.preventDefault();
    dropped(e.dataTransfer);
  });
}
