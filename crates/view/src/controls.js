// What the user does: buttons, keys, mouse, touch, and the address.

function play(on) {
  if (on && state.time >= whole) seek(0);
  state.playing = on;
  document.documentElement.classList.toggle('playing', on);
  state.dirty = true;
}

function seek(time) {
  state.time = clamp(time, 0, whole);
  state.rested = 0;
  state.dirty = true;
  if (player) player.seek(state.time);
}

function toggle(name) {
  state[name] = !state[name];
  $(name).setAttribute('aria-pressed', state[name]);
  state.dirty = true;
}

function speedBy(step) {
  const select = $('speed');
  select.selectedIndex = clamp(select.selectedIndex + step, 0, select.options.length - 1);
  state.speed = Number(select.value);
}

function resetView() {
  Object.assign(state, { yaw: HOME.yaw, pitch: HOME.pitch, zoom: HOME.zoom, pan: [0, 0, 0], dirty: true });
}

const KEYS = {
  ' ': () => play(!state.playing),
  ArrowLeft: () => { play(false); seek(state.time - 1 / figures[0].fps); },
  ArrowRight: () => { play(false); seek(state.time + 1 / figures[0].fps); },
  Home: () => seek(0),
  End: () => seek(whole),
  '[': () => speedBy(-1),
  ']': () => speedBy(1),
  l: () => toggle('loop'),
  c: () => toggle('follow'),
  o: () => toggle('overlay'),
  t: () => toggle('trails'),
  f: resetView,
  m: () => player && player.mute(!player.muted),
};

function listen() {
  $('play').onclick = () => play(!state.playing);
  $('scrub').oninput = e => seek(Number(e.target.value));
  $('speed').onchange = e => { state.speed = Number(e.target.value); };
  for (const name of ['loop', 'follow', 'overlay', 'trails']) $(name).onclick = () => toggle(name);
  $('reset').onclick = resetView;
  document.addEventListener('keydown', e => {
    const does = KEYS[e.key.length === 1 ? e.key.toLowerCase() : e.key];
    // the list of speeds keeps its own keys; everywhere else a key means the same
    if (!does || e.ctrlKey || e.metaKey || e.altKey || e.target === $('speed')) return;
    e.preventDefault();
    does();
  });
  window.addEventListener('resize', () => { state.dirty = true; });
  const dark = matchMedia('(prefers-color-scheme: dark)');
  dark.addEventListener('change', theme);
  window.addEventListener('hashchange', () => { address(); state.dirty = true; });
  listenToPointers(scene.canvas);
  scene.canvas.addEventListener('webglcontextlost', e => e.preventDefault());
  scene.canvas.addEventListener('webglcontextrestored', () => { scene.build(); state.dirty = true; });
}

// Moves what the camera looks at with the pointer, at the dancers' distance.
function pan(dx, dy) {
  const metres = 2 * Math.tan(FOV / 2) * camera().distance / scene.canvas.clientHeight;
  state.pan[0] -= Math.cos(state.yaw) * dx * metres;
  state.pan[2] += Math.sin(state.yaw) * dx * metres;
  state.pan[1] = clamp(state.pan[1] + dy * metres, -unit, 3 * unit);
  state.dirty = true;
}

function orbit(dx, dy) {
  state.yaw -= dx * 0.006;
  state.pitch = clamp(state.pitch + dy * 0.006, -0.05, 1.5);
  state.dirty = true;
}

function zoom(by) {
  state.zoom = clamp(state.zoom * by, 0.12, 6);
  state.dirty = true;
}

function listenToPointers(canvas) {
  const down = new Map();                            // pointer -> [x, y]
  canvas.addEventListener('pointerdown', e => {
    down.set(e.pointerId, [e.clientX, e.clientY]);
    try { canvas.setPointerCapture(e.pointerId); } catch { /* a pointer that is gone already, or one of the self-test */ }
    canvas.classList.add('dragging');
  });
  canvas.addEventListener('pointermove', e => {
    const was = down.get(e.pointerId);
    if (!was) return;
    const [dx, dy] = [e.clientX - was[0], e.clientY - was[1]];
    const other = [...down].find(([id]) => id !== e.pointerId);
    if (other) {
      const apart = p => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]) + 1;
      zoom(apart(was) / apart([e.clientX, e.clientY]));
      pan(dx / 2, dy / 2);
    } else if (e.shiftKey || e.buttons & 6) {
      pan(dx, dy);
    } else {
      orbit(dx, dy);
    }
    down.set(e.pointerId, [e.clientX, e.clientY]);
  });
  const up = e => {
    down.delete(e.pointerId);
    canvas.classList.toggle('dragging', down.size > 0);
  };
  canvas.addEventListener('pointerup', up);
  canvas.addEventListener('pointercancel', up);
  canvas.addEventListener('contextmenu', e => e.preventDefault());
  canvas.addEventListener('dblclick', resetView);
  canvas.addEventListener('wheel', e => {
    e.preventDefault();
    zoom(Math.exp(clamp(e.deltaY * (e.deltaMode ? 20 : 1), -200, 200) * 0.0012));
  }, { passive: false });
}

// The fragment of the address: `#t=2.5&pause&yaw=30`.
function address() {
  const parts = new Map(location.hash.slice(1).split('&').map(part => part.split('=')));
  const number = (name, use) => {
    const value = Number(parts.get(name));
    if (parts.has(name) && Number.isFinite(value)) use(value);
  };
  number('t', seek);
  number('yaw', v => { state.yaw = v * Math.PI / 180; });
  number('pitch', v => { state.pitch = clamp(v, -3, 86) * Math.PI / 180; });
  number('zoom', v => { state.zoom = clamp(1 / (v || 1), 0.12, 6); });
  if ((parts.has('overlay') || oneWorld) && !parts.has('beside') && !state.overlay) toggle('overlay');
  if (parts.has('trails') && !state.trails) toggle('trails');
  if (parts.has('still') && state.follow) toggle('follow');
  // an address names a picture, not the way to it
  [state.overlaid, state.following] = [Number(state.overlay), Number(state.follow)];
  document.documentElement.classList.toggle('bare', parts.has('bare'));
  play(!parts.has('pause') && !parts.has('selftest'));
  theme();
  return parts;
}

function theme() {
  const asked = name => location.hash.slice(1).split('&').includes(name);
  const dark = asked('dark') || (!asked('light') && matchMedia('(prefers-color-scheme: dark)').matches);
  document.documentElement.classList.toggle('dark', dark);
  readColours();
}

// What is left where nothing can be drawn: a sentence, and the dances as files.
function withoutStage(error) {
  const trouble = $('trouble');
  trouble.textContent = `Nothing to see: ${error.message}. The dances: `;
  for (const f of figures) {
    const link = document.createElement('a'), now = new Float32Array(f.points * 3);
    const frame = i => { f.places(i / f.fps, now); return Array.from(now, v => Number(v.toFixed(4))); };
    link.textContent = link.download = `${f.title}.json`;
    link.href = '#';
    link.onclick = () => {
      const positions = Array.from({ length: f.frames }, (_, i) => frame(i));
      const text = JSON.stringify({ title: f.title, fps: f.fps, bones: f.bones.map(b => [b.a, b.b]), positions });
      link.href = URL.createObjectURL(new Blob([text], { type: 'application/json' }));
    };
    trouble.append(link, ' ');
  }
  trouble.append('(metres, a frame a row).');
  trouble.hidden = false;
  document.body.replaceChildren(trouble);
}

function start() {
  $('scrub').max = whole;
  const given = figures.some(f => f.bones.some(b => b.given)), anew = figures.some(f => f.anew.length);
  for (const [part, shown] of [['joints', given], ['time', anew]]) {
    for (const of of document.querySelectorAll(`#legend .of-${part}`)) of.hidden = !shown;
  }
  $('legend').hidden = !given && !anew;
  try {
    // the self-test counts pixels, often drawn by software: smooth edges would only cost it time
    scene = new Scene($('stage'), !location.hash.includes('selftest'));
  } catch (e) {
    withoutStage(e);
    return;
  }
  const parts = address();
  listen();
  scene.resize();
  show();
  if (parts.has('selftest')) selftest();
  requestAnimationFrame(stamp => { before = stamp; tick(stamp); });
}
