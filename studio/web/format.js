// Numbers and names as they are read.

/** @param {number} s */
export function clock(s) {
  const whole = Math.max(0, s);
  return `${Math.floor(whole / 60)}:${whole % 60 < 9.95 ? '0' : ''}${(whole % 60).toFixed(1)}`;
}

/** @param {number} from @param {number} to */
export const between = (from, to) =>
  to < 60 ? `${from.toFixed(1)} to ${to.toFixed(1)} s` : `${clock(from)} to ${clock(to)}`;

/** @param {number} s */
export function length(s) {
  if (s < 60) return `${s.toFixed(1)} s`;
  const rounded = Math.round(s);
  return `${Math.floor(rounded / 60)} min ${rounded % 60} s`;
}

/** @param {number} fps */
export const rate = fps => `${Number(fps.toFixed(2))} fps`;

/** @param {number} n @param {string} word */
export const counted = (n, word) => `${n} ${word}${n === 1 ? '' : 's'}`;

/** @type {Record<string, string>} */
const JOINTS = { 15: 'skull', root: 'hips and path', all: 'whole body' };

// A list of joints as one says it: `left_arm,root` is `left arm and hips and path`.
/** @param {string} list */
export function joints(list) {
  const names = list
    .split(',')
    .map(name => name.trim())
    .filter(Boolean)
    .map(name => JOINTS[name] ?? name.replaceAll('_', ' '));
  return names.length > 1 ? `${names.slice(0, -1).join(', ')} and ${names[names.length - 1]}` : (names[0] ?? '');
}

/** @param {string} word */
export const capital = word => word.charAt(0).toUpperCase() + word.slice(1);

// What a skeleton map is called: one of the project is a file.
/** @param {string} map */
export const mapName = map => map.replace(/^maps\//, '').replace(/\.toml$/, '');

// What the text of a timeline doesn't say of a segment.
/** @param {{ assumed: string[] }} segment */
export const unsaid = ({ assumed }) => (assumed.length ? ` (not said: ${assumed.join(', ')})` : '');
