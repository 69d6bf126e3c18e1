// The page of `kinelm view`: its dances, music, marks and clock, on the stage that it shares with the studio.

const stage = new Stage();
const figures = JSON.parse($('figures').textContent).map(data => new Figure(data, decoded(data.data)));
stage.setFigures(figures);
const { state, colours } = stage;
const whole = stage.whole;

// ---- music, where there is some ----
const music = JSON.parse($('music').textContent);
const player = music && new Player(music, { ticks: $('ticks'), pulse: $('pulse'), button: $('sound'), length: whole });
stage.sound = player;

// ---- what was made anew: a mark on the bar for each stretch ----
for (const [from, to] of figures.flatMap(f => f.anew)) {
  const mark = document.createElement('i'), part = s => 100 * clamp(s, 0, whole) / (whole || 1);
  mark.style.left = `${part(from)}%`;
  mark.style.width = `${part(to) - part(from)}%`;
  $('anew').append(mark);
}

// ---- labels, with what is hit of the music's beats ----
const labels = new Labels($('labels'), stage);
labels.make((_, i) => `var(${tint(i)})`);
figures.forEach((f, i) => {
  if (!player || !f.hits) return;
  const kept = document.createElement('span'), light = document.createElement('i');
  light.className = 'light';
  kept.append(light, f.hits.says);
  labels.all[i].append(kept);
  player.hit(f.hits.beats, `var(${tint(i)})`, light);
});

// ---- what stands beside the dancers, where something does ----
const panels = [];

// ---- a picture ----
let scene;
function draw(plain = false) {
  stage.compose(plain);
  const view = stage.camera(scene.canvas.width, scene.canvas.height);
  scene.draw(view, stage.things, colours, plain);
  return view;
}

function show() {
  scene.resize();
  labels.place(draw().view, scene.canvas.clientWidth, scene.canvas.clientHeight);
  if (player) player.show(state.time);
  $('now').textContent = minutes(state.time);
  $('whole').textContent = ` / ${minutes(whole)}`;
  $('scrub').value = state.time;
  $('scrub').style.setProperty('--done', `${whole ? 100 * state.time / whole : 0}%`);
  for (const panel of panels) panel.show(state.time);
}
