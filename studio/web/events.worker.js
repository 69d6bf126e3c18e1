// One stream of events for all tabs: a browser opens six connections to a host, and a stream takes one for good.

import { openStream } from './events.js';

/** @type {Set<MessagePort>} */
const ports = new Set();
/** @type {EventSource | null} */
let stream = null;
/** @type {import('./events.js').Happening | null} what the server said first, while it answers */
let hello = null;

/** @param {import('./events.js').Happening} happening */
function happened(happening) {
  if (happening.name === 'hello') hello = { ...happening, data: { ...happening.data, resumed: false } };
  else if (happening.name === 'lost') hello = null;
  for (const port of ports) port.postMessage(happening);
}

/** @param {MessagePort} port @param {'here' | 'gone'} word */
function heard(port, word) {
  if (word === 'gone') {
    ports.delete(port);
    return;
  }
  ports.add(port);
  // one that was refused isn't tried again by itself; a studio that was started anew has let this tab in
  if (!stream || stream.readyState === EventSource.CLOSED) stream = openStream(happened);
  else if (hello) port.postMessage(hello);
}

addEventListener('connect', event => {
  const [port] = /** @type {MessageEvent} */ (event).ports;
  port.onmessage = ({ data }) => heard(port, data);
});
