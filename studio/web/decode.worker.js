// Loads figures and decodes their numbers, beside the page: a long clip would stop it for a second.

import { decoded } from './figure.js';

addEventListener('message', async event => {
  const { id, url } = event.data;
  try {
    const response = await fetch(url),
      head = await response.json();
    if (!response.ok) throw new Error(head?.error?.text ?? `the studio answered ${response.status}`);
    const numbers = decoded(head.data);
    head.data = '';
    // the highest point, which the page would look for in all of them
    let top = 0;
    for (let i = 1; i < numbers.length; i += 3) if (numbers[i] > top) top = numbers[i];
    const reply = { id, head, numbers, top: head.low[1] + head.step * top };
    self.postMessage(reply, { transfer: [numbers.buffer] });
  } catch (error) {
    self.postMessage({ id, error: error instanceof Error ? error.message : String(error) });
  }
});
