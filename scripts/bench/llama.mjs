// Tokens a second of llama.cpp: `node llama.mjs FOLDER MODEL.gguf THREADS`, with node-llama-cpp in the folder. One JSON line;
// with one thread by the processor's time of the process.
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';

const [, , folder, file, threads] = process.argv;
const entry = createRequire(join(folder, 'package.json')).resolve('node-llama-cpp');
const { getLlama, LlamaLogLevel } = await import(pathToFileURL(entry).href);
const [CONTEXT, STEPS, REPEATS] = [1000, 32, 5];
const now = () => {
  const { user, system } = process.cpuUsage();
  return Number(threads) === 1 ? (user + system) / 1e6 : performance.now() / 1e3;
};
const median = all => all.sort((a, b) => a - b)[all.length >> 1];

const llama = await getLlama({ gpu: false, build: 'never', logLevel: LlamaLogLevel.error, maxThreads: Number(threads) });
const model = await llama.loadModel({ modelPath: file });
const context = await model.createContext({ contextSize: 1024, batchSize: 1024, threads: Number(threads) });
const sequence = context.getSequence();
const ids = Array.from({ length: CONTEXT }, (_, i) => 6 + ((i * 7919) % 360));
const rates = { decode: [], prefill: [] };
for (let round = 0; round <= REPEATS; round++) {
  await sequence.clearHistory();
  let begun = now();
  await sequence.evaluateWithoutGeneratingNewTokens(ids.slice(0, CONTEXT - STEPS));
  const prefill = (CONTEXT - STEPS) / (now() - begun);
  begun = now();
  let made = 0;
  // greedy: the cheapest choice of a token, as the others make it
  for await (const _ of sequence.evaluate(ids.slice(CONTEXT - STEPS, CONTEXT - STEPS + 1), { temperature: 0, yieldEogToken: true }))
    if (++made === STEPS - 1) break;
  // the first round warms up
  if (round) {
    rates.decode.push(made / (now() - begun));
    rates.prefill.push(prefill);
  }
}
console.log(JSON.stringify({ decode: median(rates.decode), prefill: median(rates.prefill) }));
process.exit(0);
