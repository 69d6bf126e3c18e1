// Where this tab hears of events: from a worker that all tabs share, or by a stream of its own where there is none.

import { openStream } from './events.js';

/** @param {(happening: import('./events.js').Happening) => void} does */
export function listenTo(does) {
  if (typeof SharedWorker === 'undefined') {
    openStream(does);
    return;
  }
  const worker = new SharedWorker('/assets/events.worker.js', { type: 'module', name: 'kinelm events' }),
    { port } = worker;
  // a browser that has such workers may still not run this one
  worker.onerror = () => {
    worker.onerror = null;
    openStream(does);
  };
  port.onmessage = ({ data }) => does(data);
  port.postMessage('here');
  addEventListener('pagehide', () => port.postMessage('gone'));
  // a tab that was kept aside is told all anew
  addEventListener('pageshow', ({ persisted }) => {
    if (persisted) port.postMessage('here');
  });
}
