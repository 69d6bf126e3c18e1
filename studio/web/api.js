// Requests to the server.

/** @typedef {import('./types.js').Timeline} Timeline */

export class Refused extends Error {
  /** @param {string} kind @param {string} text */
  constructor(kind, text) {
    super(text);
    this.kind = kind;
  }
}

/** @param {Response} response */
async function answer(response) {
  const body = await response.json().catch(() => null);
  if (response.ok) return body;
  const error = body?.error ?? { kind: 'failed', text: `the studio answered ${response.status}` };
  throw new Refused(error.kind, error.text);
}

/** @param {string} path @returns {Promise<any>} */
export async function get(path) {
  return answer(await fetch(path).catch(lost));
}

/** @param {string} path @param {any} [body] @returns {Promise<any>} */
export async function post(path, body = {}) {
  const headers = { 'Content-Type': 'application/json' };
  return answer(await fetch(path, { method: 'POST', headers, body: JSON.stringify(body) }).catch(lost));
}

/** @param {File} file @returns {Promise<{ id: string | null }>} */
export async function upload(file) {
  const headers = { 'Content-Type': 'application/octet-stream' };
  const to = `/api/clips?name=${encodeURIComponent(file.name)}`;
  return answer(await fetch(to, { method: 'POST', headers, body: file }).catch(lost));
}

/** @param {File} file @returns {Promise<{ map: string }>} */
export async function uploadMap(file) {
  const headers = { 'Content-Type': 'application/octet-stream' };
  const to = `/api/maps?name=${encodeURIComponent(file.name)}`;
  return answer(await fetch(to, { method: 'POST', headers, body: file }).catch(lost));
}

/** @returns {never} */
function lost() {
  throw new Refused('lost', 'the studio does not answer; is the program still running?');
}

/** @param {...import('./types.js').Edit} edits @returns {Promise<Timeline>} */
export const edit = (...edits) => post('/api/timeline', { edits });
