#!/usr/bin/env bash
# three.js 0.187.0 (npm), BVHLoader: position channels of a BVH are ADDED to the joint's OFFSET, for every joint. Blender's
# importer subtracts the OFFSET first, so that channels REPLACE it. A file whose joints all have position channels that
# repeat their OFFSETs (the Bandai-Namco data set) has bones of twice their length in three.js, and a root with an OFFSET
# stands twice as high.
#
# Seen: a root with OFFSET 0 5 0 and channels 0 5 0 is placed at y = 10, a joint with OFFSET 0 10 0 and channels 0 10 0 at
# y = 20. Needs node and npm; prints what it saw and fails if that changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init -y >npm.log
npm install --silent --no-audit --no-fund three@0.187.0 >>npm.log
cat >look.mjs <<'JS'
import { BVHLoader } from "three/examples/jsm/loaders/BVHLoader.js";

const channels = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation";
const text = `HIERARCHY
ROOT hips
{
  OFFSET 0 5 0
  ${channels}
  JOINT spine
  {
    OFFSET 0 10 0
    ${channels}
    End Site
    {
      OFFSET 0 3 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.05
0 5 0 0 0 0 0 10 0 0 0 0
0 5 0 0 0 0 0 10 0 0 0 0
`;
const { clip } = new BVHLoader().parse(text);
const height = (name) => clip.tracks.find((track) => track.name === `${name}.position`).values[1];
console.log(`hips at y = ${height("hips")}, spine at y = ${height("spine")} above them`);
process.exit(height("hips") === 10 && height("spine") === 20 ? 0 : 1);
JS
node look.mjs
