// Presses every button on every doubt of every kind, and says in the panel and in the timeline's text how clips are read:
// the page goes on, and the timeline keeps the whole of the clip. KINELM names the program; `node doubts.mjs`.

import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { dance, hopping, lying, mirrored, resting, saying, skating, unitless, unsure } from './clips.mjs';
import { KINELM, launch, open, studio } from './lib.mjs';

const PATIENCE = 120e3;
// those with a button
const KINDS = ['floor_doubted', 'mirrored', 'rate_doubted', 'rest_frame', 'unit_unknown', 'up_axis', 'up_unsure'];

const browser = await launch();
if (!browser) process.exit(0);
const folder = mkdtempSync(join(tmpdir(), 'kinelm-doubts-')),
  at = name => join(folder, name);
const plain = dance(folder, 'plain.bvh', 4);
const files = [
  plain,
  hopping(plain, at('hops.bvh')),
  saying(plain, at('beside.bvh'), 120),
  resting(plain, at('rest.bvh')),
  lying(plain, at('lies.bvh')),
  unsure(plain, at('unsure.json')),
  mirrored(plain, at('mirror.bvh')),
  skating(plain, at('floor.bvh')),
  unitless(plain, at('unit.bvh')),
];
const own = await studio({ args: ['--empty'] });
const page = await open(browser, own);
const state = (what, of) => page.evaluate(what, of);

/** That the page is as it should be, and the timeline of one clip has all of it. */
async function isWhole(name) {
  await page.waitForFunction(
    name => {
      const { state, timeline } = window.studio.store,
        clip = state.clips.find(clip => clip.name === name),
        [one] = timeline.segments;
      if (clip?.state !== 'ready' || timeline.clips[one?.clip]?.clip !== clip.id || timeline.trouble.length || timeline.segments.length !== 1) return false;
      return Math.abs(one.to - one.from - clip.seconds) < 1.01 / clip.fps && one.at === 0;
    },
    name,
    { timeout: 20e3 },
  ).catch(async () => {
    const found = await state(name => {
      const { state, timeline } = window.studio.store;
      return [state.clips.find(clip => clip.name === name), timeline.segments, timeline.trouble, timeline.text];
    }, name);
    assert.fail(`${name}: ${JSON.stringify(found, null, 1)}`);
  });
  assert.equal(await page.locator('#clips-lane .block').count(), 1, name);
  assert.deepEqual(page.complaints, [], name);
}

const card = name => page.locator('.card', { has: page.locator(`.name[title="${name}"]`) });
async function menu(name, item) {
  await card(name).getByRole('button', { name: /More for/ }).click();
  await page.getByRole('menuitem', { name: item }).click();
}
const clipOf = name => state(name => window.studio.store.state.clips.find(clip => clip.name === name), name);
/** Waits until a clip was read, behind something that has it read. */
async function read(name, does) {
  const before = await state(() => window.studio.store.state.undo.undo);
  await does();
  await page.waitForFunction(before => window.studio.store.state.undo.undo !== before, before, { timeout: PATIENCE });
  await settled();
  return clipOf(name);
}
const settled = () =>
  page.waitForFunction(
    () => window.studio.store.state.clips.every(clip => clip.state !== 'reading'),
    null,
    { timeout: PATIENCE },
  );
/** Waits until it holds, if it ever does: the page asks for a timeline's text after it heard of the step. */
const becomes = (holds, of) => page.waitForFunction(holds, of, { timeout: 10e3 }).catch(() => {});
async function undo() {
  const before = await state(() => window.studio.store.state.undo.undo);
  await state(() => document.querySelector('#top-right button').click());
  await page.waitForFunction(before => window.studio.store.state.undo.undo === before - 1, before);
  await settled();
}
async function write(text) {
  await page.locator('#tools button', { hasText: 'Text' }).click();
  await page.locator('dialog.text textarea').fill(text);
  await page.locator('dialog.text .strong').click();
  await page.locator('dialog.text').waitFor({ state: 'detached' });
}

try {
  await page.locator('input[type=file]').first().setInputFiles(files);
  await page.waitForFunction(n => window.studio.store.state.clips.length === n, files.length, { timeout: PATIENCE });
  await settled();

  const seen = new Set();
  for (const name of (await state(() => window.studio.store.state.clips)).map(clip => clip.name)) {
    const pressed = new Set();
    for (;;) {
      const clip = await clipOf(name),
        doubt = clip.doubts.find(({ kind, fix }) => fix && !pressed.has(`${kind} ${fix.label}`));
      if (!doubt) break;
      pressed.add(`${doubt.kind} ${doubt.fix.label}`);
      seen.add(doubt.kind);
      const before = clip.state;
      if (before === 'ready') {
        await menu(name, /Work on this/);
        await isWhole(name);
      }
      const text = await state(() => window.studio.store.timeline.text);
      await read(name, () => card(name).locator('.fix', { hasText: doubt.fix.label }).click());
      console.log(`ok ${name}: ${doubt.fix.label}`);
      if (before === 'ready') await isWhole(name);
      // but for the numbers of a BVH that is made of it
      const isStated = before === 'ready' && clip.format === 'BVH';
      if (isStated) await becomes(text => window.studio.store.timeline.text !== text, text);
      const after = await state(() => window.studio.store.timeline.text);
      await undo();
      await becomes(text => window.studio.store.timeline.text === text, text);
      assert.equal(await state(() => window.studio.store.timeline.text), text, `${name}: one step back`);
      if (before === 'ready') await isWhole(name);
      assert.ok(!isStated || after !== text, `${name}: ${doubt.fix.label} is stated in the timeline`);
    }
  }
  assert.deepEqual([...seen].sort(), KINDS);

  // a cut clip goes on where it was cut, and what is behind it makes room
  await menu('hops', /Work on this/);
  await isWhole('hops');
  await state(() => fetch('/api/timeline', {
    method: 'POST',
    headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ edits: [{ op: 'split', index: 0, at: 0.5 }] }),
  }));
  await page.waitForFunction(() => window.studio.store.timeline.segments.length === 2);
  const half = await state(() => window.studio.store.timeline.segments.map(({ from, to, at }) => [from, to, at]));
  const { fps: stated } = await clipOf('hops');
  const { fps: truly } = await read('hops', () => card('hops').locator('.fix', { hasText: 'fps' }).click());
  const slower = stated / truly;
  await page.waitForFunction(
    ([half, slower]) => {
      const { segments, trouble } = window.studio.store.timeline;
      const near = (a, b) => Math.abs(a - b * slower) < 0.002;
      return !trouble.length && segments.every(({ from, to, at }, i) => [from, to, at].every((s, k) => near(s, half[i][k])));
    },
    [half, slower],
    { timeout: 20e3 },
  );
  console.log('ok a clip that was cut stays whole at another rate');

  // the panel takes all that inspect takes, and shows what it changes
  await menu('plain', /Work on this/);
  await menu('plain', /How it is read/);
  const panel = page.locator('dialog.reading');
  const says = async (key, value) => {
    const field = panel.locator(`[name=${key}]`);
    return read('plain', async () => {
      if ((await field.evaluate(one => one.tagName)) === 'SELECT') await field.selectOption(value);
      else {
        await field.fill(value);
        await field.press('Tab');
      }
    });
  };
  for (const [key, value, is] of [
    ['fps_source', '15', clip => clip.fps === 15 && Math.abs(clip.seconds - 8) < 0.1],
    ['skip', '5', clip => clip.frames === 115],
    ['up', '-z', clip => clip.reading.up === '-z'],
    ['up', 'y', clip => clip.reading.up === 'y'],
    ['unit', 'cm', clip => clip.reading.unit !== undefined],
    ['floor', '0.1', clip => clip.floor === 0.1],
    ['map', 'smpl', clip => clip.rig === 'smpl'],
    ['mirror_axis', 'x', clip => clip.reading.mirror_axis === 'x'],
    ['mirror_axis', '', clip => clip.reading.mirror_axis === undefined],
    ['root', 'pelvis', clip => clip.reading.root === 'pelvis'],
    ['root', '', clip => clip.reading.root === undefined],
  ]) {
    const clip = await says(key, value);
    assert.ok(is(clip), `${key} ${value}: ${JSON.stringify(clip)}`);
    await isWhole('plain');
    console.log(`ok ${key} = ${value || 'nothing'}`);
  }
  assert.match(await panel.locator('dl').innerText(), /30 fps\s*15 fps/, 'what was and what is');
  assert.match(await card('plain').locator('.stated').innerText(), /at 15 fps, from frame 5 on, y up/);
  // what can't be is refused, and the fields say what is so
  await panel.locator('[name=root]').fill('nobody');
  await panel.locator('[name=root]').press('Tab');
  await page.locator('.toast.trouble', { hasText: "it can't be read" }).waitFor();
  await page.waitForFunction(() => document.querySelector('dialog.reading [name=root]').value === '');
  // the browser's console notes the answer; nothing else was said
  assert.match(page.complaints.splice(0).join(), /^Failed to load resource[^,]* 409 [^,]*reading$/);
  await page.screenshot({ path: process.env.SHOTS ? join(process.env.SHOTS, 'panel.png') : at('panel.png') });
  await panel.getByRole('button', { name: 'Close' }).click();

  // a map of one's own is one of the choices
  execFileSync(KINELM, ['inspect', plain, '--map-out', at('my rig.toml')], { stdio: 'pipe' });
  await page.locator('input[type=file]').first().setInputFiles([at('my rig.toml')]);
  await page.waitForFunction(() => window.studio.store.state.maps.includes('maps/my rig.toml'));
  await menu('plain', /How it is read/);
  const mapped = await says('map', 'maps/my rig.toml');
  assert.equal(mapped.state, 'ready', JSON.stringify(mapped));
  await isWhole('plain');
  assert.match(await state(() => window.studio.store.timeline.text), /map = "maps\/my rig.toml"/);
  await panel.getByRole('button', { name: 'Close' }).click();

  // a clip that can't be read has the same menu
  await menu('unit', /How it is read/);
  assert.match(await panel.innerText(), /unit/);
  const unit = await read('unit', async () => {
    await panel.locator('[name=unit]').fill('0.35 m');
    await panel.locator('[name=unit]').press('Tab');
  });
  assert.equal(unit.state, 'ready', JSON.stringify(unit));
  await panel.getByRole('button', { name: 'Close' }).click();

  // what is stated in the text holds for the card
  const text = await state(() => window.studio.store.timeline.text);
  const clip = await read('plain', () => write(text.replace('fps_source = 15', 'fps_source = 20').replace(/^to = .*$/m, 'to = 1')));
  assert.ok(clip.fps === 20 && clip.reading.fps_source === 20, JSON.stringify(clip));
  assert.match(await card('plain').locator('.stated').innerText(), /at 20 fps/);

  // trouble is shown, with the segments as the text has them
  for (const wrong of ['to = 99', 'to = "soon"', 'to = nan', 'nonsense = 1', '']) {
    await write(text.replace(/^to = .*$/m, wrong));
    await page.locator('.trouble-line:visible').waitFor();
    assert.equal(await page.locator('#clips-lane .block').count(), 1, wrong);
    assert.deepEqual(page.complaints, [], wrong);
  }
  await page.screenshot({ path: process.env.SHOTS ? join(process.env.SHOTS, 'trouble.png') : at('trouble.png') });
  await write(text);
  await page.locator('.trouble-line').waitFor({ state: 'hidden' });
  console.log('ok the text holds for the card, and its trouble is shown');

  // a narrow window is told so
  await page.setViewportSize({ width: 690, height: 800 });
  await page.locator('#narrow').waitFor();
  assert.match(await page.locator('#narrow').innerText(), /700 pixels/);
  await page.setViewportSize({ width: 700, height: 800 });
  await page.locator('#narrow').waitFor({ state: 'hidden' });
  assert.deepEqual(page.complaints, []);

  // an exception is said, with a way on
  await state(() => setTimeout(() => { throw new Error('a test of the page'); }));
  await page.locator('#fault').waitFor();
  assert.equal(page.complaints.length, 1);
  await page.locator('#fault button').click();
  await page.waitForFunction(() => window.studio?.store.ready);
  assert.equal(await page.locator('#fault').count(), 0);
  console.log('ok an exception is said');
} catch (error) {
  await page.screenshot({ path: join(tmpdir(), 'studio-doubts-failed.png') }).catch(() => {});
  console.error(error, page.complaints);
  process.exitCode = 1;
} finally {
  await own.end().catch(() => {});
  await browser.close();
  rmSync(folder, { recursive: true, force: true });
}
