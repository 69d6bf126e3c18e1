// What any page does: its colours, and a new picture whenever something has changed.

const $ = id => document.getElementById(id);
// The style sheet's name of a figure's colour, or of what is of none.
const tint = figure => (figure === null ? '--quiet' : `--figure-${figure % 6}`);
const minutes = s => `${Math.floor(s / 60)}:${(s % 60 < 9.95 ? '0' : '') + (s % 60).toFixed(1)}`;

// Light or dark, as the address says, else the system; the stage's colours are those of the style sheet.
function readTheme(stage) {
  const asked = name => location.hash.slice(1).split('&').includes(name);
  const dark = asked('dark') || (!asked('light') && matchMedia('(prefers-color-scheme: dark)').matches);
  document.documentElement.classList.toggle('dark', dark);
  const style = getComputedStyle(document.documentElement), { colours } = stage;
  const rgb = name => [1, 3, 5].map(i => parseInt(style.getPropertyValue(name).trim().slice(i, i + 2), 16) / 255);
  for (const name of ['floor', 'line', 'ink', 'given']) colours[name] = rgb(`--${name}`);
  colours.shadow = parseFloat(style.getPropertyValue('--shadow'));
  stage.figures.forEach((f, i) => { f.colour = rgb(tint(i)); });
  stage.state.dirty = true;
}

// What the window and the system do.
function listenToWindow(stage, scene, theme) {
  window.addEventListener('resize', () => { stage.state.dirty = true; });
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', theme);
  scene.canvas.addEventListener('webglcontextlost', e => e.preventDefault());
  scene.canvas.addEventListener('webglcontextrestored', () => { scene.build(); stage.state.dirty = true; });
}

// Lets the stage's time pass, and shows what has changed.
function run(stage, show) {
  let before;
  const tick = stamp => {
    stage.advance(clamp((stamp - (before ?? stamp)) / 1000, 0, 0.1));
    before = stamp;
    if (stage.state.dirty) {
      stage.state.dirty = false;
      show();
    }
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}
