// A character of the user's own: danced on from its card's menu, seen with its mesh, exported as its own file, mirrored, retimed.

import assert from 'node:assert/strict';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { character, dance } from './clips.mjs';
import { idle, launch, open, studio } from './lib.mjs';

const browser = await launch();
if (!browser) process.exit(0);
const folder = mkdtempSync(join(tmpdir(), 'kinelm-character-'));
const hero = character(dance(folder, 'mine.bvh', 2), join(folder, 'hero.glb'));
const own = await studio({ files: [hero] });
const page = await open(browser, own, { still: true });
const card = name => page.locator('.card', { has: page.locator('.name', { hasText: new RegExp(`^${name}$`) }) });
const ready = name =>
  page.waitForFunction(
    name => window.studio.store.state.clips.some(clip => clip.name === name && clip.state === 'ready'),
    name,
    { timeout: 60e3 },
  );

/** @param {Buffer} glb */
const documentOf = glb => JSON.parse(glb.subarray(20, 20 + glb.readUInt32LE(12)).toString());

/** How far each point of a figure is from the nearest node of the character that is drawn, metres, at some times. */
const apart = id =>
  page.evaluate(async id => {
    const { parse } = await import('/assets/glb.js'),
      { Character } = await import('/assets/character.js'),
      { Figure, decoded } = await import('/assets/figure.js');
    const head = await (await fetch(`/api/clips/${id}/figure`)).json(),
      figure = new Figure(head, decoded(head.data));
    const answer = await fetch(`/api/clips/${id}/character`),
      toStage = answer.headers.get('kinelm-to-stage').split(' ').map(Number);
    const one = new Character(parse(await answer.arrayBuffer(), 'on the stage'), Float32Array.from(toStage));
    // a joint comes before the ends of its limb, which no node stands for
    const isJoint = head.joints.map((joint, i) => head.joints.findIndex(other => other?.smpl === joint?.smpl) === i);
    let most = 0;
    for (let frame = 0; frame < figure.frames; frame += 7) {
      figure.places(frame / figure.fps, figure.now);
      one.pose(frame / figure.fps);
      for (const [i, joint] of head.joints.entries()) {
        if (joint?.smpl === undefined || !isJoint[i]) continue;
        const far = one.worlds.map(m => Math.hypot(...[0, 1, 2].map(k => m[12 + k] - figure.now[3 * i + k])));
        most = Math.max(most, Math.min(...far));
      }
    }
    return most;
  }, id);

/** The stage's picture of a moment. */
async function picture() {
  await page.evaluate(() => window.studio.stage.seek(1));
  await page.waitForTimeout(300);
  return page.locator('#stage').screenshot();
}

try {
  await ready('hero');
  await card('hero').locator('button[aria-haspopup=menu]').click();
  await page.getByRole('menuitem', { name: /^Salsa on this character/ }).click();
  await page.waitForFunction(() => window.studio.store.state.jobs.length > 0);
  await idle(page);
  const { make, dances } = await page.evaluate(() => window.studio.store.state.jobs.at(-1));
  assert.deepEqual([make.kind, make.clip, make.labels], ['free', 'c1', { genre: 'salsa' }]);
  console.log('ok danced on from the menu');

  for (const id of ['c1', dances[0]]) {
    const far = await apart(id);
    // a figure's numbers have steps of a millimetre or less
    assert.ok(far < 0.002, `${id}: ${far} m`);
  }
  const mesh = page.getByRole('button', { name: 'Mesh', exact: true });
  await mesh.waitFor();
  await page.waitForTimeout(2000);
  const worn = await picture();
  await page.keyboard.press('b');
  const capsules = await picture();
  assert.equal(await mesh.getAttribute('aria-pressed'), 'false');
  assert.ok(!worn.equals(capsules), 'the mesh is drawn');
  await page.keyboard.press('b');
  console.log('ok seen with its mesh, where its figure is');

  const [exported, status] = await page.evaluate(async id => {
    const answer = await fetch(`/api/dances/${id}/export?format=glb`);
    return [Array.from(new Uint8Array(await answer.arrayBuffer())), answer.status];
  }, dances[0]);
  assert.equal(status, 200);
  const [before, after] = [readFileSync(hero), Buffer.from(exported)].map(documentOf);
  assert.deepEqual([after.meshes, after.nodes, after.asset], [before.meshes, before.nodes, before.asset]);
  assert.equal(after.animations.length, before.animations.length + 1);
  console.log(`ok exported as its own file, with ${after.animations.at(-1).name}`);

  await card('hero').locator('button[aria-haspopup=menu]').click();
  await page.getByRole('menuitem', { name: /^Mirror/ }).click();
  await ready('hero mirrored');
  await card('hero mirrored').locator('button[aria-haspopup=menu]').click();
  await page.getByRole('menuitem', { name: /^Retime/ }).click();
  await page.getByLabel('Speed, 0.5 to 2 times its own').fill('2');
  await page.getByRole('button', { name: 'Make the clip' }).click();
  await ready('hero mirrored at 2 times');
  const clips = await page.evaluate(() => window.studio.store.state.clips);
  assert.deepEqual(clips.map(clip => clip.character), [true, true, true]);
  assert.ok(Math.abs(clips[2].seconds - clips[0].seconds / 2) < 0.05, `${clips[2].seconds} s`);
  assert.ok((await apart(clips[2].id)) < 0.002);
  console.log('ok mirrored and retimed');
  assert.deepEqual(page.complaints, []);
} finally {
  await browser.close();
  await own.end();
  rmSync(folder, { recursive: true, force: true });
}
