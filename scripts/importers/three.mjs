// Joint positions as three.js has them after its import of a BVH or GLB; of a GLB also what Khronos's validator says.
//
//     npm install three gltf-validator
//     node scripts/importers/three.mjs dance.glb FPS positions.json
//
// Writes {"frames": [{joint: [x, y, z]}]} in metres, y up.
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const require = createRequire(pathToFileURL(process.cwd() + '/'));
const load = (path) => import(pathToFileURL(`${process.cwd()}/node_modules/${path}`));
const THREE = await load('three/build/three.module.js');
globalThis.self = globalThis;

const [source, fps, target] = process.argv.slice(2);
const bytes = readFileSync(source);
let clip, scene;
if (source.endsWith('.bvh')) {
  const { BVHLoader } = await load('three/examples/jsm/loaders/BVHLoader.js');
  const read = new BVHLoader().parse(bytes.toString());
  clip = read.clip;
  scene = read.skeleton.bones[0];
} else {
  const said = await require('gltf-validator').validateBytes(new Uint8Array(bytes));
  const { numErrors, numWarnings, numInfos } = said.issues;
  console.log(`${source}: glTF-Validator: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos`);
  if (numErrors + numWarnings > 0) console.log(JSON.stringify(said.issues.messages.slice(0, 5)));
  const { GLTFLoader } = await load('three/examples/jsm/loaders/GLTFLoader.js');
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
  const read = await new Promise((ready, failed) => new GLTFLoader().parse(buffer, '', ready, failed));
  clip = read.animations[0];
  scene = read.scene;
}
const mixer = new THREE.AnimationMixer(scene);
const action = mixer.clipAction(clip);
action.setLoop(THREE.LoopOnce).clampWhenFinished = true;
action.play();
const frames = [];
const count = Math.round(clip.duration * Number(fps)) + 1;
for (let f = 0; f < count; f++) {
  mixer.setTime(f / Number(fps));
  scene.updateMatrixWorld(true);
  const joints = {};
  scene.traverse((node) => {
    if (node.isBone && node.name !== 'ENDSITE') joints[node.name] = node.getWorldPosition(new THREE.Vector3()).toArray();
  });
  frames.push(joints);
}
writeFileSync(target, JSON.stringify({ program: `three.js ${THREE.REVISION}`, frames }));
