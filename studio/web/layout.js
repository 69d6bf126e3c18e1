// Where dancers stand: side by side without touching, or on one spot.

/** @typedef {import('./dancer.js').Dancer} Dancer */

// Who goes far leaves no more room beside than this, in heights: ways may cross.
const MOST_ROOM = 1.25;
// Moments at which the room of each is looked at.
const MOMENTS = 240;

/**
 * Dancers of one source share a path; others begin on one spot where they are overlaid.
 * @param {Dancer[]} dancers @param {number} whole seconds
 */
export function arrange(dancers, whole) {
  if (!dancers.length) return;
  if (dancers.every(d => d.isPart)) {
    // parts of one dance stand where it is
    for (const dancer of dancers) dancer.beside = dancer.onto = [0, 0];
    return;
  }
  const together = dancers.every(d => d.world === dancers[0].world);
  const widths = dancers.map(dancer => widthsOf(dancer, whole));
  const shifts = [0];
  for (let n = 1; n < dancers.length; n++) {
    let overlap = -Infinity;
    for (let m = 0; m < MOMENTS; m++) overlap = Math.max(overlap, widths[n - 1][2 * m + 1] - widths[n][2 * m]);
    const height = Math.max(dancers[n].height, dancers[n - 1].height),
      room = shifts[n - 1] + overlap + 0.12 * height;
    // where each is on the average, with its shift
    const apart = mean(widths[n], 0.5) + room - mean(widths[n - 1], 0.5) - shifts[n - 1];
    shifts.push(together ? room : room - Math.max(0, apart - MOST_ROOM * height));
  }
  const middle = (shifts[0] + mean(widths[0], 0) + shifts[shifts.length - 1] + mean(widths[widths.length - 1], 1)) / 2;
  const start = new Float32Array(3);
  dancers.forEach((dancer, n) => {
    dancer.places(0, start, 0, 1);
    dancer.beside = [shifts[n] - middle, together ? 0 : -start[2]];
    dancer.onto = together ? [0, 0] : [-start[0], -start[2]];
  });
}

// The least and the largest x at each moment.
/** @param {Dancer} dancer @param {number} whole */
function widthsOf(dancer, whole) {
  const widths = new Float32Array(2 * MOMENTS);
  for (let m = 0; m < MOMENTS; m++) {
    dancer.places((whole * m) / (MOMENTS - 1), dancer.now);
    let low = Infinity,
      high = -Infinity;
    for (let i = 0; i < dancer.now.length; i += 3) {
      low = Math.min(low, dancer.now[i]);
      high = Math.max(high, dancer.now[i]);
    }
    widths[2 * m] = low;
    widths[2 * m + 1] = high;
  }
  return widths;
}

/** @param {Float32Array} widths @param {number} side 0: left, 1: right, 0.5: the middle */
function mean(widths, side) {
  let sum = 0;
  for (let m = 0; m < MOMENTS; m++) sum += widths[2 * m] + side * (widths[2 * m + 1] - widths[2 * m]);
  return sum / MOMENTS;
}
