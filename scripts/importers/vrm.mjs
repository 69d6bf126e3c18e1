// Positions of an avatar's bones as three-vrm has them that plays a VRM animation; and what Khronos's validator says of it.
//
//     npm install three@0.187.0 gltf-validator @pixiv/three-vrm@3.5.5 @pixiv/three-vrm-animation@3.5.5
//     node scripts/importers/vrm.mjs dance.vrma FPS positions.json avatar.vrm
//
// Writes {"frames": [{joint: [x, y, z]}], "hips", "ratio"} in metres, y up, facing +z (a VRM 0 is turned as its players turn
// it): the hips' name, and how high the avatar's are at rest over the animation's. Fails where the validator finds an error or
// has a warning, or the loader has one.
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const require = createRequire(pathToFileURL(process.cwd() + '/'));
const load = (path) => import(pathToFileURL(`${process.cwd()}/node_modules/${path}`));
// the bare names inside the packages lead to this very copy
const THREE = await load('three/build/three.module.js');
const { GLTFLoader } = await load('three/examples/jsm/loaders/GLTFLoader.js');
const { VRMLoaderPlugin, VRMUtils } = await load('@pixiv/three-vrm/lib/three-vrm.module.js');
const { VRMAnimationLoaderPlugin, createVRMAnimationClip } =
  await load('@pixiv/three-vrm-animation/lib/three-vrm-animation.module.js');
const { version } = require('@pixiv/three-vrm-animation/package.json');
globalThis.self = globalThis;

// what the loader says of the animation; three-vrm speaks of avatars too
console.warn = (said) => {
  if (!`${said}`.startsWith('VRMAnimationLoaderPlugin')) return;
  console.log(said);
  process.exitCode = 1;
};

const [source, fps, target, avatar] = process.argv.slice(2);
const bytes = readFileSync(source);
const { issues } = await require('gltf-validator').validateBytes(new Uint8Array(bytes), { maxIssues: 0 });
const of = {};
for (const { code } of issues.messages) of[code] = (of[code] ?? 0) + 1;
console.log(`glTF-Validator: ${issues.numErrors} errors, ${issues.numWarnings} warnings, ${issues.numInfos} infos`, of);
if (issues.numErrors + issues.numWarnings > 0) process.exitCode = 1;

const loader = new GLTFLoader();
loader.register((parser) => new VRMLoaderPlugin(parser));
loader.register((parser) => new VRMAnimationLoaderPlugin(parser));
const read = (bytes) => {
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
  return new Promise((ready, failed) => loader.parse(buffer, '', ready, failed));
};
const [animation] = (await read(bytes)).userData.vrmAnimations;
const { vrm } = (await read(readFileSync(avatar))).userData;
const at = (node) => node.getWorldPosition(new THREE.Vector3()).toArray();
const bones = Object.values(vrm.humanoid.humanBones).map(({ node }) => node);
const hips = vrm.humanoid.getRawBoneNode('hips');
vrm.scene.updateMatrixWorld(true);
const ratio = at(hips)[1] / animation.restHipsPosition.y;
VRMUtils.rotateVRM0(vrm);

const clip = createVRMAnimationClip(animation, vrm);
const mixer = new THREE.AnimationMixer(vrm.scene);
const action = mixer.clipAction(clip);
action.setLoop(THREE.LoopOnce).clampWhenFinished = true;
action.play();
// the loader takes what its paths can't hold out of names, and keeps the file's own beside them
const name = (node) => node.userData.name ?? node.name;
const frames = [];
const count = Math.round(clip.duration * Number(fps)) + 1;
for (let f = 0; f < count; f++) {
  mixer.setTime(f / Number(fps));
  vrm.update(0);
  vrm.scene.updateMatrixWorld(true);
  frames.push(Object.fromEntries(bones.map((node) => [name(node), at(node)])));
}
const program = `three-vrm-animation ${version}, VRM ${vrm.meta.metaVersion}`;
writeFileSync(target, JSON.stringify({ program, frames, hips: name(hips), ratio }));
