// Pictures of the studio in its states: `node shots.mjs OUT [WIDTHxHEIGHT [dark]]`.

import { mkdirSync, mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { dance, hopping } from './clips.mjs';
import { idle, launch, open, studio } from './lib.mjs';

const [, , out, size = '1280x800', theme = 'light'] = process.argv;
if (!out) {
  console.error('node shots.mjs OUT [WIDTHxHEIGHT [dark]]');
  process.exit(2);
}
const [width, height] = size.split('x').map(Number);
mkdirSync(out, { recursive: true });
const browser = await launch();
if (!browser) process.exit(0);
const folder = mkdtempSync(join(tmpdir(), 'kinelm-shots-'));
const salsa = dance(folder, 'salsa 03.bvh', 12, 4),
  other = dance(folder, 'salsa 11.bvh', 9, 8);
const hops = hopping(other, join(folder, 'jump.bvh')),
  song = join(folder, 'song.wav');
writeFileSync(song, beat(20));

/** Music of clicks at 120 beats a minute: 16-bit mono at 22,050 Hz. */
function beat(seconds) {
  const rate = 22050,
    bytes = Buffer.alloc(44 + 2 * rate * seconds);
  bytes.write('RIFF', 0);
  bytes.writeUInt32LE(bytes.length - 8, 4);
  bytes.write('WAVEfmt ', 8);
  bytes.writeUInt32LE(16, 16);
  bytes.writeUInt16LE(1, 20);
  bytes.writeUInt16LE(1, 22);
  bytes.writeUInt32LE(rate, 24);
  bytes.writeUInt32LE(2 * rate, 28);
  bytes.writeUInt16LE(2, 32);
  bytes.writeUInt16LE(16, 34);
  bytes.write('data', 36);
  bytes.writeUInt32LE(2 * rate * seconds, 40);
  for (let i = 0; i < rate * seconds; i++) {
    const t = (i % (rate / 2)) / rate;
    bytes.writeInt16LE(Math.round(9000 * Math.exp(-t * 30) * Math.sin(2 * Math.PI * 180 * t)), 44 + 2 * i);
  }
  return bytes;
}

const own = await studio();
let number = 0;
const page = await open(browser, own, { width, height, dark: theme === 'dark' });
const shot = async name => {
  await page.waitForTimeout(350);
  const path = join(out, `${String(++number).padStart(2, '0')}-${name}.png`);
  await page.screenshot({ path });
  console.log(path);
};
const at = time =>
  page.evaluate(time => {
    window.studio.stage.play(false);
    window.studio.stage.seek(time);
  }, time);
const select = name => page.locator(`[data-keep="pick ${name}"]`).click();
const time = async (row, from, to, release = true) => {
  const box = await page.locator(`[data-row="${row}"]`).boundingBox();
  const scale = parseFloat(await page.evaluate(() => document.querySelector('#lanes').style.getPropertyValue('--pps')));
  const y = box.y + box.height / 2;
  await page.mouse.move(box.x + from * scale, y);
  await page.mouse.down();
  await page.mouse.move(box.x + to * scale, y, { steps: 8 });
  if (release) await page.mouse.up();
};
const key = name => page.keyboard.press(name);
const upload = async paths => page.locator('input[type=file]').first().setInputFiles(paths);
const menuOf = async (card, item) => {
  await page
    .locator('.card', { hasText: card })
    .first()
    .getByRole('button', { name: /More for/ })
    .click();
  await page.getByRole('menuitem', { name: item }).click();
};

try {
  await page.waitForFunction(() => window.studio.store.state.jobs.at(-1)?.frames > 20).catch(() => {});
  await shot('first-frames');
  await page.waitForFunction(() => window.studio.store.state.dances.length === 5, null, { timeout: 300e3 });
  await idle(page);
  await page.waitForTimeout(1500);
  await at(3.4);
  await shot('opening');
  await key('2');
  await shot('chosen');
  await key('2');
  await shot('alone');
  await key('Escape');
  await key('o');
  await key('t');
  await key('n');
  await page.waitForFunction(() => window.studio.stage.state.overlaid === 1);
  await shot('overlay-trails-contacts');
  await key('t');
  await key('n');
  await key('o');

  await upload([salsa, other, hops, song]);
  await page.locator('.card', { hasText: 'jump' }).locator('.fix').first().waitFor({ timeout: 300e3 });
  await page.waitForFunction(
    () =>
      window.studio.store.state.clips.length === 4 &&
      window.studio.store.state.clips.every(clip => clip.state !== 'reading'),
    null,
    { timeout: 300e3 },
  );
  await page.locator('.card', { hasText: 'jump' }).scrollIntoViewIfNeeded();
  await shot('library-doubts');
  await page.locator('.card', { hasText: 'jump' }).locator('.fix', { hasText: 'fps' }).click();
  await page
    .locator('.card', { hasText: 'jump' })
    .locator('.fix', { hasText: 'fps' })
    .waitFor({ state: 'detached', timeout: 300e3 });
  await menuOf('salsa 03', /Work on this/);
  await page.waitForFunction(() => window.studio.store.timeline.rows.length === 7);
  await page
    .locator('.card', { hasText: 'salsa 03' })
    .first()
    .getByRole('button', { name: /More for/ })
    .click();
  await shot('card-menu');
  await key('Escape');
  await at(2.2);
  await shot('timeline-of-a-clip');

  await key('r');
  await time('left_arm', 3, 6, false);
  await shot('painting');
  await page.mouse.up();
  await page.waitForFunction(() =>
    window.studio.store.timeline.rows.some(row => row.spans.some(span => span.state === 'generated')),
  );
  await at(4.5);
  await shot('painted');
  await page.locator('#make-now').click();
  await page
    .waitForFunction(
      () => window.studio.stage.figures.length > 0 && window.studio.stage.figures.every(one => one.loaded.live),
      null,
      { timeout: 120e3 },
    )
    .catch(() => {});
  await shot('being-made');
  await idle(page);
  await page.waitForTimeout(1500);
  await at(4.6);
  await shot('made');
  await key('1');
  await key('v');
  await key('3');
  await key('v');
  await shot('compared');
  await key('Escape');
  await key('Enter');
  await page.locator('.toast').waitFor();
  await shot('kept');
  await page.locator('[aria-label="Kept dances"] .export').click();
  await shot('export');
  await key('Escape');

  // a timeline with everything on it
  await key('a');
  await page
    .locator('.card', { hasText: 'salsa 11' })
    .first()
    .dragTo(page.locator('#clips-lane'), {
      targetPosition: { x: 0.98 * (await page.locator('#clips-lane').boundingBox()).width, y: 12 },
    });
  await page.waitForFunction(() => window.studio.store.timeline.segments.filter(segment => segment.clip).length > 3);
  await page
    .locator('.card', { hasText: 'song' })
    .dragTo(page.locator('#clips-lane'), { targetPosition: { x: 4, y: 12 } });
  await page.locator('.music-block').waitFor();
  const rows = page.locator('#rows');
  await rows.evaluate(box => box.parentElement.scrollTo(0, 0));
  await time('spine', 7, 9.5);
  await select('right_arm');
  await page.locator('.selection .free').click();
  await page.waitForTimeout(600);
  await page.locator('.chip', { hasText: 'salsa' }).first().click();
  await page.locator('.label-block').waitFor();
  await at(8);
  await key('k');
  await page.waitForTimeout(700);
  await page.locator('.caret').nth(4).click();
  await shot('full-timeline');
  await page.getByRole('button', { name: 'Text' }).click();
  await shot('text');
  await key('Escape');
  await page.locator('[data-keep="pick right_arm"]').click();
  await key('Escape');

  const strip = page.locator('.card', { hasText: 'salsa 03' }).first().locator('.brush');
  await strip.scrollIntoViewIfNeeded();
  const box = await strip.boundingBox();
  await page.mouse.move(box.x + 0.3 * box.width, box.y + 6);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.4 * box.width, box.y + 6, { steps: 4 });
  await page.mouse.up();
  await page.locator('#found .card').first().waitFor({ timeout: 300e3 });
  await shot('moves-like-this');
  await page.locator('#found').getByRole('button', { name: 'Close' }).click();

  await page.locator('#make-kind').selectOption('loop');
  await page.locator('.segments[aria-label=Variations] button', { hasText: '2' }).click();
  await page.locator('#make-now').click();
  await page.waitForFunction(() => window.studio.store.state.jobs.at(-1).kind === 'loop');
  await idle(page);
  await page.waitForTimeout(1200);
  await shot('loop');
  await page.locator('#make-kind').selectOption('given');
  await page.locator('.finer summary').click();
  await shot('finer-settings');
  await page.locator('#make-kind').selectOption('free');
  await page.locator('#field-best').fill('6');
  await page.locator('.segments[aria-label=Variations] button', { hasText: '4' }).click();
  await page.locator('#make-now').click();
  await page.waitForFunction(() => window.studio.store.state.jobs.at(-1).kind === 'free');
  await idle(page);
  await page.locator('.finer summary').click();
  await page.waitForTimeout(1500);
  await shot('best-of');
  await key('?');
  await shot('keys');
  await key('Escape');
  if (page.complaints.length) console.log(page.complaints);
} catch (error) {
  await shot('failed').catch(() => {});
  console.error(error, page.complaints);
  process.exitCode = 1;
} finally {
  await own.end();
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
