// Opens the panes, then listens to the server.

import { openDrop } from './drop.js';
import { openKeys } from './keys.js';
import { openLibrary } from './library.js';
import { listen } from './live.js';
import { openForm } from './make-form.js';
import { openMusic } from './music.js';
import { openRecorder } from './record.js';
import { costs, openStage, stage } from './stage-view.js';
import { store, ui } from './store.js';
import { openTakes } from './takes.js';
import { apply } from './theme.js';
import { openTimeline } from './timeline.js';
import { openTop } from './top.js';
import { openTransport } from './transport.js';

openTop();
openTransport();
openStage();
openMusic();
openRecorder();
openTimeline();
openLibrary();
openForm();
openTakes();
openDrop();
openKeys();
apply();
listen();

// For tests and the browser's console.
Object.assign(window, { studio: { stage, store, ui, costs } });
