// Any exception of the page is said, with a button that loads the page anew: what is drawn may be wrong from then on.

{
  /** @param {string} text */
  const show = text => {
    // the first one: others follow from it
    if (document.getElementById('fault')) return;
    const box = document.createElement('p'),
      again = document.createElement('button');
    box.id = 'fault';
    box.setAttribute('role', 'alert');
    box.textContent = `The page made a mistake, and may show what isn’t so (${text}). What you did is saved. `;
    again.type = 'button';
    again.textContent = 'Reload';
    again.addEventListener('click', () => location.reload());
    box.append(again);
    document.documentElement.append(box);
  };
  addEventListener('error', event => {
    // a browser's own remark: sizes changed while they were looked at, and it looks again
    if (event.message.startsWith('ResizeObserver loop')) return;
    show(event.message);
  });
  addEventListener('unhandledrejection', ({ reason }) => {
    show(reason instanceof Error ? reason.message : String(reason));
  });
}
