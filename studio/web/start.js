// Before anything is drawn: the colours of the night, where it is night. Then the first picture, and only then the modules,
// whose work would put it off.

{
  const chosen = localStorage.getItem('kinelm-theme');
  const isDark = chosen === 'dark' || (chosen !== 'light' && matchMedia('(prefers-color-scheme: dark)').matches);
  document.documentElement.classList.toggle('dark', isDark);
  const open = () => import('./main.js');
  // a page that isn't seen draws nothing
  if (document.hidden) open();
  else requestAnimationFrame(() => setTimeout(open));
}
