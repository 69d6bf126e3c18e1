// The characters of clips and dances: sent for once, and none where a file has no mesh that can be drawn here.

import { Character } from './character.js';
import { parse } from './glb.js';
import { characterOf } from './store.js';

// Characters that are kept, the latest last.
const MOST = 12;

/** @type {Map<string, Character | string | null>} null while it comes, and why there is none */
const known = new Map();

/** @param {string} id @returns {string | undefined} why capsules stand for its mesh */
export function whyCapsules(id) {
  const there = known.get(id);
  return typeof there === 'string' ? there : undefined;
}

/** @param {string} id of a clip or dance @param {() => void} come @returns {Character | null} */
export function character(id, come) {
  if (!characterOf(id)) return null;
  const there = known.get(id);
  if (there !== undefined) return typeof there === 'string' ? null : there;
  known.set(id, null);
  fetched(id).then(
    one => {
      known.set(id, one);
      for (const oldest of known.keys()) {
        if (known.size <= MOST) break;
        known.delete(oldest);
      }
      come();
    },
    error => {
      known.set(id, error.message);
      come();
    },
  );
  return null;
}

/** @param {string} id */
async function fetched(id) {
  const response = await fetch(`/api/clips/${id}/character`);
  if (!response.ok) throw new Error((await response.json().catch(() => null))?.error?.text ?? `${response.status}`);
  const toStage = (response.headers.get('kinelm-to-stage') ?? '').split(' ').map(Number);
  return new Character(parse(await response.arrayBuffer(), 'on the stage'), Float32Array.from(toStage));
}

// It was read otherwise, or is gone.
/** @param {string} id */
export const forgetCharacter = id => known.delete(id);
