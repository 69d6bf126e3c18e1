// The mesh of a character's GLB, its nodes, and one of its animations, as plain arrays. Source: glTF 2.0 (2021), sections 3.6,
// 3.7, 3.11, 4.4.

/**
 * @typedef {{ place: number[], turn: number[], scale: number[], parent: number }} GlbNode
 * @typedef {{ joints: number[], inverse: Float32Array }} Skin joints as nodes, and the inverse of each in the bind pose
 * @typedef {{ node: number, skin: Skin | null, positions: Float32Array, normals: Float32Array, at: Float32Array | null,
 *   bones: Uint16Array | null, weights: Float32Array | null, faces: Uint32Array, material: Material }} Part
 * @typedef {{ colour: number[], image: Blob | null, cut: number, blend: boolean }} Material
 *   `cut`: what is less opaque isn't there
 * @typedef {{ node: number, path: 'translation' | 'rotation' | 'scale', times: Float32Array, values: Float32Array,
 *   between: string }} Track
 * @typedef {{ nodes: GlbNode[], parts: Part[], tracks: Track[] }} Glb
 */

const WIDTHS = /** @type {Record<string, number>} */ ({ SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT4: 16 });
const KINDS = /** @type {Record<number, [new (b: ArrayBuffer, o: number, n: number) => any, number, number]>} */ ({
  5120: [Int8Array, 1, 127],
  5121: [Uint8Array, 1, 255],
  5122: [Int16Array, 2, 32767],
  5123: [Uint16Array, 2, 65535],
  5125: [Uint32Array, 4, 1],
  5126: [Float32Array, 4, 1],
});
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

/** @param {ArrayBuffer} file @param {string} animation the name of the one that is wanted @returns {Glb} */
export function parse(file, animation) {
  const { json, binary } = chunks(file);
  const read = new Reader(json, file, binary);
  const nodes = /** @type {GlbNode[]} */ ((json.nodes ?? []).map(nodeOf));
  (json.nodes ?? []).forEach((/** @type {any} */ node, /** @type {number} */ i) => {
    for (const child of node.children ?? []) nodes[child].parent = i;
  });
  const shown = inScene(json);
  const parts = (json.nodes ?? []).flatMap((/** @type {any} */ node, /** @type {number} */ i) =>
    node.mesh === undefined || !shown.has(i) ? [] : partsOf(json, read, node, i),
  );
  if (!parts.length) throw new Error('no mesh of triangles');
  return { nodes, parts, tracks: tracksOf(json, read, animation) };
}

/** @param {ArrayBuffer} file */
function chunks(file) {
  const view = new DataView(file);
  let json = null,
    binary = 0;
  for (let at = 12; at + 8 <= file.byteLength; ) {
    const length = view.getUint32(at, true),
      kind = view.getUint32(at + 4, true);
    if (kind === 0x4e4f534a) json = JSON.parse(new TextDecoder().decode(new Uint8Array(file, at + 8, length)));
    else if (kind === 0x004e4942 && !binary) binary = at + 8;
    at += 8 + length;
  }
  return { json: json ?? {}, binary };
}

/** @param {any} node @returns {GlbNode} */
function nodeOf(node) {
  if (!node.matrix) {
    const { translation: place = [0, 0, 0], rotation: turn = [0, 0, 0, 1], scale = [1, 1, 1] } = node;
    return { place, turn, scale, parent: -1 };
  }
  const m = node.matrix,
    column = (/** @type {number} */ i) => [m[4 * i], m[4 * i + 1], m[4 * i + 2]],
    scale = [0, 1, 2].map(i => Math.hypot(...column(i)));
  const [x, y, z] = [0, 1, 2].map(column);
  const volume =
    x[0] * (y[1] * z[2] - y[2] * z[1]) - y[0] * (x[1] * z[2] - x[2] * z[1]) + z[0] * (x[1] * y[2] - x[2] * y[1]);
  if (volume < 0) scale[0] = -scale[0];
  const r = [x, y, z].map((c, i) => c.map(v => v / (scale[i] || 1)));
  return { place: [m[12], m[13], m[14]], turn: turnOf(r), scale, parent: -1 };
}

// A rotation's quaternion, of its columns: by the largest of its numbers, so that nothing is lost to rounding.
/** @param {number[][]} r */
function turnOf([x, y, z]) {
  const all = [x[0] - y[1] - z[2], y[1] - x[0] - z[2], z[2] - x[0] - y[1], x[0] + y[1] + z[2]];
  const most = all.indexOf(Math.max(...all)),
    big = Math.sqrt(1 + all[most]) / 2,
    f = 0.25 / big;
  const [xy, xz, yz] = [x[1] + y[0], x[2] + z[0], y[2] + z[1]];
  const [wx, wy, wz] = [y[2] - z[1], z[0] - x[2], x[1] - y[0]];
  const rows = [
    [big, xy * f, xz * f, wx * f],
    [xy * f, big, yz * f, wy * f],
    [xz * f, yz * f, big, wz * f],
    [wx * f, wy * f, wz * f, big],
  ];
  return rows[most];
}

// The nodes of the scene that a viewer shows first.
/** @param {any} json @returns {Set<number>} */
function inScene(json) {
  const roots = json.scenes?.[json.scene ?? 0]?.nodes;
  if (!roots) return new Set((json.nodes ?? []).keys());
  const found = new Set(),
    left = [...roots];
  for (let node = left.pop(); node !== undefined; node = left.pop()) {
    if (found.has(node)) continue;
    found.add(node);
    left.push(...(json.nodes[node].children ?? []));
  }
  return found;
}

class Reader {
  /** @param {any} json @param {ArrayBuffer} file @param {number} binary where the buffer begins in it */
  constructor(json, file, binary) {
    this.json = json;
    this.file = file;
    this.binary = binary;
  }

  /** @param {number} n of a view */
  view(n) {
    const view = this.json.bufferViews[n];
    if (view.buffer !== 0 || view.extensions) throw new Error('a mesh that is packed');
    return { at: this.binary + (view.byteOffset ?? 0), length: view.byteLength, stride: view.byteStride ?? 0 };
  }

  // The numbers of an accessor, as they are, or from 0 or -1 to 1 where whole numbers stand for these.
  /** @param {number} n @returns {{ numbers: Float64Array, width: number }} */
  numbers(n) {
    const { bufferView, byteOffset = 0, componentType, count, type, normalized, sparse } = this.json.accessors[n];
    if (sparse || bufferView === undefined) throw new Error('a mesh with sparse numbers');
    const width = WIDTHS[type],
      [Kind, size, most] = KINDS[componentType],
      { at, stride } = this.view(bufferView),
      step = stride || width * size;
    const numbers = new Float64Array(count * width);
    // a copy: an array of its own may not begin just anywhere
    const bytes = this.file.slice(at + byteOffset, at + byteOffset + step * (count - 1) + width * size);
    if (step % size) throw new Error('a mesh of odd steps');
    const from = new Kind(bytes, 0, Math.floor(bytes.byteLength / size)),
      by = normalized ? 1 / most : 1;
    for (let i = 0; i < count; i++)
      for (let k = 0; k < width; k++) numbers[i * width + k] = from[(i * step) / size + k] * by;
    return { numbers, width };
  }

  /** @param {number} n */
  floats(n) {
    return Float32Array.from(this.numbers(n).numbers);
  }
}

/** @param {any} json @param {Reader} read @param {any} node @param {number} n @returns {Part[]} */
function partsOf(json, read, node, n) {
  const mesh = json.meshes[node.mesh],
    of = node.skin === undefined ? null : json.skins[node.skin];
  const identities = () => Float32Array.from(of.joints.flatMap(() => IDENTITY));
  const skin = of && {
    joints: of.joints,
    inverse: of.inverseBindMatrices === undefined ? identities() : read.floats(of.inverseBindMatrices),
  };
  const weights = node.weights ?? mesh.weights ?? [];
  return mesh.primitives
    .filter((/** @type {any} */ one) => (one.mode ?? 4) === 4)
    .map((/** @type {any} */ one) => {
      if (one.extensions?.KHR_draco_mesh_compression) throw new Error('a mesh in Draco');
      const { POSITION, NORMAL, TEXCOORD_0, JOINTS_0, WEIGHTS_0 } = one.attributes;
      const positions = read.floats(POSITION);
      // as the file has them set
      (one.targets ?? []).forEach((/** @type {any} */ target, /** @type {number} */ i) => {
        if (!weights[i] || target.POSITION === undefined) return;
        read.floats(target.POSITION).forEach((x, k) => (positions[k] += weights[i] * x));
      });
      const faces =
        one.indices === undefined
          ? Uint32Array.from({ length: positions.length / 3 }, (_, i) => i)
          : Uint32Array.from(read.numbers(one.indices).numbers);
      const isSkinned = skin && JOINTS_0 !== undefined && WEIGHTS_0 !== undefined;
      return {
        node: n,
        skin: isSkinned ? skin : null,
        positions,
        normals: NORMAL === undefined ? normalsOf(positions, faces) : read.floats(NORMAL),
        at: TEXCOORD_0 === undefined ? null : read.floats(TEXCOORD_0),
        bones: isSkinned ? Uint16Array.from(read.numbers(JOINTS_0).numbers) : null,
        weights: isSkinned ? read.floats(WEIGHTS_0) : null,
        faces,
        material: materialOf(json, read, json.materials?.[one.material]),
      };
    });
}

/** @param {Float32Array} positions @param {Uint32Array} faces */
function normalsOf(positions, faces) {
  const normals = new Float32Array(positions.length);
  for (let f = 0; f < faces.length; f += 3) {
    const [a, b, c] = [faces[f], faces[f + 1], faces[f + 2]].map(i => 3 * i);
    const u = [0, 1, 2].map(k => positions[b + k] - positions[a + k]),
      v = [0, 1, 2].map(k => positions[c + k] - positions[a + k]);
    for (let k = 0; k < 3; k++) {
      // as long as the face is large, which weighs it
      const x = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
      for (const i of [a, b, c]) normals[i + k] += x;
    }
  }
  return normals;
}

/** @param {any} json @param {Reader} read @param {any} of @returns {Material} */
function materialOf(json, read, of) {
  const { baseColorFactor: colour = [1, 1, 1, 1], baseColorTexture } = of?.pbrMetallicRoughness ?? {};
  const texture = json.textures?.[baseColorTexture?.index],
    source = texture?.source ?? texture?.extensions?.EXT_texture_webp?.source,
    image = json.images?.[source];
  let blob = null;
  // pictures in a format that no browser has, or in other files, are left out
  if (image?.bufferView !== undefined && (baseColorTexture.texCoord ?? 0) === 0) {
    const { at, length } = read.view(image.bufferView);
    blob = new Blob([read.file.slice(at, at + length)], { type: image.mimeType });
  }
  const cut = of?.alphaMode === 'MASK' ? (of.alphaCutoff ?? 0.5) : 0;
  return { colour, image: blob, cut, blend: of?.alphaMode === 'BLEND' };
}

/** @param {any} json @param {Reader} read @param {string} name @returns {Track[]} */
function tracksOf(json, read, name) {
  const animation = (json.animations ?? []).find((/** @type {any} */ one) => one.name === name);
  return (animation?.channels ?? []).map((/** @type {any} */ { sampler, target }) => {
    const { input, output, interpolation: between = 'LINEAR' } = animation.samplers[sampler];
    return { node: target.node, path: target.path, times: read.floats(input), values: read.floats(output), between };
  });
}
