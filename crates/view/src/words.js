// Words beside the body that they decode to. The text stands in blocks of a few words; only the block of the page's
// time is elements. A character names what it stands for and lights its joints; a joint pressed marks its characters.

const BLOCK = 500;                                   // characters of a block, unless one word has more
const NAMED = 8;                                     // parts and numbers that are named, before "and n more"

const floats = text => new Float32Array(decoded(text).buffer, 0, decoded(text).length >> 1);

class WordsPanel {
  constructor(data) {
    Object.assign(this, data);
    this.body = figures[data.figure];
    this.word_s = data.frames / data.fps;
    // of each word its first character, counted without spaces; and one after the last
    this.starts = [0];
    for (let i = data.text.indexOf(' '); i >= 0; i = data.text.indexOf(' ', i + 1)) this.starts.push(i + 1 - this.starts.length);
    this.count = this.starts.length - 1;
    const { senses } = data, all = this.starts[this.count];
    if (senses.tables !== undefined) {
      const values = floats(senses.tables), codes = new Map([...senses.characters].map((c, code) => [c, code]));
      this.valueOf = (i, at) => values[senses.of[at] * senses.size + codes.get(this.character(i, this.wordOf(i)))];
      this.movesOf = () => 1;
      this.isZeros = () => false;
    } else {
      const values = floats(senses.values), moves = decoded(senses.moves);
      this.valueOf = i => values[i];
      this.movesOf = i => moves[i];
      this.isZeros = i => moves[i] > 0 && Number.isNaN(values[i]);
    }
    this.joined = new Uint8Array(all);               // whether a character goes on with the token before it
    let first = 0;
    for (const length of decoded(data.tokens)) {
      this.joined.fill(1, first + 1, first + length);
      first += length;
    }
    this.blocks = [0];                               // the first word of each
    for (let w = 1; w < this.count; w++) {
      if (this.starts[w + 1] - this.starts[this.blocks.at(-1)] > BLOCK) this.blocks.push(w);
    }
    this.marked = -1;                                // the joint whose characters are marked
    this.block = this.now = -1;
    this.make();
  }

  make() {
    this.box = part('div', 'words');
    this.box.setAttribute('aria-label', `Words: arrow keys go from character to character`);
    this.box.setAttribute('role', 'group');
    this.naming = part('div', 'naming');
    this.naming.setAttribute('role', 'status');
    const coded = [...new Set(this.series.flatMap(s => s.joints.map(([joint]) => joint)))].sort((a, b) => a - b);
    this.menu = part('select', '', Object.assign(part('option', '', 'none'), { value: -1 }),
      ...coded.map(joint => Object.assign(part('option', '', this.names[joint]), { value: joint })));
    this.menu.onchange = () => this.mark(Number(this.menu.value));
    const length = this.starts[this.count] / (this.count || 1);
    const says = `A word is a ${this.word}${this.frames > 1 ? ` of ${this.frames} frames` : ''}, ${digits(this.word_s)} s, ${digits(length)} characters${Number.isInteger(length) ? '' : ' on average'}.`;
    this.element = part('section', 'of-words', part('h2', '', this.title), part('p', 'values', says), this.box, this.naming,
      part('label', 'mark', 'Mark the characters of ', this.menu, ' or press a joint on the body'));
    const at = e => e.target.closest('.words span');
    this.box.addEventListener('pointerover', e => this.name(at(e)));
    this.box.addEventListener('pointerleave', () => this.name(document.activeElement.closest('.words span')));
    this.box.addEventListener('focusin', e => this.name(at(e)));
    this.box.addEventListener('focusout', () => this.name(null));
    this.box.addEventListener('click', e => at(e) && this.focus(Number(at(e).dataset.at)));
    this.box.addEventListener('keydown', e => this.key(e));
    this.name(null);
  }

  // ---- where things are ----
  wordOf(i) {
    let low = 0, high = this.count - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.starts[middle] <= i) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  character(i, word) {
    return this.text[i + word];                      // a space after each word before it
  }

  // The place of each character of a word among the word's numbers, how many numbers it takes, and whether as zeros.
  placesOf(word) {
    const places = [];
    let at = 0;
    for (let i = this.starts[word]; i < this.starts[word + 1]; i++) {
      places.push([at, this.movesOf(i), this.isZeros(i)]);
      at += this.movesOf(i);
    }
    return places;
  }

  // The series that a character says something about, without repetition.
  seriesOf([at, moves]) {
    return [...new Set(this.numbers.slice(at, at + Math.max(moves, 1)).map(([series]) => series))];
  }

  // ---- the block of a time ----
  // A block under the pointer or with the focus stays until they leave it.
  get kept() {
    return this.box.matches(':hover') || this.box.contains(document.activeElement);
  }

  show(time) {
    const word = clamp(Math.floor(time / this.word_s + 1e-6), 0, this.count - 1);
    if (word === this.now || !this.count) return;
    this.now = word;
    if (!this.kept) this.fill(word);
    for (const row of this.box.children) row.classList.toggle('now', Number(row.dataset.word) === word);
    const row = this.box.querySelector('.now');
    // where the block is higher than the box, the word of the time comes first
    if (row && !this.kept && this.box.scrollHeight > this.box.clientHeight) this.box.scrollTop = row.offsetTop - this.box.offsetTop;
  }

  fill(word) {
    let block = this.blocks.length - 1;
    while (this.blocks[block] > word) block--;
    if (block === this.block) return;
    this.block = block;
    const rows = [];
    for (let w = this.blocks[block]; w < (this.blocks[block + 1] ?? this.count); w++) rows.push(this.row(w));
    this.box.replaceChildren(...rows);
    // one stop for the tab key
    const first = this.box.querySelector('span');
    if (first) first.tabIndex = 0;
  }

  row(word) {
    const row = part('div', 'word', part('b', '', String(word)));
    row.dataset.word = word;
    this.placesOf(word).forEach((place, k) => {
      const i = this.starts[word] + k, span = part('span', this.joined[i] ? 'token joined' : this.joined[i + 1] ? 'token' : '', this.character(i, word));
      span.dataset.at = i;
      span.tabIndex = -1;
      span.classList.toggle('marked', this.isMarked(place));
      row.append(span);
    });
    return row;
  }

  // Whether a character says something else of the marked joint than that numbers are zero.
  isMarked([at, , zeros]) {
    const { joints } = this.series[this.numbers[at]?.[0]] ?? { joints: [] };
    return !zeros && joints.some(([joint]) => joint === this.marked);
  }

  // ---- naming ----
  // The token of a character: its first character and the one after its last.
  tokenOf(i) {
    let from = i, upto = i + 1;
    while (this.joined[from]) from--;
    while (this.joined[upto]) upto++;
    return [from, upto];
  }

  numberName(at) {
    const [series, coefficient] = this.numbers[at], { name } = this.series[series];
    if (coefficient === null) return name;
    return `${name}, coefficient ${coefficient}${coefficient ? ` (${digits(coefficient / 2 / this.word_s)} Hz)` : ''}`;
  }

  says(i, [at, moves, zeros]) {
    if (at >= this.numbers.length) return 'nothing: the word has no more numbers';
    if (moves && !zeros) {
      const { unit } = this.series[this.numbers[at][0]];
      return `${this.numberName(at)}: ${digits(this.valueOf(i, at))}${unit[0] === '°' ? '' : ' '}${unit}`;
    }
    if (!moves) return `a digit of the number that follows: ${this.numberName(at)}`;
    const runs = [];                                  // coefficients of a series that follow one another
    const skipped = this.numbers.slice(at, at + moves);
    skipped.forEach(([series, coefficient], k) => {
      const last = runs.at(-1);
      if (last && last.series === series && last.upto + 1 === coefficient) last.upto = coefficient;
      else runs.push({ series, at: at + k, from: coefficient, upto: coefficient });
    });
    const names = runs.map(({ series, at: first, from, upto }) => (upto > from ? `${this.series[series].name}, coefficients ${from} to ${upto}` : this.numberName(first)));
    return `${skipped.length === 1 ? 'a zero' : `${skipped.length} zeros`}: ${this.few(names)}`;
  }

  few(names, comma = '; ') {
    return names.length > NAMED ? `${names.slice(0, NAMED - 1).join(comma)} and ${names.length - NAMED + 1} more` : names.join(comma);
  }

  // Names what a character and its token stand for, and lights its joints; without one, the marked joint.
  name(span) {
    for (const other of this.box.querySelectorAll('.here')) other.classList.remove('here');
    if (!span) {
      this.light(this.marked < 0 ? [] : [this.marked]);
      this.naming.replaceChildren(part('p', '', 'Point at a character, or go to it with the arrow keys.'));
      return;
    }
    const i = Number(span.dataset.at), word = this.wordOf(i), [from, upto] = this.tokenOf(i), places = this.placesOf(word);
    const all = Array.from({ length: upto - from }, (_, k) => [from + k, places[from + k - this.starts[word]]]);
    for (const own of span.parentElement.children) own.classList.toggle('here', own.dataset.at >= from && own.dataset.at < upto);
    const first = word * this.frames, time = minutes(word * this.word_s);
    const place = this.frames > 1 ? `${this.word} ${word}, frames ${first} to ${first + this.frames - 1}, from ${time}` : `${this.word} ${word}, at ${time}`;
    const lines = all.map(([at, numbers]) => part('p', '', part('span', 'glyph', this.character(at, word)), this.says(at, numbers)));
    if (lines.length > NAMED) lines.splice(NAMED - 1, lines.length, part('p', '', `and ${lines.length - NAMED + 1} more`));
    const series = [...new Set(all.flatMap(([, numbers]) => this.seriesOf(numbers)))], joints = new Map();
    for (const s of series) for (const [joint, share] of this.series[s].joints) joints.set(joint, Math.max(share, joints.get(joint) ?? 0));
    const sorted = [...joints].sort((a, b) => b[1] - a[1]);
    const shared = ([joint, share]) => this.names[joint] + (series.length === 1 && share < 0.995 ? ` ${Math.round(100 * share)} %` : '');
    const verb = all.every(([, [, , zeros]]) => zeros) ? 'would move' : 'moves';
    this.naming.replaceChildren(part('p', 'place', place), ...lines, part('p', 'joints', `${verb} ${this.few(sorted.map(shared), ', ')}`));
    this.light(sorted.map(([joint]) => joint));
  }

  light(joints) {
    const points = new Uint8Array(this.body.points);
    for (const joint of joints) points[joint] = 1;
    this.body.selected = points;
    state.dirty = true;
  }

  // ---- what the user does ----
  mark(joint) {
    this.marked = joint;
    this.menu.value = joint;
    if (this.menu.value !== String(joint)) this.menu.value = -1;
    for (const row of this.box.children) {
      this.placesOf(Number(row.dataset.word)).forEach((place, k) => row.children[k + 1].classList.toggle('marked', this.isMarked(place)));
    }
    this.name(null);
  }

  // A press on the stage.
  press(x, y) {
    const found = picked(stage, [this.body], x, y, scene.canvas), joint = found ? found.joint : -1;
    this.mark(joint < this.names.length && joint !== this.marked ? joint : -1);
  }

  focus(i) {
    const word = this.wordOf(i);
    play(false);
    this.fill(word);
    seek((word + 1e-3) * this.word_s);
    const span = this.box.querySelector(`[data-at="${i}"]`);
    if (span) span.focus();
  }

  key(e) {
    const span = e.target.closest('.words span');
    if (!span || e.ctrlKey || e.metaKey || e.altKey) return;
    const i = Number(span.dataset.at), word = this.wordOf(i), last = this.starts[this.count] - 1;
    const along = (step, k = i - this.starts[word]) => {
      let there = word + step;                       // words of zeros alone are empty
      while (this.starts[there] === this.starts[there + 1]) there += step;
      return there < 0 || there >= this.count ? i : Math.min(this.starts[there] + k, this.starts[there + 1] - 1);
    };
    const to = { ArrowLeft: i - 1, ArrowRight: i + 1, ArrowUp: along(-1), ArrowDown: along(1) }[e.key];
    if (to === undefined) return;
    e.preventDefault();
    e.stopPropagation();                             // on the page they step through frames
    this.focus(clamp(to, 0, last));
  }

  paint() {
    colours.selected = colours.given;
  }
}
