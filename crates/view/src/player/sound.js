// Music in step with the stage's clock: the sound is the clock while it runs, so the two can't drift apart.
// What dancers hit of its beats is lit where it is told of them.

const APART_S = 0.01;                                // a seek is made only where sound and clock are further apart

/**
 * `from` is the music's time at the dance's beginning; beats are in the music's time.
 * @typedef {{ src: string, name: string, from: number, beats: number[] }} Music
 * @typedef {{ ticks: HTMLElement | null, pulse: HTMLElement, button: HTMLElement, length: number }} Elements
 */
export class Player {
  /** @param {Music} music @param {Elements} elements where ticks, light and switch are; `length` of the dance, seconds */
  constructor(music, { ticks, pulse, button, length }) {
    this.from = music.from;
    this.button = button;
    this.pulse = pulse;
    this.blocked = false;
    this.muted = false;
    /** @type {Map<number, { tick: HTMLElement, colours: string[] }>} */
    this.ticks = new Map();
    /** @type {{ hits: Set<number>, light: HTMLElement }[]} */
    this.dancers = [];
    this.trouble = '';
    const beats = music.beats.map(beat => beat - music.from);
    this.beats = beats.filter(beat => beat >= 0 && beat <= length);
    this.before = beats.filter(beat => beat < 0).length;
    this.audio = new Audio();
    this.audio.preload = 'auto';
    this.audio.src = music.src;
    this.audio.onerror = () => { this.trouble = `${music.name} can't be played; it has to lie beside this page`; };
    button.title = `${music.name}: sound on or off (M)`;
    button.hidden = false;
    button.onclick = () => this.mute(!this.muted);
    if (ticks) this.mark(ticks, length);
  }

  // One tick a beat, or every second, fourth ... where they would run together.
  /** @param {HTMLElement} ticks @param {number} length */
  mark(ticks, length) {
    let every = 1;
    while (this.beats.length / every > 200) every *= 2;
    for (let i = 0; i < this.beats.length; i += every) {
      const tick = document.createElement('i');
      tick.style.left = `${100 * this.beats[i] / (length || 1)}%`;
      ticks.append(tick);
      this.ticks.set(i, { tick, colours: [] });
    }
  }

  // A dancer hits these of the music's beats: their ticks have its colour, those of several one above the other, and its
  // light goes on at each.
  /** @param {number[]} beats @param {string} colour @param {HTMLElement} light */
  hit(beats, colour, light) {
    const hits = new Set(beats.map(beat => beat - this.before));
    this.dancers.push({ hits, light });
    for (const [i, { tick, colours }] of this.ticks) {
      if (!hits.has(i)) continue;
      colours.push(colour);
      const part = (/** @type {number} */ k) => `${100 * k / colours.length}%`;
      tick.className = 'hit';
      tick.style.background = `linear-gradient(to top, ${colours.map((c, k) => `${c} ${part(k)} ${part(k + 1)}`)}, ${colour})`;
    }
  }

  /** @param {boolean} on */
  mute(on) {
    this.muted = this.audio.muted = on;
    this.button.setAttribute('aria-pressed', String(!on));
  }

  // Whether there is sound at a time of the dance.
  /** @param {number} time */
  reaches(time) {
    const at = time + this.from;
    return at >= 0 && at < (Number.isFinite(this.audio.duration) ? this.audio.duration : 0);
  }

  // The dance's time by the sound; null while it is silent: before its beginning, behind its end, not yet allowed.
  now() {
    const a = this.audio;
    return a.paused || a.ended || a.seeking || a.readyState < 2 ? null : a.currentTime - this.from;
  }

  // The page stands at this time; it plays at this speed, or not at all with 0.
  /** @param {number} time @param {number} speed */
  follow(time, speed) {
    const a = this.audio;
    if (!speed || !this.reaches(time)) {
      if (!a.paused) a.pause();
      return;
    }
    if (a.playbackRate !== speed) a.playbackRate = speed;
    if (!a.paused || this.blocked) return;
    this.seek(time);
    // browsers wait for a first click before a page may sound
    this.blocked = true;
    a.play().then(() => { this.blocked = false; }, () => {
      for (const what of ['pointerdown', 'keydown']) {
        addEventListener(what, () => { this.blocked = false; }, { once: true });
      }
    });
  }

  /** @param {number} time */
  seek(time) {
    if (this.reaches(time) && Math.abs(this.audio.currentTime - this.from - time) > APART_S) {
      this.audio.currentTime = time + this.from;
    }
  }

  // Lights up at each beat: as a ring where there are dancers and none hits it.
  /** @param {number} time */
  show(time) {
    let low = 0, high = this.beats.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.beats[middle] <= time) low = middle + 1;
      else high = middle;
    }
    const since = low ? time - this.beats[low - 1] : Infinity;
    const glow = Math.exp(-since / 0.12).toFixed(2);
    this.pulse.style.opacity = glow;
    this.dancers.forEach(({ hits, light }) => { light.style.opacity = hits.has(low - 1) ? glow : '0'; });
    this.pulse.classList.toggle('missed', this.dancers.length > 0 && !this.dancers.some(d => d.hits.has(low - 1)));
  }
}
