// Joint positions as three.js has them after its import of a BVH or GLB; of a GLB also what Khronos's validator says.
//
//     npm install three gltf-validator
//     node scripts/importers/three.mjs dance.glb FPS positions.json [ANIMATION hero.glb]
//
// Writes {"frames": [{joint: [x, y, z]}]} in metres, y up. Of a character with ANIMATION, that one; fails where the validator
// says what it didn't say of hero.glb, the file before, or vertices of a mesh leave the bones that carry them.
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const require = createRequire(pathToFileURL(process.cwd() + '/'));
const load = (path) => import(pathToFileURL(`${process.cwd()}/node_modules/${path}`));
const THREE = await load('three/build/three.module.js');
globalThis.self = globalThis;

const [source, fps, target, animation, hero] = process.argv.slice(2);
const bytes = readFileSync(source);
let clip, scene;
if (source.endsWith('.bvh')) {
  const { BVHLoader } = await load('three/examples/jsm/loaders/BVHLoader.js');
  const read = new BVHLoader().parse(bytes.toString());
  clip = read.clip;
  scene = read.skeleton.bones[0];
} else {
  const validate = (bytes) => require('gltf-validator').validateBytes(new Uint8Array(bytes), { maxIssues: 0 });
  const said = await validate(bytes);
  if (hero) {
    const counts = ({ issues }) => {
      const of = {};
      for (const { code } of issues.messages) of[code] = (of[code] ?? 0) + 1;
      return of;
    };
    const [before, after] = [counts(await validate(readFileSync(hero))), counts(said)];
    const more = Object.entries(after).filter(([code, n]) => n > (before[code] ?? 0));
    if (more.length) {
      console.log(`${source}: glTF-Validator, of this file alone:`, more);
      process.exitCode = 1;
    }
  }
  const { numErrors, numWarnings, numInfos } = said.issues;
  console.log(`${source}: glTF-Validator: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos`);
  if (numErrors + numWarnings > 0) console.log(JSON.stringify(said.issues.messages.slice(0, 5)));
  const { GLTFLoader } = await load('three/examples/jsm/loaders/GLTFLoader.js');
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
  const read = await new Promise((ready, failed) => new GLTFLoader().parse(buffer, '', ready, failed));
  clip = animation ? read.animations.find(({ name }) => name === animation) : read.animations[0];
  scene = read.scene;
}
const mixer = new THREE.AnimationMixer(scene);
const action = mixer.clipAction(clip);
action.setLoop(THREE.LoopOnce).clampWhenFinished = true;
action.play();
// How far vertices are from the joints that carry them alone, which no dance changes.
const distances = new Map();
let [vertices, furthest] = [0, 0];
function carried(mesh, f) {
  const { skinIndex, skinWeight, position } = mesh.geometry.attributes;
  for (let v = 0; v < position.count; v += 13) {
    if (skinWeight.getX(v) < 0.9999) continue;
    const at = mesh.getVertexPosition(v, new THREE.Vector3()).applyMatrix4(mesh.matrixWorld);
    const bone = mesh.skeleton.bones[skinIndex.getX(v)];
    const distance = at.distanceTo(bone.getWorldPosition(new THREE.Vector3()));
    const key = `${mesh.uuid} ${v}`;
    if (f === 0) distances.set(key, distance), vertices++;
    furthest = Math.max(furthest, Math.abs(distance - distances.get(key)));
  }
}
const frames = [];
const count = Math.round(clip.duration * Number(fps)) + 1;
for (let f = 0; f < count; f++) {
  mixer.setTime(f / Number(fps));
  scene.updateMatrixWorld(true);
  const joints = {};
  scene.traverse((node) => {
    // the loader takes what its paths can't hold out of names, and keeps the file's own beside them
    const name = node.userData.name ?? node.name;
    if (node.isBone && node.name !== 'ENDSITE') joints[name] = node.getWorldPosition(new THREE.Vector3()).toArray();
    if (hero && node.isSkinnedMesh) carried(node, f);
  });
  frames.push(joints);
}
if (hero) {
  console.log(`${vertices} vertices within ${(1000 * furthest).toFixed(4)} mm of where their joint carries them`);
  if (!(furthest < 0.0001) || vertices === 0) process.exitCode = 1;
}
writeFileSync(target, JSON.stringify({ program: `three.js ${THREE.REVISION}`, frames }));
