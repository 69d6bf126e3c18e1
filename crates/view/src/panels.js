// Panels beside the dancers: curves, colours, stick figures, moments and tables. They know the page's time and no
// measure. A panel is { element, paint(), show(time) }: drawn once for each size and look, its playhead moved for each
// picture.

const [LEFT, EDGE] = [92, 10];                       // pixels beside a time axis, the same for all: moments are above each other
const GAP = 65535;                                   // the number of a value that isn't there

// One of SHADES, the colours of plots, which the page puts before this script.
function shade(part) {
  const at = clamp(part, 0, 1) * (SHADES.length - 1), i = Math.min(Math.floor(at), SHADES.length - 2), u = at - i;
  return `rgb(${SHADES[i].map((c, k) => Math.round(c + (SHADES[i + 1][k] - c) * u)).join()})`;
}

const part = (tag, name, ...content) => {
  const made = document.createElement(tag);
  if (name) made.className = name;
  made.append(...content);
  return made;
};
const look = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// A number as one reads it, to three digits.
function digits(x) {
  if (!Number.isFinite(x)) return '–';
  const size = Math.abs(x);
  return size === 0 || (size >= 0.01 && size < 1e5) ? String(Number(x.toPrecision(3))) : x.toExponential(1);
}

// A number over time, from its 16-bit numbers.
class Values {
  constructor(track) {
    Object.assign(this, { name: track.name, figure: track.figure, fps: track.fps, from: track.from, count: track.count });
    this.low = track.low;
    this.high = track.low + 65534 * track.step;
    const numbers = decoded(track.data);
    this.at = i => (numbers[i] === GAP ? NaN : track.low + track.step * numbers[i]);
    this.some = numbers.some(n => n !== GAP);
  }

  // The value nearest to a time; NaN where there is none.
  when(time) {
    const at = (time - this.from) * this.fps;
    return at > -1 && at < this.count ? this.at(clamp(Math.round(at), 0, this.count - 1)) : NaN;
  }

  // Least and greatest of the values in a stretch of time, so that no peak is lost where a pixel has many.
  range(from, upto) {
    const first = Math.max(0, Math.ceil((from - this.from) * this.fps)), last = Math.min(this.count - 1, Math.floor((upto - this.from) * this.fps));
    if (last < first) {
      const value = this.when((from + upto) / 2);
      return [value, value];
    }
    let low = Infinity, high = -Infinity;
    for (let i = first; i <= last; i++) {
      const value = this.at(i);
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
    return [low, high];
  }
}

// What has a time axis: a canvas, a playhead, and a click that seeks.
class Timed {
  constructor(title, height) {
    this.canvas = part('canvas');
    this.head = part('i', 'playhead');
    this.way = part('div', 'over-time', this.canvas, this.head);
    this.way.style.height = `${height}px`;
    this.height = height;
    this.legend = part('p', 'values');
    this.element = part('section', '', part('h2', '', title), this.legend, this.way);
    const seekTo = e => {
      const box = this.canvas.getBoundingClientRect();
      seek(whole * clamp((e.clientX - box.left - LEFT) / (box.width - LEFT - EDGE), 0, 1));
    };
    this.way.onpointerdown = e => {
      this.way.setPointerCapture(e.pointerId);
      seekTo(e);
    };
    this.way.onpointermove = e => e.buttons && seekTo(e);
    this.readouts = [];
  }

  // One entry a track: its colour, its name and its value at the playhead.
  name(tracks, unit, dots) {
    for (const track of tracks) {
      const value = part('b'), entry = part('span', '', dots ? part('i') : '', track.name ? `${track.name} ` : '', value);
      entry.style.setProperty('--own', `var(${tint(track.figure)})`);
      this.legend.append(entry);
      this.readouts.push(time => {
        const text = `${digits(track.when(time))}${unit && ` ${unit}`}`;
        if (value.textContent !== text) value.textContent = text;
      });
    }
  }

  x(time) {
    return LEFT + (this.width - LEFT - EDGE) * (whole ? clamp(time / whole, 0, 1) : 0);
  }

  paint() {
    const scale = window.devicePixelRatio || 1;
    this.width = this.way.clientWidth;
    if (!this.width) return;                         // in a group that isn't shown
    this.canvas.width = Math.round(this.width * scale);
    this.canvas.height = Math.round(this.height * scale);
    const pen = this.canvas.getContext('2d');
    pen.scale(scale, scale);
    pen.font = '11px system-ui, sans-serif';
    this.drawOn(pen, { ink: look('--ink'), quiet: look('--quiet'), line: look('--line') });
    this.show(state.time);
  }

  show(time) {
    if (!this.width) return;
    this.head.style.transform = `translateX(${this.x(time).toFixed(1)}px)`;
    for (const read of this.readouts) read(time);
  }

  // Seconds below, at steps that leave room for their numbers.
  axis(pen, { quiet }, y) {
    const room = (this.width - LEFT - EDGE) / 56, steps = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1800, 3600];
    const step = steps.find(s => whole / s <= room) || 7200;
    pen.fillStyle = quiet;
    pen.textAlign = 'center';
    pen.textBaseline = 'top';
    for (let t = 0; t <= whole + 1e-9; t += step) pen.fillText(t < 60 ? `${t} s` : minutes(t).replace(/\.0$/, ''), this.x(t), y);
  }
}

class LinesPanel extends Timed {
  constructor({ title, unit, tracks }) {
    super(unit ? `${title}, ${unit}` : title, 128);
    this.tracks = tracks.map(track => new Values(track));
    this.name(this.tracks, '', true);
    const seen = this.tracks.filter(track => track.some);
    this.low = Math.min(...seen.map(track => track.low), Infinity);
    this.high = Math.max(...seen.map(track => track.high), -Infinity);
    // 0 is shown where it is near, or distances would look like differences
    if (this.low > 0 && this.low < 0.6 * this.high) this.low = 0;
    if (!(this.high > this.low)) this.high = this.low + 1;
  }

  drawOn(pen, colours) {
    const [top, bottom] = [8, this.height - 20], { low, high } = this;
    const y = value => bottom - (bottom - top) * (value - low) / (high - low);
    this.axis(pen, colours, bottom + 5);
    if (!Number.isFinite(low)) return;
    pen.textAlign = 'right';
    pen.textBaseline = 'middle';
    pen.strokeStyle = colours.line;
    for (const value of [low, (low + high) / 2, high]) {
      pen.fillText(digits(value), LEFT - 6, y(value));
      pen.beginPath();
      pen.moveTo(LEFT, Math.round(y(value)) + 0.5);
      pen.lineTo(this.width - EDGE, Math.round(y(value)) + 0.5);
      pen.stroke();
    }
    for (const track of this.tracks) {
      pen.strokeStyle = look(tint(track.figure));
      pen.lineWidth = 1.5;
      pen.beginPath();
      let drawing = false;
      for (let x = LEFT; x <= this.width - EDGE; x++) {
        const time = s => whole * (s - LEFT) / (this.width - LEFT - EDGE);
        const [least, most] = track.range(time(x - 0.5), time(x + 0.5));
        if (!Number.isFinite(least) || !Number.isFinite(most)) {
          drawing = false;
          continue;
        }
        if (drawing) pen.lineTo(x, y(most)); else pen.moveTo(x, y(most));
        if (most > least) pen.lineTo(x, y(least));
        drawing = true;
      }
      pen.stroke();
    }
  }
}

class BandsPanel extends Timed {
  constructor({ title, unit, tracks, range }) {
    const row = tracks.length > 12 ? Math.max(3, Math.floor(220 / tracks.length)) : 18;
    super(unit ? `${title}, ${unit}` : title, tracks.length * row + 20);
    this.row = row;
    this.tracks = tracks.map(track => new Values(track));
    const seen = this.tracks.filter(track => track.some);
    [this.low, this.high] = range || [Math.min(...seen.map(track => track.low)), Math.max(...seen.map(track => track.high))];
    const ramp = part('i', 'ramp');
    ramp.style.background = `linear-gradient(90deg, ${SHADES.map((_, i) => shade(i / (SHADES.length - 1))).join()})`;
    if (seen.length) this.legend.append(part('span', '', `${digits(this.low)} `, ramp, ` ${digits(this.high)}`));
  }

  drawOn(pen, colours) {
    const { row, low, high } = this, size = high - low || 1, every = Math.ceil(13 / row);
    this.tracks.forEach((track, i) => {
      const top = i * row;
      for (let x = LEFT; x < this.width - EDGE; x++) {
        const time = whole * (x + 0.5 - LEFT) / (this.width - LEFT - EDGE), half = whole / (this.width - LEFT - EDGE) / 2;
        // the highest of what falls on a pixel: a peak is what one looks for
        const value = track.range(time - half, time + half)[1];
        if (!Number.isFinite(value)) continue;
        pen.fillStyle = shade((value - low) / size);
        pen.fillRect(x, top, 1.5, row > 6 ? row - 2 : row);
      }
      if (i % every) return;
      pen.fillStyle = colours.quiet;
      pen.textAlign = 'right';
      pen.textBaseline = 'middle';
      pen.fillText(track.name, LEFT - 6, top + Math.max(row, 12) / 2 - 1, LEFT - 10);
    });
    this.axis(pen, colours, this.tracks.length * row + 5);
  }
}

class StripPanel extends Timed {
  constructor({ title, figure, every }) {
    super(title, 104);
    this.figure = figures[figure];
    this.index = figure;
    this.every = every;
    this.places = new Float32Array(this.figure.points * 3);
  }

  drawOn(pen, colours) {
    const { figure, places } = this, bottom = this.height - 20, size = (bottom - 6) / (figure.top || 1);
    const room = 34 / (this.width - LEFT - EDGE) * (whole || 1), every = this.every * Math.max(1, Math.ceil(room / this.every));
    pen.strokeStyle = look(tint(this.index));
    pen.lineCap = 'round';
    pen.lineWidth = 1.6;
    for (let time = 0; time <= figure.lasts + 1e-9; time += every) {
      figure.places(time, places);
      const at = this.x(time) - size * places[0];    // each stands at its moment, wherever it danced to
      pen.beginPath();
      for (const { a, b } of figure.bones) {
        pen.moveTo(at + size * places[3 * a], bottom - size * places[3 * a + 1]);
        pen.lineTo(at + size * places[3 * b], bottom - size * places[3 * b + 1]);
      }
      pen.stroke();
    }
    this.axis(pen, colours, bottom + 5);
  }
}

function momentsPanel({ title, moments }) {
  const buttons = moments.map(({ label, at, figure }) => {
    const button = part('button', 'moment', part('i'), part('b', '', minutes(at)), ` ${label}`);
    button.style.setProperty('--own', `var(${tint(figure)})`);
    button.onclick = () => seek(at);
    return button;
  });
  return { element: part('section', '', part('h2', '', title), part('div', 'moments', ...buttons)), paint() {}, show() {} };
}

function factsPanel({ title, head, rows }) {
  const row = (tag, cells) => part('tr', '', ...cells.map(cell => part(tag, '', cell)));
  const table = part('table', '', ...(head.length ? [part('thead', '', row('th', head))] : []), part('tbody', '', ...rows.map(cells => row('td', cells))));
  return { element: part('section', '', part('h2', '', title), table), paint() {}, show() {} };
}

function choicePanel({ title, options }) {
  const menu = part('select'), place = part('div', 'chosen'), groups = options.map(() => null);
  menu.append(...options.map(({ name }, i) => Object.assign(part('option', '', name), { value: i })));
  menu.setAttribute('aria-label', title);
  let shown = [];
  const choose = () => {
    const i = Number(menu.value);
    // a group is made when it is first chosen: of a body's joints most never are
    groups[i] = groups[i] || options[i].panels.map(panelOf);
    shown = groups[i];
    place.replaceChildren(...shown.map(panel => panel.element));
    shown.forEach(panel => panel.paint());
  };
  menu.onchange = choose;
  const element = part('div', 'choice', part('label', '', `${title} `, menu), place);
  return { element, begin: choose, paint: () => shown.forEach(p => p.paint()), show: time => shown.forEach(p => p.show(time)) };
}

const PANELS = {
  lines: data => new LinesPanel(data),
  bands: data => new BandsPanel(data),
  strip: data => new StripPanel(data),
  moments: momentsPanel,
  facts: factsPanel,
  choice: choicePanel,
  words: data => new WordsPanel(data),
};
const panelOf = data => PANELS[data.kind](data);

panels.push(...JSON.parse($('panel-data').textContent).map(panelOf));
$('panels').append(...panels.map(panel => panel.element));
$('panels').hidden = false;
document.documentElement.classList.add('docked');
for (const panel of panels) if (panel.begin) panel.begin();
const paintPanels = () => panels.forEach(panel => panel.paint());
window.addEventListener('resize', paintPanels);
