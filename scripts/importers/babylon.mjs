// Joint positions as Babylon.js has them after its import of a character's GLB, right-handed.
//
//     npm install @babylonjs/core@9.28.0 @babylonjs/loaders@9.28.0
//     node scripts/importers/babylon.mjs hero.glb FPS positions.json ANIMATION
//
// Writes {"frames": [{joint: [x, y, z]}]} in metres, y up.
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const require = createRequire(pathToFileURL(process.cwd() + '/'));
const load = (name) => import(pathToFileURL(require.resolve(name)));
const { NullEngine } = await load('@babylonjs/core/Engines/nullEngine.js');
const { Scene } = await load('@babylonjs/core/scene.js');
const { LoadAssetContainerAsync } = await load('@babylonjs/core/Loading/sceneLoader.js');
const { Engine } = await load('@babylonjs/core/Engines/engine.js');
await load('@babylonjs/loaders/glTF/2.0/glTFLoader.js');
await load('@babylonjs/loaders/glTF/glTFFileLoader.js');

const [source, fps, target, animation] = process.argv.slice(2);
const scene = new Scene(new NullEngine());
scene.useRightHandedSystem = true;
const bytes = new Uint8Array(readFileSync(source));
const container = await LoadAssetContainerAsync(bytes, scene, { pluginExtension: '.glb' });
container.addAllToScene();
const group = container.animationGroups.find(({ name }) => name === animation);
container.animationGroups.forEach((other) => other.stop());
group.start(false);
group.pause();
const joints = new Set(container.skeletons.flatMap(({ bones }) => bones.map((bone) => bone.getTransformNode())));
const rate = group.targetedAnimations[0].animation.framePerSecond;
const frames = [];
for (let f = 0; f <= Math.round((group.to / rate) * Number(fps)); f++) {
  group.goToFrame((f / Number(fps)) * rate);
  const at = {};
  for (const joint of joints) {
    joint.computeWorldMatrix(true);
    at[joint.name] = joint.getAbsolutePosition().asArray();
  }
  frames.push(at);
}
writeFileSync(target, JSON.stringify({ program: `Babylon.js ${Engine.Version}`, frames }));
process.exit(0);
