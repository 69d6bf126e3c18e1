// What the page costs: first paint beside that of a page of one word, script time of a picture while a five-minute clip is scrubbed and played, the time from
// a click to the first sampled frame, and memory with many clips. One JSON object a line; `node measure.mjs [CLIPS]`.

import { mkdtempSync, rmSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { dance, longer } from './clips.mjs';
import { idle, launch, open, studio } from './lib.mjs';

const browser = await launch();
if (!browser) process.exit(0);
const folder = mkdtempSync(join(tmpdir(), 'kinelm-measure-'));
const short = dance(folder, 'short.bvh', 8),
  long = longer(short, join(folder, 'long.bvh'), 300);
const count = Number(process.argv[2] ?? 0),
  many = Array.from({ length: count }, (_, i) => longer(short, join(folder, `clip-${i}.bvh`), 20 + (i % 5)));
const say = (what, figures) => console.log(JSON.stringify({ what, ...figures }));
const round = n => Math.round(n * 100) / 100;
const of = (all, part) =>
  round([...all].sort((a, b) => a - b)[Math.min(all.length - 1, Math.floor(part * all.length))]);

/** When the first text or picture was there, milliseconds after the call. */
const firstPaint = () =>
  new Promise(done => {
    const look = () => {
      const found = performance.getEntriesByName('first-contentful-paint')[0];
      if (found) done(found.startTime);
      else setTimeout(look, 10);
    };
    look();
  });

const own = await studio({ files: [long, ...many], args: ['--empty'] });
try {
  const page = await open(browser, own);
  await page.waitForFunction(
    n => window.studio.store.state.clips.filter(clip => clip.state === 'ready').length === n,
    1 + count,
    { timeout: 900e3 },
  );
  const word = createServer((_, answer) => answer.setHeader('Content-Type', 'text/html').end('<!doctype html>word'));
  await new Promise(done => word.listen(0, '127.0.0.1', done));
  const plain = await browser.newPage();
  await plain.goto(`http://127.0.0.1:${word.address().port}/`);
  for (const [what, one, isReady] of [
    ['a page of one word', plain, () => true],
    ['paint', page, () => window.studio?.store.ready],
  ]) {
    const paints = [];
    for (let n = 0; n < 7; n++) {
      await one.reload();
      await one.waitForFunction(isReady);
      paints.push(await one.evaluate(firstPaint));
    }
    say(what, { first_contentful_ms: of(paints, 0.5), least: of(paints, 0), most: of(paints, 1) });
  }
  await plain.close();
  word.close();
  const begun = Date.now();
  await page.locator('.card .name', { hasText: 'long' }).first().click();
  await page.waitForFunction(() => window.studio.stage.whole > 290, null, { timeout: 120e3 });
  say('five minutes on the stage', { ms: Date.now() - begun });

  // scrubbed: the pointer runs over the ruler and back
  await page.evaluate(() => {
    window.studio.stage.play(false);
    window.studio.costs.length = 0;
  });
  const box = await page.locator('#ruler').boundingBox();
  await page.mouse.move(box.x + 20, box.y + 20);
  await page.mouse.down();
  for (let i = 0; i < 240; i++)
    await page.mouse.move(box.x + 20 + (box.width - 60) * Math.abs(1 - ((i / 80) % 2)), box.y + 20);
  await page.mouse.up();
  const scrub = await page.evaluate(() => [...window.studio.costs]);
  say('scrubbing', {
    pictures: scrub.length,
    script_ms_median: of(scrub, 0.5),
    script_ms_99: of(scrub, 0.99),
    script_ms_most: of(scrub, 1),
  });

  await page.evaluate(() => {
    window.studio.costs.length = 0;
    window.studio.stage.play(true);
  });
  await page.waitForTimeout(4000);
  const played = await page.evaluate(() => [...window.studio.costs]);
  say('playing', { pictures: played.length, script_ms_median: of(played, 0.5), script_ms_99: of(played, 0.99) });
  // without drawing: what the script alone takes, as the card of a test machine is its processor
  const composed = await page.evaluate(() => {
    const { stage } = window.studio,
      times = [];
    for (let i = 0; i < 400; i++) {
      const begun = performance.now();
      stage.state.time = stage.whole * ((i * 0.618) % 1);
      stage.compose();
      stage.camera(1280, 800);
      times.push(performance.now() - begun);
    }
    return times;
  });
  say('composing a picture', { script_ms_median: of(composed, 0.5), script_ms_99: of(composed, 0.99) });
  if (count) {
    const memory = await page.evaluate(() => performance.memory?.usedJSHeapSize ?? 0);
    say('memory', { clips: count + 1, script_heap_mb: round(memory / 2 ** 20) });
  }

  await page.locator('#make-kind').selectOption('free');
  await page.evaluate(() => {
    window.firstFrame = new Promise(done => {
      const before = window.studio.store.state.jobs.length;
      document.querySelector('#make-now').addEventListener(
        'click',
        () => {
          const begun = performance.now(),
            look = () => {
              const one = window.studio.stage.figures[0];
              if (window.studio.store.state.jobs.length > before && one?.loaded?.live && one.frames > 0)
                done(performance.now() - begun);
              else requestAnimationFrame(look);
            };
          look();
        },
        { once: true },
      );
    });
  });
  await page.locator('#make-now').click();
  say('click to the first sampled frame', { ms: round(await page.evaluate(() => window.firstFrame)) });
  await idle(page);
} finally {
  await own.end();
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
