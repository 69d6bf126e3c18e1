// The dances, the clock, the camera and the controls.

const $ = id => document.getElementById(id);
const clamp = (v, low, high) => Math.min(high, Math.max(low, v));
const ease = t => t * t * (3 - 2 * t);

// ---- dances ----
function decoded(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  return new Uint16Array(bytes.buffer);              // little-endian, as every browser's machine is
}

class Figure {
  constructor(data, index) {
    Object.assign(this, data, { index, numbers: decoded(data.data) });
    this.now = new Float32Array(this.points * 3);    // places of this moment, without the shift
    this.lasts = (this.frames - 1) / this.fps;
    this.shift = [0, 0];
    this.top = this.highest();
  }

  highest() {
    let most = 0;
    for (let i = 1; i < this.numbers.length; i += 3) most = Math.max(most, this.numbers[i]);
    return this.low[1] + this.step * most;
  }

  // Places of points `from` to `upto` at a time, between frames along a Catmull-Rom curve; held beyond the ends.
  places(time, out, from = 0, upto = this.points) {
    const last = this.frames - 1, n = this.numbers, size = this.points * 3;
    const frame = clamp(time * this.fps, 0, last), at = Math.floor(frame), u = frame - at;
    const a = Math.max(at - 1, 0) * size, b = at * size, c = Math.min(at + 1, last) * size, d = Math.min(at + 2, last) * size;
    const wa = 0.5 * u * (u * (2 - u) - 1), wb = 0.5 * (u * u * (3 * u - 5) + 2);
    const wc = 0.5 * u * (u * (4 - 3 * u) + 1), wd = 0.5 * u * u * (u - 1);
    for (let i = from * 3, o = 0; i < upto * 3; i++, o++) {
      out[o] = this.low[i % 3] + this.step * (wa * n[a + i] + wb * n[b + i] + wc * n[c + i] + wd * n[d + i]);
    }
  }

  // Where the figure is on the floor around a time: the root's mean over a second and a half, so that nothing jitters.
  about(time) {
    const root = new Float32Array(3);
    let x = 0, z = 0;
    for (let i = -4; i <= 4; i++) {
      this.places(time + i * 0.18, root, 0, 1);
      x += root[0] / 9;
      z += root[2] / 9;
    }
    return [x + this.shift[0], z + this.shift[1]];
  }
}

const figures = JSON.parse($('figures').textContent).map((data, i) => new Figure(data, i));
const unit = Math.max(...figures.map(f => f.height));
const highest = Math.max(...figures.map(f => f.top));
const whole = Math.max(...figures.map(f => f.lasts));
// figures of one world stand to each other as their clips put them
const oneWorld = figures.length > 1 && figures.every(f => f.world === figures[0].world);

// ---- music, where there is some ----
const music = JSON.parse($('music').textContent);
const player = music && new Player(music, { ticks: $('ticks'), pulse: $('pulse'), button: $('sound'), length: whole });

// ---- what was made anew: a mark on the bar for each stretch ----
for (const [from, to] of figures.flatMap(f => f.anew)) {
  const mark = document.createElement('i'), part = s => 100 * clamp(s, 0, whole) / (whole || 1);
  mark.style.left = `${part(from)}%`;
  mark.style.width = `${part(to) - part(from)}%`;
  $('anew').append(mark);
}

// ---- what the page is doing ----
const HOME = { yaw: 0.0, pitch: 0.13, zoom: 1, pan: [0, 0, 0] };
const state = {
  time: 0, playing: true, speed: 1, loop: true, follow: true, overlay: false, trails: false,
  overlaid: 0, following: 1,                         // 0 to 1: where a change of the two above has got to
  yaw: HOME.yaw, pitch: HOME.pitch, zoom: HOME.zoom, pan: [0, 0, 0], rested: 0, dirty: true,
};
const HOLD_S = 0.7;                                  // stillness at the end before it starts again

// ---- colours, from the style sheet ----
const colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  const rgb = name => [1, 3, 5].map(i => parseInt(style.getPropertyValue(name).trim().slice(i, i + 2), 16) / 255);
  Object.assign(colours, {
    floor: rgb('--floor'), line: rgb('--line'), ink: rgb('--ink'), given: rgb('--given'),
    figures: figures.map((_, i) => rgb(`--figure-${i % 6}`)), shadow: parseFloat(style.getPropertyValue('--shadow')),
  });
  state.dirty = true;
}
const mixed = (a, b, t) => a.map((v, i) => v + (b[i] - v) * t);

// ---- from dances to capsules and shadows ----
const TRAIL = 40, TRAIL_S = 1.3;
const things = {
  capsules: new Float32Array(CAPSULE * figures.reduce((n, f) => n + f.bones.length + f.balls.length + f.tips.length * TRAIL, 0)),
  shadows: new Float32Array(SHADOW * figures.reduce((n, f) => n + f.points, 0)),
  capsuleCount: 0, shadowCount: 0,
};

function addCapsule(ax, ay, az, ra, bx, by, bz, rb, colour) {
  const c = things.capsules, i = CAPSULE * things.capsuleCount++;
  c[i] = ax; c[i + 1] = ay; c[i + 2] = az; c[i + 3] = ra;
  c[i + 4] = bx; c[i + 5] = by; c[i + 6] = bz; c[i + 7] = rb;
  c[i + 8] = colour[0]; c[i + 9] = colour[1]; c[i + 10] = colour[2];
}

// Whether a figure's given joints are so at a time.
function isGiven(figure, time) {
  return !figure.given_s || (time >= figure.given_s[0] && time < figure.given_s[1]);
}

function addFigure(figure, plain) {
  const p = figure.now, [sx, sz] = figure.shift, h = figure.height;
  const own = colours.figures[figure.index], marked = isGiven(figure, Math.min(state.time, figure.lasts));
  const joint = plain ? own : mixed(own, colours.ink, 0.16), givenJoint = plain ? colours.given : mixed(colours.given, colours.ink, 0.12);
  for (const { a, b, ra, rb, given } of figure.bones) {
    addCapsule(p[3 * a] + sx, p[3 * a + 1], p[3 * a + 2] + sz, ra, p[3 * b] + sx, p[3 * b + 1], p[3 * b + 2] + sz, rb, given && marked ? colours.given : own);
  }
  for (const { at, r, given } of figure.balls) {
    const x = p[3 * at] + sx, y = p[3 * at + 1], z = p[3 * at + 2] + sz;
    addCapsule(x, y, z, r, x, y, z, r, given && marked ? givenJoint : joint);
  }
  for (let i = 0; i < figure.points; i++) {
    const y = Math.max(0, p[3 * i + 1]) / h, s = things.shadows, k = SHADOW * things.shadowCount++;
    s[k] = p[3 * i] + sx;
    s[k + 1] = p[3 * i + 2] + sz;
    s[k + 2] = (0.075 + 0.42 * y) * h;
    s[k + 3] = colours.shadow * (0.6 * Math.exp(-y / 0.05) + 0.09 * Math.exp(-y / 0.4));
  }
}

const spot = [new Float32Array(3), new Float32Array(3)];
function addTrails(figure) {
  const [sx, sz] = figure.shift, own = colours.figures[figure.index];
  const time = Math.min(state.time, figure.lasts);
  for (const tip of figure.tips) {
    const given = figure.bones.some(b => b.b === tip && b.given);
    for (let k = 0; k < TRAIL; k++) {
      const [late, early] = [time - k * TRAIL_S / TRAIL, time - (k + 1) * TRAIL_S / TRAIL];
      if (early < 0) break;
      figure.places(late, spot[0], tip, tip + 1);
      figure.places(early, spot[1], tip, tip + 1);
      const [a, b] = spot, r = n => 0.0085 * figure.height * (1 - n / TRAIL);
      addCapsule(a[0] + sx, a[1], a[2] + sz, r(k), b[0] + sx, b[1], b[2] + sz, r(k + 1), mixed(given && isGiven(figure, late) ? colours.given : own, colours.floor, 0.15 + 0.7 * k / TRAIL));
    }
  }
}

function compose(plain) {
  things.capsuleCount = things.shadowCount = 0;
  const t = ease(state.overlaid);
  for (const f of figures) {
    f.shift = [0, 1].map(i => f.beside[i] + (f.onto[i] - f.beside[i]) * t);
    f.places(state.time, f.now);
    addFigure(f, plain);
    if (state.trails && !plain) addTrails(f);
  }
}

// ---- camera ----
const FOV = 0.46;

// How much room the dances need around the point that the camera looks at, over the whole time: found once for each
// arrangement of the figures and of the camera.
const rooms = new Map();
function roomFor(overlay, follow) {
  const key = `${overlay} ${follow}`;
  if (!rooms.has(key)) {
    const kept = figures.map(f => f.shift), places = figures.map(f => new Float32Array(f.points * 3));
    figures.forEach(f => { f.shift = overlay ? f.onto : f.beside; });
    const middle = centre(whole / 2, false);
    let wide = 0.5 * unit, deep = 0, high = unit;
    for (let i = 0; i <= 120; i++) {
      const time = whole * i / 120, [cx, cz] = follow ? centre(time, true) : middle;
      figures.forEach((f, n) => {
        f.places(time, places[n]);
        for (let k = 0; k < places[n].length; k += 3) {
          wide = Math.max(wide, Math.abs(places[n][k] + f.shift[0] - cx));
          deep = Math.max(deep, places[n][k + 2] + f.shift[1] - cz);
          high = Math.max(high, places[n][k + 1]);
        }
      });
    }
    figures.forEach((f, n) => { f.shift = kept[n]; });
    rooms.set(key, { wide, deep, high, middle });
  }
  return rooms.get(key);
}

function centre(time, follow) {
  const at = figures.map(f => (follow ? f.about(time) : [0, 1].map(i => (f.about(0)[i] + f.about(whole / 2)[i] + f.about(whole)[i]) / 3)));
  return [0, 1].map(i => at.reduce((sum, p) => sum + p[i], 0) / figures.length);
}

function camera() {
  const { width, height } = scene.canvas, aspect = width / height, tan = Math.tan(FOV / 2);
  const mix = (a, b, t) => a + (b - a) * t;
  const size = name => {
    const still = mix(roomFor(false, false)[name], roomFor(true, false)[name], ease(state.overlaid));
    return mix(still, mix(roomFor(false, true)[name], roomFor(true, true)[name], ease(state.overlaid)), ease(state.following));
  };
  const bare = document.documentElement.classList.contains('bare');
  // the labels and the bar take their part of the height
  const fitHigh = (0.5 * size('high') + (bare ? 0.13 : 0.24) * unit) / tan, fitWide = (size('wide') + 0.12 * unit) / (tan * aspect);
  const distance = (Math.max(fitHigh, fitWide) + Math.min(size('deep'), 2 * unit)) * state.zoom;
  const stillAt = [0, 1].map(i => mix(roomFor(false, false).middle[i], roomFor(true, false).middle[i], ease(state.overlaid)));
  const [x, z] = centre(state.time, true).map((v, i) => mix(stillAt[i], v, ease(state.following)));
  const target = [x + state.pan[0], 0.5 * size('high') + (bare ? 0.04 : -0.015) * unit + state.pan[1], z + state.pan[2]];
  const cp = Math.cos(state.pitch);
  const eye = [target[0] + distance * cp * Math.sin(state.yaw), target[1] + distance * Math.sin(state.pitch), target[2] + distance * cp * Math.cos(state.yaw)];
  eye[1] = Math.max(eye[1], 0.02 * unit);
  const lens = perspective(FOV, aspect, 0.02 * distance, distance * 4 + 60 * unit);
  return { view: multiply(lens, viewFrom(eye, state.yaw, state.pitch)), eye, distance, centre: [x, z], reach: 2.2 * distance, unit };
}

// ---- labels ----
const labels = figures.map((f, i) => {
  const label = document.createElement('div'), title = document.createElement('b'), dot = document.createElement('i');
  label.className = 'label';
  title.append(dot, f.title);
  label.append(title);
  if (f.note) {
    const note = document.createElement('span');
    note.textContent = f.note;
    label.append(note);
  }
  if (player && f.hits) {
    const kept = document.createElement('span'), light = document.createElement('i');
    light.className = 'light';
    kept.append(light, f.hits.says);
    label.append(kept);
    player.hit(f.hits.beats, `var(--figure-${i % 6})`, light);
  }
  label.style.setProperty('--own', `var(--figure-${i % 6})`);
  // many stand close together and have the height of the window instead
  label.style.setProperty('--lines', figures.length > 5 ? 5 : 2);
  $('labels').append(label);
  return label;
});

function placeLabels(view) {
  const { clientWidth, clientHeight } = scene.canvas, onto = ease(state.overlaid);
  const at = figures.map(f => {
    const [x, z] = f.about(state.time), y = highest + 0.07 * unit;
    const w = view[3] * x + view[7] * y + view[11] * z + view[15];
    const [px, py] = [0, 1].map(i => (view[i] * x + view[4 + i] * y + view[8 + i] * z + view[12 + i]) / w);
    return { x: (0.5 + 0.5 * px) * clientWidth, y: (0.5 - 0.5 * py) * clientHeight, seen: w > 0 };
  });
  // 0 to 1: whether two figures stand on one spot
  const close = (i, j) => (!oneWorld && figures[i].world === figures[j].world ? 1 : onto);
  // side by side a label has the room up to its neighbours; in steps, so that its lines don't break anew all the time
  labels.forEach((label, i) => {
    const apart = Math.min(...at.map((p, j) => (i === j ? 340 : Math.abs(p.x - at[i].x) + 340 * close(i, j))));
    label.style.maxWidth = `${clamp(16 * Math.floor((apart - 8) / 16), 64, 336)}px`;
  });
  const heights = labels.map(l => l.offsetHeight + 3);
  labels.forEach((label, i) => {
    // on one spot the labels stand above each other, the last on top; none leaves the window by its top
    const sum = (from, upto) => heights.slice(from, upto).reduce((s, h, k) => s + h * close(i, from + k), 0);
    const bottom = Math.max(at[i].y - sum(0, i), 10 + heights[i] + sum(i + 1));
    label.style.display = at[i].seen ? '' : 'none';
    label.style.transform = `translate(${at[i].x.toFixed(1)}px, ${bottom.toFixed(1)}px) translate(-50%, -100%)`;
  });
}

// ---- a picture ----
let scene;
function draw(plain = false) {
  compose(plain);
  const cam = camera();
  scene.draw(cam, things, colours, plain);
  return cam;
}

function show() {
  scene.resize();
  placeLabels(draw().view);
  const clock = s => `${Math.floor(s / 60)}:${(s % 60 < 9.95 ? '0' : '') + (s % 60).toFixed(1)}`;
  if (player) player.show(state.time);
  $('now').textContent = clock(state.time);
  $('whole').textContent = ` / ${clock(whole)}`;
  $('scrub').value = state.time;
  $('scrub').style.setProperty('--done', `${whole ? 100 * state.time / whole : 0}%`);
}

let before = 0;
function tick(stamp) {
  const dt = clamp((stamp - before) / 1000, 0, 0.1);
  before = stamp;
  advance(dt);
  if (state.dirty) {
    state.dirty = false;
    show();
  }
  requestAnimationFrame(tick);
}

// Time passes: the dance, and changes that take a moment.
function advance(dt) {
  if (player) player.follow(state.time, state.playing && state.time < whole ? state.speed : 0);
  if (state.playing) {
    state.dirty = true;
    // the sound's time where there is sound: it can't be made to wait
    const heard = player ? player.now() : null;
    state.time = heard === null || heard >= whole ? state.time + dt * state.speed : heard;
    if (state.time >= whole) {
      state.time = whole;
      state.rested += dt;
      if (state.rested > HOLD_S || whole === 0) state.loop ? seek(0) : play(false);
    }
  }
  for (const [at, goal] of [['overlaid', state.overlay], ['following', state.follow]]) {
    if (state[at] !== Number(goal)) {
      state[at] = clamp(state[at] + (goal ? dt : -dt) / 0.6, 0, 1);
      state.dirty = true;
    }
  }
}
