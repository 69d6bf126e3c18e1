// Twenty tabs of one browser, at loopback and under a name of --bind, and one more while a dance is sampled; then a browser
// whose tabs share no worker. KINELM names the program; `node tabs.mjs`.

import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { networkInterfaces } from 'node:os';
import { launch, studio, tab } from './lib.mjs';

const PATIENCE = 120e3,
  TABS = 20,
  // sampled for as long as any machine needs to open a tab, and then cancelled
  LONG_S = 600;

const browser = await launch();
if (!browser) process.exit(0);
// an address of this machine that isn't loopback, as --bind takes it
const own = Object.values(networkInterfaces()).flat().find(one => one.family === 'IPv4' && !one.internal)?.address;
if (!own) console.error('SKIPPED --bind: this machine has no address but loopback');
const server = await studio({ args: ['--empty', ...(own ? ['--bind', own] : [])] });
const token = () => /url=(http:\/\/127\.0\.0\.1:\d+)(\/enter\?token=\w+)/.exec(readFileSync(server.file, 'utf8'));

const make = (page, seconds) =>
  page.evaluate(async seconds => {
    const body = JSON.stringify({ kind: 'free', variations: 1, seconds });
    const headers = { 'Content-Type': 'application/json' };
    const answer = await fetch('/api/make', { method: 'POST', headers, body });
    return (await answer.json()).job;
  }, seconds);
const samples = (page, job) =>
  page.waitForFunction(
    job => window.studio.store.state.jobs.some(one => one.id === job && one.state === 'running' && one.frames > 20),
    job,
    { timeout: PATIENCE },
  );

try {
  for (const host of ['127.0.0.1', ...(own ? [own] : [])]) {
    const context = await browser.newContext({ viewport: { width: 720, height: 420 }, reducedMotion: 'reduce' });
    const streams = [];
    context.on('request', request => request.url().includes('/api/events') && streams.push(request.frame().url()));
    const [, at, enter] = token(),
      address = at.replace('127.0.0.1', host);
    const pages = [await tab(context, address + enter)];
    assert.equal(await pages[0].evaluate(() => window.isSecureContext), host === '127.0.0.1');
    while (pages.length < TABS) pages.push(await tab(context, `${address}/`));
    // every one of them is answered
    await Promise.all(
      pages.map(page => page.evaluate(() => fetch('/api/state', { signal: AbortSignal.timeout(20e3) }).then(answer => answer.json()))),
    );
    // and hears what happens, one that comes in the middle too, from the beginning
    const job = await make(pages[0], LONG_S);
    await samples(pages[0], job);
    const late = await tab(context, `${address}/`);
    const heard = await late.evaluate(async job => {
      const { loaded } = await import('/assets/figures.js');
      const of = () => window.studio.store.state.jobs.find(one => one.id === job);
      const begun = Date.now();
      for (;;) {
        const figure = loaded(of()?.dances[0] ?? ''),
          isZero = figure && figure.numbers.subarray(0, 3 * figure.head.points).every(number => number === 0);
        if (figure?.live && figure.frames > 30 && of().state === 'running') return { frames: figure.frames, isZero };
        if (Date.now() - begun > 60e3 || of()?.state !== 'running') return { job: of(), frames: figure?.frames };
        await new Promise(done => setTimeout(done, 50));
      }
    }, job);
    assert.ok(heard.frames > 30 && heard.isZero === false, JSON.stringify(heard));
    await pages[TABS - 1].evaluate(job => fetch(`/api/jobs/${job}/cancel`, { method: 'POST' }), job);
    for (const page of [...pages, late]) {
      await page.waitForFunction(
        job => window.studio.store.state.jobs.find(one => one.id === job)?.state === 'cancelled',
        job,
        { timeout: PATIENCE },
      );
      assert.deepEqual(page.complaints, []);
    }
    // a tab that goes leaves the others their stream
    for (const page of pages.slice(0, TABS - 1)) await page.close();
    const last = await make(late, 1);
    await late.waitForFunction(
      job => window.studio.store.state.jobs.find(one => one.id === job)?.state === 'done',
      last,
      { timeout: PATIENCE },
    );
    assert.deepEqual(streams, [], 'no tab has a stream of its own');
    await context.close();
    console.log(`ok ${TABS} tabs at ${host === own ? 'an address of --bind' : host}`);
  }
  const context = await browser.newContext({ viewport: { width: 720, height: 420 }, reducedMotion: 'reduce' });
  await context.addInitScript(() => Reflect.deleteProperty(window, 'SharedWorker'));
  const [, at, enter] = token(),
    page = await tab(context, at + enter);
  const job = await make(page, LONG_S);
  await samples(page, job);
  const late = await tab(context, `${at}/`);
  await samples(late, job);
  await page.evaluate(job => fetch(`/api/jobs/${job}/cancel`, { method: 'POST' }), job);
  await late.waitForFunction(job => window.studio.store.state.jobs.find(one => one.id === job)?.state === 'cancelled', job);
  assert.deepEqual([...page.complaints, ...late.complaints], []);
  console.log('ok streams of their own');
} catch (error) {
  console.error(error);
  process.exitCode = 1;
} finally {
  await server.end().catch(() => {});
  await browser.close();
}
