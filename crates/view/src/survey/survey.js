// A survey: a trial's dancers on the stage, a button for each answer, and the votes.

const survey = JSON.parse($('survey').textContent);
const stage = new Stage(), labels = new Labels($('labels'), stage);
const { state, colours } = stage;
const KEY = `kinelm-votes-${survey.page}`;
labels.top = 84;
stage.margin = { high: 0.34, low: -0.09 };             // the question above, the answers below

// ---- votes: by trial, from 0, the answer and the seconds that it took ----
let votes = { voter: newVoter(), by: {} };
let at = 0, shown = 0, scene;

function newVoter() {
  return Array.from(crypto.getRandomValues(new Uint8Array(8)), b => b.toString(16).padStart(2, '0')).join('');
}

// Browsers may refuse storage to files: votes then last as long as the page.
function keep() {
  try {
    localStorage.setItem(KEY, JSON.stringify(votes));
  } catch {
    $('note').hidden = false;
  }
}

function recall() {
  try {
    const known = JSON.parse(localStorage.getItem(KEY));
    if (known && typeof known.voter === 'string' && known.by) votes = known;
  } catch { /* the note says so when something is to be kept */ }
  keep();
}

function votesText() {
  const all = Object.keys(votes.by).map(Number).sort((a, b) => a - b);
  return JSON.stringify({ schema: 1, page: survey.page, voter: votes.voter,
    votes: all.map(trial => ({ trial, choice: votes.by[trial].choice, seconds: votes.by[trial].seconds })) });
}

function save() {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([votesText()], { type: 'application/json' }));
  link.download = `votes-${votes.voter}.json`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function vote(choice) {
  votes.by[at] = { choice, seconds: Math.round((performance.now() - shown) / 100) / 10 };
  keep();
  show(at + 1);
}

// ---- a trial ----
function show(trial) {
  const count = survey.trials.length, done = Object.keys(votes.by).length;
  $('end').hidden = trial < count;
  at = Math.min(trial, count - 1);
  if (trial < count) {
    stage.setFigures(survey.trials[at].map(data => new Figure(data, decoded(data.data))));
    labels.make((_, i) => `var(${tint(i)})`);
    readTheme(stage);
    stage.resetView();
    stage.seek(0);
    stage.play(!state.stopped);
    shown = performance.now();
  }
  $('progress').textContent = `${at + 1} of ${count}${done ? `, ${done} answered` : ''}`;
  $('back').disabled = at === 0;
  $('save').disabled = !done;
  [...$('choices').children].forEach((button, i) => {
    button.setAttribute('aria-pressed', String(votes.by[at]?.choice === i));
  });
}

function draw() {
  scene.resize();
  stage.compose();
  const view = stage.camera(scene.canvas.width, scene.canvas.height);
  scene.draw(view, stage.things, colours, false);
  labels.place(view.view, scene.canvas.clientWidth, scene.canvas.clientHeight);
}

function replay() {
  stage.seek(0);
  stage.play(true);
}

function listen() {
  survey.choices.forEach((text, i) => {
    const button = document.createElement('button');
    button.textContent = text;
    button.title = `Key ${i + 1}`;
    button.onclick = () => vote(i);
    $('choices').append(button);
  });
  $('back').onclick = () => show(Math.max(at - 1, 0));
  $('replay').onclick = replay;
  $('save').onclick = $('save-all').onclick = save;
  $('again').onclick = () => show(0);
  document.addEventListener('keydown', e => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.repeat || !$('end').hidden) return;
    const choice = Number(e.key) - 1;
    if (e.key === ' ' && e.target.tagName !== 'BUTTON') replay();
    else if (e.key === 'ArrowLeft') show(Math.max(at - 1, 0));
    else if (survey.choices[choice]) vote(choice);
    else return;
    e.preventDefault();
  });
  const theme = () => readTheme(stage);
  addEventListener('hashchange', theme);
  listenToWindow(stage, scene, theme);
  listenToPointers(scene.canvas, stage);
}

function start() {
  try {
    scene = new Scene($('stage'), true);
  } catch (e) {
    $('trouble').textContent = `Nothing to see: ${e.message}. Please open this page in another browser.`;
    $('trouble').hidden = false;
    $('foot').hidden = true;
    return;
  }
  state.stopped = location.hash.includes('pause');
  recall();
  listen();
  // where one left off; all answered: the end
  const open = survey.trials.findIndex((_, trial) => !votes.by[trial]);
  show(open < 0 ? survey.trials.length : open);
  run(stage, draw);
}

start();
