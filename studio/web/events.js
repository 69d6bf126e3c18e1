// The stream of events, in the page or in the worker that all tabs share.

/** @typedef {{ name: string, id: number, data: any }} Happening what the server sent; `hello`, and `lost` where it broke off */

const NAMES = [
  'hello', 'clip', 'clip_removed', 'job', 'frames', 'dance', 'dance_removed', 'timeline', 'undo', 'maps', 'music',
];

/** @param {(happening: Happening) => void} does */
export function openStream(does) {
  const stream = new EventSource('/api/events');
  for (const name of NAMES)
    stream.addEventListener(name, event => does({ name, id: Number(event.lastEventId), data: JSON.parse(event.data) }));
  stream.onerror = () => does({ name: 'lost', id: 0, data: null });
  return stream;
}
