// The page's own test, at `#selftest`: what is drawn, counted in pixels, and what the controls do. The result stands as
// JSON in <pre id="selftest">, where a headless browser's `--dump-dom` finds it.

const as255 = colour => colour.map(v => Math.round(v * 255));

// Pixels of each figure's own colour, and of the colour of given joints, in a drawing without light.
function counted() {
  draw(true);
  const bytes = scene.pixels(), own = figures.map(() => 0);
  const key = (r, g, b) => r << 16 | g << 8 | b;
  const of = new Map(figures.map((f, i) => [key(...as255(f.colour)), i]));
  const givenKey = key(...as255(colours.given));
  let given = 0;
  for (let i = 0; i < bytes.length; i += 4) {
    const k = key(bytes[i], bytes[i + 1], bytes[i + 2]);
    if (k === givenKey) given++;
    else if (of.has(k)) own[of.get(k)]++;
  }
  return { time: state.time, own, given };
}

// Share of the pixels that differ by more than a shade between two pictures as the user sees them.
function changed(timeA, timeB) {
  const picture = time => { seek(time); draw(); return scene.pixels(); };
  const a = picture(timeA), b = picture(timeB);
  let differ = 0;
  for (let i = 0; i < a.length; i += 4) {
    differ += Math.abs(a[i] - b[i]) + Math.abs(a[i + 1] - b[i + 1]) + Math.abs(a[i + 2] - b[i + 2]) > 24;
  }
  return differ / (a.length / 4);
}

function controls() {
  const key = k => document.dispatchEvent(new KeyboardEvent('keydown', { key: k }));
  const pointer = (type, x, y, more = {}) => scene.canvas.dispatchEvent(
    new PointerEvent(type, { pointerId: 1, clientX: x, clientY: y, buttons: 1, bubbles: true, ...more }));
  const drag = more => { pointer('pointerdown', 300, 300); pointer('pointermove', 360, 320, more); pointer('pointerup', 360, 320); };
  const result = {};
  key(' ');
  result.space_plays = state.playing;
  $('play').click();
  result.button_pauses = !state.playing;
  $('scrub').value = whole / 2;
  $('scrub').dispatchEvent(new Event('input'));
  result.scrub_seeks = Math.abs(state.time - whole / 2) < 1e-6 * (1 + whole);
  key(']');
  const faster = state.speed;
  key('[');
  result.keys_set_speed = faster > 1 && state.speed === 1;
  play(true);
  seek(0);
  stage.advance(0.05);
  state.speed = 0.25;
  stage.advance(0.1);
  state.speed = 1;
  result.time_runs_at_speed = Math.abs(state.time - Math.min(0.075, whole)) < 1e-9;
  seek(whole);
  for (let i = 0; i < 40; i++) stage.advance(0.05);
  result.loops = state.time < whole || whole === 0;
  toggle('loop');
  for (let i = 0; i < 2 * (whole + 1) / 0.1; i++) stage.advance(0.1);
  result.stops_without_loop = state.time === whole && !state.playing;
  toggle('loop');
  drag();
  result.drag_orbits = state.yaw !== HOME.yaw && state.pitch !== HOME.pitch;
  drag({ shiftKey: true });
  result.shift_drag_pans = state.pan.some(v => v !== 0);
  scene.canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: -120, cancelable: true }));
  result.wheel_zooms = state.zoom < 1;
  pointer('pointerdown', 200, 300);
  pointer('pointerdown', 400, 300, { pointerId: 2 });
  const zoomBefore = state.zoom;
  pointer('pointermove', 500, 300, { pointerId: 2 });
  pointer('pointerup', 200, 300);
  pointer('pointerup', 500, 300, { pointerId: 2 });
  result.pinch_zooms = state.zoom < zoomBefore;
  key('f');
  result.reset = state.zoom === 1 && state.yaw === HOME.yaw && state.pan.every(v => v === 0);
  return result;
}

// Columns of the picture that figures of colour `a` and `b` both have pixels in: 0 when they stand apart.
function sharedColumns() {
  draw(true);
  const bytes = scene.pixels(), { width } = scene.canvas;
  const keys = figures.map(f => as255(f.colour).join());
  const columns = new Map();
  for (let i = 0; i < bytes.length; i += 4) {
    const n = keys.indexOf(`${bytes[i]},${bytes[i + 1]},${bytes[i + 2]}`);
    if (n >= 0) columns.set(i / 4 % width, (columns.get(i / 4 % width) || new Set()).add(n));
  }
  return [...columns.values()].filter(seen => seen.size > 1).length;
}

// Milliseconds for one picture: of the script that makes it up, with the calls that draw it, and until it is finished
// (where no graphics card helps, the last says how slow drawing by software is).
function cost() {
  const run = (times, what) => {
    const begin = performance.now();
    for (let i = 0; i < times; i++) {
      seek(whole * (i + 0.5) / times);
      what();
    }
    return (performance.now() - begin) / times;
  };
  const one = new Uint8Array(4), gl = scene.gl;
  // reading a pixel waits for the picture; finish() doesn't everywhere
  const finish = () => { show(); gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, one); };
  const script_ms = run(200, () => {
    stage.compose();
    labels.place(stage.camera(scene.canvas.width, scene.canvas.height).view, scene.canvas.clientWidth, scene.canvas.clientHeight);
  });
  finish();
  const calls_ms = run(2, show);
  finish();
  return { capsules: stage.things.capsuleCount, script_ms, calls_ms, finished_ms: run(2, finish) };
}

function selftest() {
  const result = { figures: figures.length, width: scene.canvas.width, height: scene.canvas.height, whole };
  try {
    result.counts = [0, 0.45, 1].map(part => { seek(part * whole); return counted(); });
    result.changed = changed(0, whole * 0.45);
    result.unchanged = changed(whole * 0.45, whole * 0.45);
    seek(whole * 0.45);
    result.shared_columns = sharedColumns();
    state.overlaid = 1;
    result.shared_columns_overlaid = sharedColumns();
    state.overlaid = 0;
    result.controls = controls();
    result.cost = cost();
    toggle('trails');
    result.cost_with_trails = cost();
    toggle('trails');
    result.labels = labels.all.map(l => l.textContent);
    result.legend = !$('legend').hidden;
    result.anew = [...$('anew').children].map(mark => [mark.style.left, mark.style.width].map(parseFloat));
    result.gl_error = scene.gl.getError();
  } catch (e) {
    result.error = String(e.stack || e);
  }
  const pre = document.createElement('pre');
  pre.id = 'selftest';
  pre.hidden = true;
  pre.textContent = JSON.stringify(result);
  document.body.append(pre);
}

start();
