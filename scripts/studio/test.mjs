// Drives a studio as a person would: drop, a doubt settled by its button, two compared, an arm painted, four variations, one kept, undo,
// a loop, export, reload. KINELM names the program; `node test.mjs`.

import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { basename, join } from 'node:path';
import { dance, hopping } from './clips.mjs';
import { idle, launch, open, studio } from './lib.mjs';

const PATIENCE = 600e3; // programs without optimisation take their time

const browser = await launch();
if (!browser) process.exit(0);
const folder = mkdtempSync(join(tmpdir(), 'kinelm-test-'));
const mine = dance(folder, 'mine.bvh', 6),
  hops = hopping(mine, join(folder, 'hops.bvh'));
const own = await studio();
let page = await open(browser, own);
const steps = [];
const step = async (name, does) => {
  const begun = Date.now();
  await does();
  // an exception of the page fails the step in which it comes
  assert.deepEqual(page.complaints, []);
  assert.equal(await page.locator('#fault').count(), 0);
  steps.push(name);
  console.log(`ok ${name} (${((Date.now() - begun) / 1000).toFixed(1)} s)`);
};

/** Drops files from outside onto an element, as a file manager does. */
async function drop(paths, onto = 'body') {
  const files = paths.map(path => ({ name: basename(path), text: readFileSync(path, 'utf8') }));
  const transfer = await page.evaluateHandle(files => {
    const transfer = new DataTransfer();
    for (const { name, text } of files) transfer.items.add(new File([text], name));
    return transfer;
  }, files);
  for (const type of ['dragenter', 'dragover', 'drop'])
    await page.dispatchEvent(onto, type, { dataTransfer: transfer });
}

const card = name => page.locator('.card', { has: page.locator('.name', { hasText: name }) });
const row = name => page.locator(`[data-row="${name}"]`);
const state = what => page.evaluate(what);

/** Drags over rows of the timeline, from a time to a time. */
async function paint(name, from, to) {
  const box = await row(name).boundingBox(),
    scale = await page.evaluate(() => document.querySelector('#lanes').style.getPropertyValue('--pps'));
  const x = time => box.x + time * parseFloat(scale),
    y = box.y + box.height / 2;
  await page.mouse.move(x(from), y);
  await page.mouse.down();
  await page.mouse.move(x((from + to) / 2), y, { steps: 4 });
  await page.mouse.move(x(to), y, { steps: 4 });
  await page.mouse.up();
}

try {
  await step('it opens on a dance and four variations of its right arm', async () => {
    await page.waitForFunction(() => document.querySelectorAll('.take').length === 4, null, { timeout: PATIENCE });
    await idle(page, PATIENCE);
    await page.waitForFunction(() => window.studio.stage.figures.length === 4);
    assert.ok(await state(() => window.studio.stage.state.playing));
  });

  await step('a dropped file is read, and a doubt is settled by its button', async () => {
    await drop([hops]);
    const fix = card('hops').locator('.fix', { hasText: 'fps' });
    await fix.waitFor({ timeout: PATIENCE });
    assert.match(await card('hops').innerText(), /gravity/);
    await fix.click();
    await fix.waitFor({ state: 'detached', timeout: PATIENCE });
    await card('hops')
      .locator('.stated', { hasText: /\b(24|25|30) fps/ })
      .waitFor({ timeout: PATIENCE });
  });

  await step('a clip becomes the timeline', async () => {
    await drop([mine], '#stage');
    await card('mine').locator('.brush').waitFor({ timeout: PATIENCE });
    await card('mine')
      .getByRole('button', { name: /More for/ })
      .click();
    await page.getByRole('menuitem', { name: /Work on this/ }).click();
    await page.waitForFunction(
      () => window.studio.store.timeline.segments.length === 1 && window.studio.store.timeline.rows.length === 7,
    );
    assert.ok(
      await state(() =>
        window.studio.store.timeline.rows.every(row => row.spans.every(span => span.state === 'given')),
      ),
    );
  });

  await step('two cards are compared', async () => {
    await card('mine')
      .getByRole('button', { name: /More for/ })
      .click();
    await page.getByRole('menuitem', { name: /Compare a student/ }).click();
    const dialog = page.getByRole('dialog', { name: 'Compare with mine' });
    await dialog.getByRole('combobox').selectOption({ label: 'hops' });
    await dialog.getByRole('button', { name: 'Compare' }).click();
    await dialog.getByRole('row', { name: /^distance/ }).waitFor({ timeout: PATIENCE });
    assert.match(await dialog.innerText(), /lag[^]*tempo[^]*mirrored/);
    const [saved] = await Promise.all([
      page.waitForEvent('download'),
      dialog.getByRole('link', { name: 'Save the page' }).click(),
    ]);
    assert.match(saved.suggestedFilename(), /hops beside mine\.html/);
    await dialog.getByRole('button', { name: 'Close' }).click();
  });

  await step('an arm is painted free', async () => {
    await page.getByRole('button', { name: 'Make anew' }).first().click();
    await paint('left_arm', 2, 4);
    await page.waitForFunction(() =>
      window.studio.store.timeline.rows
        .find(row => row.group === 'left_arm')
        .spans.some(span => span.state === 'generated'),
    );
    const span = await state(() =>
      window.studio.store.timeline.rows
        .find(row => row.group === 'left_arm')
        .spans.find(span => span.state === 'generated'),
    );
    assert.ok(Math.abs(span.from - 2) < 0.15 && Math.abs(span.to - 4) < 0.15, JSON.stringify(span));
    assert.equal(await page.locator('#make-kind').inputValue(), 'timeline');
  });

  await step('four variations are made, frame by frame', async () => {
    await page.getByRole('button', { name: 'Make 4 variations' }).click();
    await page.locator('.progress, .take').first().waitFor();
    await page.waitForFunction(() => window.studio.store.state.jobs.at(-1).kind === 'timeline');
    await idle(page, PATIENCE);
    const job = await state(() => window.studio.store.state.jobs.at(-1));
    assert.equal(job.state, 'done', job.text ?? '');
    await page.waitForFunction(() => window.studio.stage.figures.length === 4);
    assert.equal(await page.locator('.take').count(), 4);
    assert.match(await page.locator('#takes h3').innerText(), /timeline/i);
  });

  await step('one is chosen, kept, and kept again after undo and redo', async () => {
    await page.keyboard.press('Escape');
    await page.locator('#stage').focus();
    await page.keyboard.press('2');
    await page.waitForFunction(() => document.querySelector('.take.chosen .number')?.textContent === '2');
    await page.keyboard.press('Enter');
    const kept = page.locator('[aria-label="Kept dances"] .card');
    await kept.waitFor();
    await page.keyboard.press('Control+z');
    await kept.waitFor({ state: 'detached' });
    await page.keyboard.press('Control+Shift+z');
    await kept.waitFor();
  });

  await step('two are compared, one is rejected', async () => {
    await page.keyboard.press('1');
    await page.keyboard.press('v');
    await page.keyboard.press('3');
    await page.keyboard.press('v');
    await page.waitForFunction(() => window.studio.stage.figures.length === 2);
    await page.keyboard.press('Escape');
    await page.waitForFunction(() => window.studio.stage.figures.length === 4);
    await page.keyboard.press('4');
    await page.keyboard.press('x');
    await page.waitForFunction(() => window.studio.stage.figures.length === 3);
  });

  await step('a limb is selected on the stage', async () => {
    await page.keyboard.press('1');
    await page.keyboard.press('1');
    await page.keyboard.press('Space');
    await page.waitForFunction(() => window.studio.stage.figures.length === 1 && !window.studio.stage.state.playing);
    // one pose, whenever play was stopped: at some the pelvis lies over the spine
    await state(() => window.studio.stage.seek(1));
    await page.waitForTimeout(400);
    const at = await state(() => {
      const { stage } = window.studio,
        [one] = stage.figures,
        point = one.joints.findIndex(joint => joint?.group === 'spine');
      const view = stage.seen.view,
        bone = one.bones.find(bone => bone.a === point),
        canvas = document.querySelector('#stage');
      const p = [0, 1, 2].map(
        i => (one.now[3 * bone.a + i] + one.now[3 * bone.b + i]) / 2 + (i === 1 ? 0 : one.shift[i / 2]),
      );
      const on = i => view[i] * p[0] + view[4 + i] * p[1] + view[8 + i] * p[2] + view[12 + i];
      const box = canvas.getBoundingClientRect();
      return [box.x + (0.5 + (0.5 * on(0)) / on(3)) * box.width, box.y + (0.5 - (0.5 * on(1)) / on(3)) * box.height];
    });
    await page.mouse.click(...at);
    await page.waitForFunction(() => window.studio.ui.joints.size === 1);
    const chosen = await state(() => [...window.studio.ui.joints][0]);
    assert.ok(['spine', 'left_arm', 'right_arm'].includes(chosen), chosen);
    await page.keyboard.press('Escape');
    await page.keyboard.press('Escape');
  });

  await step('the kept dance becomes a loop', async () => {
    await page.locator('#make-kind').selectOption('loop');
    await page.locator('.field.clip select').selectOption({ index: 2 });
    await page.locator('.segments[aria-label=Variations] button', { hasText: '1' }).click();
    await page.locator('#make-now').click();
    await page.waitForFunction(() => window.studio.store.state.jobs.at(-1).kind === 'loop');
    await idle(page, PATIENCE);
    assert.equal(await state(() => window.studio.store.state.jobs.at(-1).state), 'done');
    await page.locator('.take .keep').click();
    await page.waitForFunction(() => window.studio.store.state.dances.filter(dance => dance.kept).length === 2);
  });

  await step('a new dance is on the rig of a clip, at its rate, or on SMPL’s body', async () => {
    const model = await state(() => window.studio.store.state.model);
    const clip = await state(() => window.studio.store.state.clips.find(clip => clip.state === 'ready' && clip.rig));
    const auto = () => page.locator('#field-fps option').first().textContent();
    const said = () => page.locator('#make-form > .quiet').textContent();
    await page.locator('#make-kind').selectOption('free');
    await page.locator('.finer summary').click();
    await page.locator('#field-rig').selectOption('smpl');
    assert.equal(await auto(), `auto (${model.new_fps} fps)`);
    assert.match(await said(), /SMPL’s body/);
    await page.locator('#field-rig').selectOption(clip.id);
    assert.equal(await auto(), `auto (${Math.round(clip.fps)} fps)`);
    assert.ok((await said()).includes(`the rig of ${clip.name}`));
    await page.locator('#field-seconds').fill('1');
    await page.locator('.segments[aria-label=Variations] button', { hasText: '1' }).click();
    for (const rate of ['', '25']) {
      const jobs = await state(() => window.studio.store.state.jobs.length);
      await page.locator('#field-fps').selectOption(rate);
      await page.locator('#make-now').click();
      await page.waitForFunction(before => window.studio.store.state.jobs.length > before, jobs);
      await idle(page, PATIENCE);
      const dance = await state(() => window.studio.store.state.dances.at(-1));
      assert.deepEqual([dance.rig, Math.round(dance.fps)], [clip.id, Number(rate) || Math.round(clip.fps)]);
    }
    await page.locator('.finer summary').click();
  });

  await step('it is exported as a BVH, for Blender, as a GLB and as an npz', async () => {
    for (const [name, first] of [
      ['BVH', 'HIERARCHY'],
      ['for Blender', 'HIERARCHY'],
      ['GLB', 'glTF'],
      ['npz', 'PK'],
    ]) {
      await page.locator('[aria-label="Kept dances"] .export').last().click();
      const [download] = await Promise.all([
        page.waitForEvent('download'),
        page.getByRole('menuitem', { name: `Export ${name}` }).click(),
      ]);
      const bytes = readFileSync(await download.path());
      assert.ok(
        bytes.subarray(0, first.length).toString() === first && bytes.length > 5000,
        `${name}: ${bytes.length} bytes`,
      );
    }
  });

  await step('a film of the stage is saved', async () => {
    await state(() => {
      Object.assign(window.studio.stage.state, { from: 0, upto: 1 });
    });
    const [download] = await Promise.all([
      page.waitForEvent('download', { timeout: PATIENCE }),
      page.locator('#film').click(),
    ]);
    assert.match(download.suggestedFilename(), /\.webm$/);
    assert.ok(readFileSync(await download.path()).length > 2000);
  });

  await step('what else moves like two seconds of a clip is found', async () => {
    const strip = card('mine').locator('.brush').first(),
      box = await strip.boundingBox();
    await page.mouse.move(box.x + 0.4 * box.width, box.y + 6);
    await page.mouse.down();
    await page.mouse.move(box.x + 0.5 * box.width, box.y + 6, { steps: 3 });
    await page.mouse.up();
    await page.locator('#found .card').first().waitFor({ timeout: PATIENCE });
    await page.locator('#found').getByRole('button', { name: 'Close' }).click();
  });

  await step('after a reload all is there', async () => {
    const before = await state(() => ({
      text: window.studio.store.timeline.text,
      kept: window.studio.store.state.dances.filter(dance => dance.kept).map(dance => dance.name),
    }));
    await page.reload();
    await page.waitForFunction(() => window.studio?.store.ready && window.studio.store.timeline.rows.length === 7);
    const after = await state(() => ({
      text: window.studio.store.timeline.text,
      kept: window.studio.store.state.dances.filter(dance => dance.kept).map(dance => dance.name),
    }));
    assert.deepEqual(after, before);
    assert.ok(after.kept.length === 2 && (await state(() => window.studio.store.state.undo.undo > 3)));
  });

  await step('and after the program was started again', async () => {
    await page.context().close();
    await own.stop();
    const again = await studio({ folder: own.folder });
    try {
      page = await open(browser, again);
      await page.locator('[aria-label="Kept dances"] .card').nth(1).waitFor();
      assert.equal(await state(() => window.studio.store.timeline.rows.length), 7);
      await page.locator('#stage').focus();
      await page.keyboard.press('?');
      await page.locator('dialog.sheet').waitFor();
      assert.deepEqual(page.complaints, []);
    } finally {
      await again.end();
    }
  });
  console.log(`${steps.length} steps`);
} catch (error) {
  await page.screenshot({ path: join(tmpdir(), 'studio-test-failed.png') }).catch(() => {});
  console.error(error, page.complaints);
  process.exitCode = 1;
} finally {
  await own.stop().catch(() => {});
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
  rmSync(own.folder, { recursive: true, force: true });
}
