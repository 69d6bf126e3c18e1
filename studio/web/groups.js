// Groups of joints by SMPL's ids, and lists of joints as requests have them.

/** @type {Record<string, number[]>} */
export const GROUPS = {
  root: [0],
  spine: [3, 6, 9],
  head: [12, 15],
  left_arm: [13, 16, 18, 20, 22],
  right_arm: [14, 17, 19, 21, 23],
  left_leg: [1, 4, 7, 10],
  right_leg: [2, 5, 8, 11],
  legs: [1, 2, 4, 5, 7, 8, 10, 11],
  arms: [13, 14, 16, 17, 18, 19, 20, 21, 22, 23],
  hands: [20, 21, 22, 23],
  feet: [7, 8, 10, 11],
  torso: [0, 3, 6, 9],
  upper_body: [3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23],
  lower_body: [0, 1, 2, 4, 5, 7, 8, 10, 11],
  all: Array.from({ length: 24 }, (_, i) => i),
};

// The parts that no two share, in the order of the timeline's rows.
export const PARTS = ['root', 'spine', 'head', 'left_arm', 'right_arm', 'left_leg', 'right_leg'];

export const NAMES = [
  'root',
  'left_hip',
  'right_hip',
  'spine1',
  'left_knee',
  'right_knee',
  'spine2',
  'left_ankle',
  'right_ankle',
  'spine3',
  'left_foot',
  'right_foot',
  'neck',
  'left_collar',
  'right_collar',
  '15',
  'left_shoulder',
  'right_shoulder',
  'left_elbow',
  'right_elbow',
  'left_wrist',
  'right_wrist',
  'left_hand',
  'right_hand',
];

/** @param {number} smpl */
export const partOf = smpl => PARTS.find(part => GROUPS[part].includes(smpl));

// The ids of a list of groups, names and ids; what is none of them is left out.
/** @param {string} list @returns {Set<number>} */
export function idsOf(list) {
  const ids = list
    .split(',')
    .map(name => name.trim())
    .flatMap(name => {
      if (GROUPS[name]) return GROUPS[name];
      const id = name === 'pelvis' ? 0 : NAMES.indexOf(name);
      return id >= 0 ? [id] : /^\d+$/.test(name) ? [Number(name)] : [];
    });
  return new Set(ids);
}

// Groups and joints without those that a named group has already.
/** @param {Iterable<string>} names @returns {string[]} */
export function simplest(names) {
  const all = [...new Set(names)];
  const inGroup = (/** @type {string} */ name) =>
    all.some(
      other =>
        other !== name && PARTS.includes(other) && !PARTS.includes(name) && GROUPS[other].includes(NAMES.indexOf(name)),
    );
  const left = all.filter(name => !inGroup(name));
  return PARTS.every(part => left.includes(part)) ? ['all'] : left;
}

// `left_arm@4s:8s` in its parts; a time that isn't in seconds is left open.
/** @param {string} span @returns {{ joints: string, from: number, to: number }} */
export function spanOf(span) {
  const [joints, times = ''] = span.split('@'),
    [from, to] = times.split(':');
  const seconds = (/** @type {string | undefined} */ text, /** @type {number} */ open) => {
    const number = parseFloat(text ?? '');
    return Number.isFinite(number) && number >= 0 && !/[fm]$/.test(text ?? '') ? number : open;
  };
  return { joints, from: seconds(from, 0), to: seconds(to, Infinity) };
}
