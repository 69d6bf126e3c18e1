// What the user does: buttons, keys, mouse, touch, and the address.

const play = on => stage.play(on);
const seek = time => stage.seek(time);
stage.onPlay = () => document.documentElement.classList.toggle('playing', state.playing);

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
  f: () => stage.resetView(),
  m: () => player && player.mute(!player.muted),
};

function listen() {
  $('play').onclick = () => play(!state.playing);
  $('scrub').oninput = e => seek(Number(e.target.value));
  $('speed').onchange = e => { state.speed = Number(e.target.value); };
  for (const name of ['loop', 'follow', 'overlay', 'trails']) $(name).onclick = () => toggle(name);
  $('reset').onclick = () => stage.resetView();
  document.addEventListener('keydown', e => {
    const does = KEYS[e.key.length === 1 ? e.key.toLowerCase() : e.key];
    // the list of speeds keeps its own keys; everywhere else a key means the same
    if (!does || e.ctrlKey || e.metaKey || e.altKey || e.target === $('speed')) return;
    e.preventDefault();
    does();
  });
  listenToWindow(stage, scene, theme);
  window.addEventListener('hashchange', () => { address(); state.dirty = true; });
  const pressed = panels.find(panel => panel.press);
  listenToPointers(scene.canvas, stage, pressed && ((x, y) => pressed.press(x, y)));
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
  if ((parts.has('overlay') || stage.oneWorld) && !parts.has('beside') && !state.overlay) toggle('overlay');
  if (parts.has('trails') && !state.trails) toggle('trails');
  // a path is seen whole where the camera stays
  if ((parts.has('still') || figures.some(f => f.paths.length)) && state.follow) toggle('follow');
  // an address names a picture, not the way to it
  [state.overlaid, state.following] = [Number(state.overlay), Number(state.follow)];
  document.documentElement.classList.toggle('bare', parts.has('bare'));
  stage.margin = parts.has('bare') ? { high: 0.13, low: 0.04 } : { high: 0.24, low: -0.015 };
  play(!parts.has('pause') && !parts.has('selftest'));
  theme();
  return parts;
}

function theme() {
  readTheme(stage);
  for (const panel of panels) panel.paint();
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
  run(stage, show);
}
