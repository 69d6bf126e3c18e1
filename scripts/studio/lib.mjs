// A studio and a browser for tests, pictures and measurements.

import { chromium } from 'playwright-core';
import { spawn } from 'node:child_process';
import { existsSync, mkdtempSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const BROWSERS = ['chromium-headless-shell', 'chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable'];
const DRAWING = ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'];

// The program: KINELM, or the one on the PATH.
export const KINELM = process.env.KINELM ?? 'kinelm';

function browserPath() {
  const folders = (process.env.PATH ?? '').split(':');
  return BROWSERS.flatMap(name => folders.map(folder => join(folder, name))).find(existsSync);
}

/** The browser, or null after a line that says what is missing. */
export async function launch() {
  const executablePath = browserPath();
  if (!executablePath) {
    console.error('SKIPPED: no chromium on the PATH');
    return null;
  }
  return chromium.launch({
    executablePath,
    args: ['--no-sandbox', '--disable-quic', '--autoplay-policy=no-user-gesture-required', ...DRAWING],
  });
}

/** A studio of a project in a new folder, or in that of an earlier one. */
export async function studio({ folder, files = [], args = [] } = {}) {
  const at = folder ?? mkdtempSync(join(tmpdir(), 'kinelm-studio-'));
  const extra = process.env.STUDIO_ASSETS ? ['--assets', process.env.STUDIO_ASSETS] : [];
  const child = spawn(KINELM, ['studio', join(at, 'project'), ...files, '--no-open', ...extra, ...args], {
    stdio: ['ignore', 'pipe', 'pipe'],
  });
  let said = '';
  child.stderr.on('data', data => {
    said += data;
  });
  const file = await new Promise((done, fail) => {
    let text = '';
    child.stdout.on('data', data => {
      text += data;
      const found = /open (.*)\n/.exec(text);
      if (found) done(found[1]);
    });
    child.on('error', fail);
    child.on('exit', code => fail(new Error(`kinelm studio ended with ${code}: ${said}`)));
  });
  const ended = new Promise(done => child.on('exit', done));
  return {
    file,
    folder: at,
    project: join(at, 'project'),
    async stop() {
      child.kill('SIGINT');
      await ended;
    },
    async end() {
      child.kill('SIGINT');
      await ended;
      rmSync(at, { recursive: true, force: true });
    },
  };
}

/** The studio's page, loaded, in a browser of its own. */
export async function open(browser, { file }, { width = 1280, height = 800, dark = false, still = false } = {}) {
  const context = await browser.newContext({
    viewport: { width, height },
    colorScheme: dark ? 'dark' : 'light',
    reducedMotion: still ? 'reduce' : 'no-preference',
    acceptDownloads: true,
  });
  return tab(context, `file://${file}`);
}

/** The studio's page in a tab of a browser; what it complains of is collected in `page.complaints`. */
export async function tab(context, address) {
  const page = await context.newPage();
  page.complaints = [];
  page.on('pageerror', error => page.complaints.push(String(error.stack ?? error)));
  page.on('console', message => {
    const { url } = message.location(),
      text = message.text();
    // the small page that leads in has no icon, and a browser asks for one; under a name of --bind nothing is encrypted
    const isKnown = url.endsWith('/favicon.ico') || text.startsWith('The Cross-Origin-Opener-Policy header has been ignored');
    if (message.type() === 'error' && !isKnown) page.complaints.push(`${text} ${url}`);
  });
  await page.goto(address);
  await page.waitForURL(/^http:/, { timeout: 30e3 });
  await page.waitForFunction(() => window.studio?.store.ready, null, { timeout: 60e3 });
  return page;
}

/** Waits until no job runs. */
export async function idle(page, timeout = 600e3) {
  await page.waitForFunction(
    () => {
      const { jobs } = window.studio.store.state;
      return jobs.length > 0 && jobs.every(job => !['running', 'waiting'].includes(job.state));
    },
    null,
    { timeout },
  );
}
