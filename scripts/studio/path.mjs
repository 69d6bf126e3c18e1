// A path that is drawn on the stage's floor with the pen, and danced along.

import assert from 'node:assert/strict';
import { idle, launch, open, studio } from './lib.mjs';

const browser = await launch();
if (!browser) process.exit(0);
const own = await studio();
const page = await open(browser, own, { still: true });
const drawing = () => page.locator('#floor-path path').count();

try {
  await page.locator('#make-kind').selectOption('free');
  await page.locator('#pen').click();
  assert.equal(await page.locator('#pen').getAttribute('aria-pressed'), 'true');
  const { x, y, width, height } = await page.locator('#stage').boundingBox();
  // an S over the floor, seen from above
  const at = t => [x + width * (0.3 + 0.4 * t), y + height * (0.6 + 0.16 * Math.sin(2 * Math.PI * t))];
  await page.mouse.move(...at(0));
  await page.mouse.down();
  for (let n = 1; n <= 40; n++) await page.mouse.move(...at(n / 40));
  await page.mouse.up();
  assert.equal(await page.locator('#pen').getAttribute('aria-pressed'), 'false', 'a stroke is a path');
  await page.locator('#field-speed').fill('0.8');
  await page.locator('#field-speed').blur();
  const said = await page.locator('.field.path small').textContent();
  assert.match(said, /^[\d.]+ m in [\d.]+ s/);
  assert.equal(await page.locator('#field-seconds').count(), 0, 'it is as long as its path');
  await page.waitForFunction(() => document.querySelector('#floor-path path'));
  console.log(`ok drawn: ${said}`);

  await page.getByRole('button', { name: '2', exact: true }).first().click();
  await page.locator('#make-now').click();
  await page.waitForFunction(() => window.studio.store.state.jobs.some(job => job.make.path));
  await idle(page);
  const { make, dances } = await page.evaluate(() => window.studio.store.state.jobs.find(job => job.make.path));
  const seconds = make.path.at(-1)[0];
  assert.ok(make.path.length > 5 && !('seconds' in make) && seconds > 2, JSON.stringify(make));
  // the pelvis is where the path is at that time
  const off = await page.evaluate(
    async ([id, path]) => {
      const { Figure, decoded } = await import('/assets/figure.js');
      const head = await (await fetch(`/api/dances/${id}/figure`)).json(),
        figure = new Figure(head, decoded(head.data));
      let most = 0;
      for (const [time, x, z] of path) {
        figure.places(Math.min(time, figure.lasts), figure.now);
        most = Math.max(most, Math.hypot(figure.now[0] - x, figure.now[2] - z));
      }
      return most;
    },
    [dances[0], make.path],
  );
  assert.ok(off < 0.15, `${off} m off its path`);
  await page.waitForFunction(() => document.querySelectorAll('#floor-path path').length === 2);
  console.log(`ok danced along, ${(100 * off).toFixed(1)} cm off at most, and shown below both dancers`);

  if (process.env.SHOT) {
    await page.setViewportSize({ width: 1280, height: 800 });
    await page.evaluate(() => {
      Object.assign(window.studio.stage.state, { pitch: 0.5, dirty: true });
      window.studio.stage.seek(window.studio.stage.whole / 2);
    });
    await page.waitForTimeout(1500);
    await page.screenshot({ path: process.env.SHOT });
  }
  await page.getByRole('button', { name: 'None' }).click();
  assert.equal(await page.locator('#field-seconds').count(), 1);
  assert.equal(await drawing(), 2, 'a dance keeps its own');
  assert.deepEqual(page.complaints, []);
} finally {
  await browser.close();
  await own.end();
}
