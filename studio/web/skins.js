// Draws characters with their meshes: their vertices go with the joints of their skins.

/** @typedef {import('./character.js').Character} Character @typedef {import('./scene.js').View} View */
/** @typedef {import('./glb.js').Part} Part @typedef {import('./glb.js').Material} Material */

const VERTEX = `#version 300 es
layout(location=0) in vec3 position;
layout(location=1) in vec3 facing;
layout(location=2) in vec2 at;
layout(location=3) in uvec4 bones;
layout(location=4) in vec4 weights;
uniform mat4 view;
uniform vec2 shift;                  // over the floor
uniform highp sampler2D joints;      // a row a joint: the columns of its matrix
out vec3 normal, place;
out vec2 where;
mat4 joint(uint j) {
  int row = int(j);
  return mat4(texelFetch(joints, ivec2(0, row), 0), texelFetch(joints, ivec2(1, row), 0),
    texelFetch(joints, ivec2(2, row), 0), texelFetch(joints, ivec2(3, row), 0));
}
void main() {
  mat4 moved = weights.x * joint(bones.x) + weights.y * joint(bones.y) + weights.z * joint(bones.z) + weights.w * joint(bones.w);
  vec4 here = moved * vec4(position, 1);
  place = here.xyz / max(here.w, 1e-6) + vec3(shift.x, 0, shift.y);
  normal = mat3(moved) * facing;
  where = at;
  gl_Position = view * vec4(place, 1);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 normal, place;
in vec2 where;
uniform vec3 eye;
uniform vec4 colour;
uniform float cut;
uniform sampler2D image;
out vec4 pixel;
void main() {
  vec4 tint = colour * texture(image, where);
  if (tint.a < cut) discard;
  vec3 v = normalize(eye - place), n = normalize(normal);
  if (dot(n, v) < 0.0) n = -n;                         // cloth is seen from both sides
  vec3 sun = normalize(vec3(0.45, 0.9, 0.55));
  float day = 0.5 + 0.5 * dot(n, sun), sky = 0.5 + 0.5 * n.y;
  float rim = pow(1.0 - max(dot(n, v), 0.0), 3.0) * 0.12;
  pixel = vec4(tint.rgb * (0.38 + 0.48 * day + 0.22 * sky) + rim * tint.rgb, 1) * tint.a;
}`;

/**
 * A part on the graphics card.
 * @typedef {{ part: Part, vao: WebGLVertexArrayObject | null, image: WebGLTexture | null }} Loaded
 */

export class Skins {
  /** @type {import('./scene.js').Program} */
  program = /** @type {any} */ (null);
  /** @type {WebGLTexture | null} */
  joints = null;
  /** @type {WebGLTexture | null} */
  white = null;
  /** @type {Map<Character, Loaded[]>} */
  loaded = new Map();

  /** @param {import('./scene.js').Scene} scene @param {() => void} changed a picture came, so that all is drawn again */
  constructor(scene, changed) {
    this.scene = scene;
    this.changed = changed;
    this.build();
  }

  // All that is on the card; called again when that was lost and came back.
  build() {
    const { gl } = this.scene;
    this.program = this.scene.program(VERTEX, FRAGMENT, ['view', 'shift', 'joints', 'eye', 'colour', 'cut', 'image']);
    this.joints = gl.createTexture();
    this.white = this.texture();
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
    this.loaded = new Map();
  }

  texture() {
    const { gl } = this.scene,
      texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    return texture;
  }

  /** @param {Character} character @returns {Loaded[]} */
  load(character) {
    const known = this.loaded.get(character);
    if (known) return known;
    const parts = character.glb.parts.map(part => ({ part, vao: this.arrays(part), image: this.white }));
    this.loaded.set(character, parts);
    for (const one of parts) this.image(one);
    return parts;
  }

  // Frees what characters have on the card that aren't among these.
  /** @param {Set<Character | null>} stay */
  keep(stay) {
    const { gl } = this.scene;
    for (const [character, parts] of this.loaded) {
      if (stay.has(character)) continue;
      for (const { vao, image } of parts) {
        gl.deleteVertexArray(vao);
        if (image !== this.white) gl.deleteTexture(image);
      }
      this.loaded.delete(character);
    }
  }

  /** @param {Part} part */
  arrays({ positions, normals, at, bones, weights, faces }) {
    const { gl } = this.scene,
      vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    const put = (/** @type {number} */ n, /** @type {number} */ width, /** @type {Float32Array | Uint16Array} */ numbers) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(n);
      if (numbers instanceof Uint16Array) gl.vertexAttribIPointer(n, width, gl.UNSIGNED_SHORT, 0, 0);
      else gl.vertexAttribPointer(n, width, gl.FLOAT, false, 0, 0);
    };
    const count = positions.length / 3;
    put(0, 3, positions);
    put(1, 3, normals);
    put(2, 2, at ?? new Float32Array(2 * count));
    // what has no skin goes with one node
    put(3, 4, bones ?? new Uint16Array(4 * count));
    put(4, 4, weights ?? Float32Array.from({ length: 4 * count }, (_, i) => Number(i % 4 === 0)));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return vao;
  }

  /** @param {Loaded} one */
  async image(one) {
    const { image } = one.part.material;
    if (!image) return;
    // a format that this browser doesn't know leaves the part in its plain colour
    const picture = await createImageBitmap(image).catch(() => null);
    if (!picture) return;
    const { gl } = this.scene;
    one.image = this.texture();
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    picture.close();
    this.changed();
  }

  // A character as it is at a time, seconds.
  /** @param {View} camera @param {Character} character @param {number} time @param {number[]} shift over the floor */
  draw(camera, character, time, shift) {
    const { gl } = this.scene,
      { id, at } = this.program;
    gl.useProgram(id);
    gl.uniformMatrix4fv(at.view, false, camera.view);
    gl.uniform3fv(at.eye, camera.eye);
    gl.uniform1i(at.joints, 0);
    gl.uniform1i(at.image, 1);
    character.pose(time);
    gl.uniform2fv(at.shift, shift);
    // what one can see through comes last, over the rest
    const parts = this.load(character);
    for (const isLast of [false, true])
      for (const one of parts) if (one.part.material.blend === isLast) this.part(one, character.matrices(one.part));
    gl.activeTexture(gl.TEXTURE0);
    gl.bindVertexArray(null);
    gl.disable(gl.BLEND);
  }

  /** @param {Loaded} one @param {Float32Array} matrices */
  part({ part, vao, image }, matrices) {
    const { gl } = this.scene,
      { at } = this.program,
      { material, faces } = part;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.joints);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 4, matrices.length / 16, 0, gl.RGBA, gl.FLOAT, matrices);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, image);
    gl.uniform4fv(at.colour, material.colour);
    gl.uniform1f(at.cut, material.cut);
    if (material.blend) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    } else gl.disable(gl.BLEND);
    gl.bindVertexArray(vao);
    gl.drawElements(gl.TRIANGLES, faces.length, gl.UNSIGNED_INT, 0);
  }
}
