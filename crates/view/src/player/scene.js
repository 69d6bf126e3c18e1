// Draws capsules, soft shadows, rings and a floor with WebGL2. Knows nothing of dances, time or controls.

// ---- 4 x 4 matrices, column by column, as WebGL takes them; each is written into its last argument ----
/** @param {Float32Array} a @param {Float32Array} b @param {Float32Array} c */
export function multiply(a, b, c) {
  for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[k * 4 + j] * b[i * 4 + k];
    c[i * 4 + j] = sum;
  }
  return c;
}

/** @param {number} fov @param {number} aspect @param {number} near @param {number} far @param {Float32Array} c */
export function perspective(fov, aspect, near, far, c) {
  const f = 1 / Math.tan(fov / 2);
  c.fill(0);
  c[0] = f / aspect; c[5] = f; c[11] = -1;
  c[10] = (far + near) / (near - far); c[14] = 2 * far * near / (near - far);
  return c;
}

// The view from `eye`, turned by yaw about y and pitch about x: no roll, so the axes are known in closed form.
/** @param {Float32Array} eye @param {number} yaw @param {number} pitch @param {Float32Array} c */
export function viewFrom(eye, yaw, pitch, c) {
  const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch);
  c[0] = cy; c[4] = 0; c[8] = -sy;
  c[1] = -sy * sp; c[5] = cp; c[9] = -cy * sp;
  c[2] = sy * cp; c[6] = sp; c[10] = cy * cp;
  for (let i = 0; i < 3; i++) c[12 + i] = -(c[i] * eye[0] + c[4 + i] * eye[1] + c[8 + i] * eye[2]);
  c[3] = c[7] = c[11] = 0;
  c[15] = 1;
  return c;
}

// ---- shaders ----
const CAPSULE_VERTEX = `#version 300 es
layout(location=0) in vec4 mesh;     // direction from the axis, and 0 or 1: which end
layout(location=1) in vec4 endA;     // place and radius
layout(location=2) in vec4 endB;
layout(location=3) in vec3 colour;
uniform mat4 view;
out vec3 normal, place, tint;
void main() {
  vec3 axis = endB.xyz - endA.xyz;
  float size = length(axis);
  vec3 y = size > 1e-9 ? axis / size : vec3(0, 1, 0);
  vec3 x = normalize(cross(y, abs(y.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 0, 1)));
  normal = mat3(x, y, cross(x, y)) * mesh.xyz;
  place = mix(endA.xyz, endB.xyz, mesh.w) + normal * mix(endA.w, endB.w, mesh.w);
  tint = colour;
  gl_Position = view * vec4(place, 1);
}`;
const CAPSULE_FRAGMENT = `#version 300 es
precision highp float;
in vec3 normal, place, tint;
uniform vec3 eye;
uniform float flatColours, unit, opacity;
out vec4 pixel;
void main() {
  if (flatColours > 0.5) { pixel = vec4(tint, 1); return; }
  vec3 n = normalize(normal), v = normalize(eye - place);
  vec3 sun = normalize(vec3(0.45, 0.9, 0.55));
  float day = 0.5 + 0.5 * dot(n, sun);               // wrapped: no hard night side
  float sky = 0.5 + 0.5 * n.y;
  float shine = pow(max(dot(n, normalize(sun + v)), 0.0), 34.0) * 0.16;
  float rim = pow(1.0 - max(dot(n, v), 0.0), 3.0) * 0.20;
  float near = 0.86 + 0.14 * smoothstep(0.0, 0.35 * unit, place.y);  // the floor takes light from what is close to it
  pixel = vec4(tint * (0.42 + 0.50 * day + 0.24 * sky * day) * near + shine + rim * tint, 1) * opacity;
}`;
const FLOOR_VERTEX = `#version 300 es
layout(location=0) in vec2 corner;
uniform mat4 view;
uniform vec2 centre;
uniform float reach;
out vec2 place;
void main() {
  place = centre + corner * reach;
  gl_Position = view * vec4(place.x, 0, place.y, 1);
}`;
const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
in vec2 place;
uniform vec2 centre;
uniform float reach, cell;
uniform vec3 floorColour, lineColour;
out vec4 pixel;
float lines(vec2 p, float width) {
  vec2 w = fwidth(p) + 1e-9;
  vec2 far = abs(fract(p - 0.5) - 0.5) / w;          // pixels from the nearest line
  vec2 there = (1.0 - smoothstep(width - 0.5, width + 0.7, far)) * clamp(0.22 / w, 0.0, 1.0);
  return max(there.x, there.y);
}
void main() {
  float away = length(place - centre) / reach;
  float fade = 1.0 - smoothstep(0.25, 1.0, away);
  float line = max(0.4 * lines(place / cell, 0.5), 0.9 * lines(place / (4.0 * cell), 0.7));
  pixel = vec4(mix(floorColour, lineColour, line), 1) * fade;
}`;
const SHADOW_VERTEX = `#version 300 es
layout(location=0) in vec2 corner;
layout(location=1) in vec4 spot;                     // x, z, radius, darkness
uniform mat4 view;
out vec2 from;
out float dark;
void main() {
  from = corner;
  dark = spot.w;
  gl_Position = view * vec4(spot.x + corner.x * spot.z, 0, spot.y + corner.y * spot.z, 1);
}`;
const SHADOW_FRAGMENT = `#version 300 es
precision highp float;
in vec2 from;
in float dark;
uniform vec3 ringColour;
uniform float ring;
out vec4 pixel;
void main() {
  float r = length(from), f = max(0.0, 1.0 - r * r), w = fwidth(r);
  float band = (1.0 - smoothstep(1.0 - w, 1.0, r)) * smoothstep(0.66 - w, 0.66, r) + 0.22 * (1.0 - smoothstep(0.6, 0.7, r));
  pixel = mix(vec4(0, 0, 0, dark * f * f), vec4(ringColour, 1) * dark * band, ring);
}`;

// ---- meshes ----
// A capsule: rings of directions from one pole to the other, the equator twice, once for each end.
/** @param {number} around @param {number} half */
function capsuleMesh(around, half) {
  /** @type {number[]} */
  const vertices = [];
  /** @type {number[]} */
  const faces = [];
  /** @param {number} angle @param {number} end */
  const ring = (angle, end) => {
    for (let i = 0; i < around; i++) {
      const a = 2 * Math.PI * i / around;
      vertices.push(Math.cos(angle) * Math.cos(a), Math.sin(angle), Math.cos(angle) * Math.sin(a), end);
    }
  };
  for (let i = 0; i <= half; i++) ring(-Math.PI / 2 * (1 - i / half), 0);
  for (let i = 0; i <= half; i++) ring(Math.PI / 2 * (i / half), 1);
  for (let r = 0; r < 2 * half + 1; r++) for (let i = 0; i < around; i++) {
    const a = r * around + i, b = r * around + (i + 1) % around;
    faces.push(a, a + around, b, b, a + around, b + around);
  }
  return { vertices: new Float32Array(vertices), faces: new Uint16Array(faces) };
}

const QUAD = new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]);

// How much of what is behind a ghost it covers.
const GHOST = 0.34;

// Floats in one instance of a capsule, and of a shadow or ring.
export const CAPSULE = 11, SHADOW = 4;

/**
 * What stands in a picture. A ghost is a capsule that one can see through.
 * @typedef {{ capsules: Float32Array, capsuleCount: number, ghosts: Float32Array, ghostCount: number,
 *   shadows: Float32Array, shadowCount: number, rings: Float32Array, ringCount: number,
 *   paths: Float32Array, pathCount: number }} Things
 * @typedef {number[]} Colour red, green, blue: 0 to 1
 * @typedef {{ view: Float32Array, eye: Float32Array, centre: number[], distance: number, reach: number, unit: number }} View
 * @typedef {{ id: WebGLProgram, vao: WebGLVertexArrayObject | null, instances: WebGLBuffer | null,
 *   at: Record<string, WebGLUniformLocation | null> }} Program
 */
export class Scene {
  /** @type {Record<'capsules' | 'threads' | 'floor' | 'shadows', Program>} */
  programs = /** @type {any} */ ({});

  /** @param {HTMLCanvasElement} canvas @param {boolean} antialias */
  constructor(canvas, antialias) {
    this.canvas = canvas;
    const gl = canvas.getContext('webgl2', { antialias, alpha: true, premultipliedAlpha: true });
    if (!gl) throw new Error('this browser has no WebGL 2, which the page draws with');
    this.gl = gl;
    /** @type {Colour | null} behind everything; null: what is behind the canvas shows through */
    this.backdrop = null;
    this.faces = this.threadFaces = 0;
    /** @type {((camera: View) => void) | null} draws other bodies, after the capsules and before what one can see through */
    this.more = null;
    this.build();
  }

  // Everything that lives on the graphics card; called again when the card was lost and came back.
  build() {
    const gl = this.gl;
    const capsules = this.program(CAPSULE_VERTEX, CAPSULE_FRAGMENT, ['view', 'eye', 'flatColours', 'unit', 'opacity']);
    const floor = this.program(FLOOR_VERTEX, FLOOR_FRAGMENT, ['view', 'centre', 'reach', 'cell', 'floorColour', 'lineColour']);
    const shadows = this.program(SHADOW_VERTEX, SHADOW_FRAGMENT, ['view', 'ring', 'ringColour']);
    const mesh = capsuleMesh(14, 4);
    this.faces = mesh.faces.length;
    capsules.vao = this.arrays(mesh.vertices, 4, [4, 4, 3], capsules);
    this.indices(mesh.faces);
    // thin capsules of few faces, of which there may be thousands
    const thread = capsuleMesh(6, 1), threads = { ...capsules };
    this.threadFaces = thread.faces.length;
    threads.vao = this.arrays(thread.vertices, 4, [4, 4, 3], threads);
    this.indices(thread.faces);
    floor.vao = this.arrays(QUAD, 2, [], floor);
    shadows.vao = this.arrays(QUAD, 2, [4], shadows);
    gl.bindVertexArray(null);
    this.programs = { capsules, threads, floor, shadows };
  }

  /** @param {Uint16Array} faces */
  indices(faces) {
    const gl = this.gl;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  }

  /** @param {string} vertex @param {string} fragment @param {string[]} uniforms @returns {Program} */
  program(vertex, fragment, uniforms) {
    const gl = this.gl, id = gl.createProgram();
    /** @param {number} kind @param {string} text */
    const compile = (kind, text) => {
      const shader = gl.createShader(kind);
      if (!shader) return;                           // the card is lost; it comes back
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(id, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader) ?? '');
    };
    compile(gl.VERTEX_SHADER, vertex);
    compile(gl.FRAGMENT_SHADER, fragment);
    gl.linkProgram(id);
    if (!gl.getProgramParameter(id, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(id) ?? '');
    const at = Object.fromEntries(uniforms.map(name => [name, gl.getUniformLocation(id, name)]));
    return { id, at, vao: null, instances: null };
  }

  // A vertex array: attribute 0 from `mesh`, then one attribute for each size in `parts`, advanced once an instance.
  /** @param {Float32Array} mesh @param {number} size @param {number[]} parts @param {Program} program */
  arrays(mesh, size, parts, program) {
    const gl = this.gl, vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, mesh, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, size, gl.FLOAT, false, 0, 0);
    program.instances = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, program.instances);
    const stride = 4 * parts.reduce((a, b) => a + b, 0);
    let offset = 0;
    parts.forEach((part, i) => {
      gl.enableVertexAttribArray(i + 1);
      gl.vertexAttribPointer(i + 1, part, gl.FLOAT, false, stride, offset);
      gl.vertexAttribDivisor(i + 1, 1);
      offset += 4 * part;
    });
    return vao;
  }

  resize() {
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(this.canvas.clientWidth * scale));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * scale));
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
  }

  // With `flat` only the capsules are drawn, in their plain colours, for counting.
  /** @param {View} camera @param {Things} things @param {Record<string, any>} colours @param {boolean} flat */
  draw(camera, things, colours, flat) {
    const { gl, backdrop } = this;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    if (backdrop) gl.clearColor(backdrop[0], backdrop[1], backdrop[2], 1);
    else gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!flat && camera.eye[1] > 0) this.drawGround(camera, things, colours);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    const at = this.programs.capsules.at;
    gl.useProgram(this.programs.capsules.id);
    gl.uniformMatrix4fv(at.view, false, camera.view);
    gl.uniform3fv(at.eye, camera.eye);
    gl.uniform1f(at.unit, camera.unit);
    gl.uniform1f(at.flatColours, flat ? 1 : 0);
    gl.uniform1f(at.opacity, 1);
    this.drawCapsules(things.capsules, things.capsuleCount);
    if (things.pathCount && !flat) {
      this.fill(this.programs.threads, things.paths, things.pathCount * CAPSULE);
      gl.drawElementsInstanced(gl.TRIANGLES, this.threadFaces, gl.UNSIGNED_SHORT, 0, things.pathCount);
    }
    if (this.more && !flat) this.more(camera);
    if (things.ghostCount && !flat) {
      gl.useProgram(this.programs.capsules.id);
      this.drawGhosts(things);
    }
    gl.bindVertexArray(null);
  }

  /** @param {Float32Array} numbers @param {number} count */
  drawCapsules(numbers, count) {
    this.fill(this.programs.capsules, numbers, count * CAPSULE);
    this.gl.drawElementsInstanced(this.gl.TRIANGLES, this.faces, this.gl.UNSIGNED_SHORT, 0, count);
  }

  // First their depths alone, then their nearest surfaces: limbs of one ghost don't show through each other.
  /** @param {Things} things */
  drawGhosts(things) {
    const gl = this.gl;
    gl.colorMask(false, false, false, false);
    this.drawCapsules(things.ghosts, things.ghostCount);
    gl.colorMask(true, true, true, true);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.uniform1f(this.programs.capsules.at.opacity, GHOST);
    this.drawCapsules(things.ghosts, things.ghostCount);
    gl.depthFunc(gl.LESS);
    gl.disable(gl.BLEND);
  }

  /** @param {View} camera @param {Things} things @param {Record<string, any>} colours */
  drawGround(camera, things, colours) {
    const gl = this.gl;
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.programs.floor.id);
    gl.uniformMatrix4fv(this.programs.floor.at.view, false, camera.view);
    gl.uniform2f(this.programs.floor.at.centre, camera.centre[0], camera.centre[1]);
    gl.uniform1f(this.programs.floor.at.reach, camera.reach);
    gl.uniform1f(this.programs.floor.at.cell, 0.25 * camera.unit);
    gl.uniform3fv(this.programs.floor.at.floorColour, colours.floor);
    gl.uniform3fv(this.programs.floor.at.lineColour, colours.line);
    gl.bindVertexArray(this.programs.floor.vao);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.useProgram(this.programs.shadows.id);
    gl.uniformMatrix4fv(this.programs.shadows.at.view, false, camera.view);
    this.fill(this.programs.shadows, things.shadows, things.shadowCount * SHADOW);
    gl.uniform1f(this.programs.shadows.at.ring, 0);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, things.shadowCount);
    if (!things.ringCount) return;
    this.fill(this.programs.shadows, things.rings, things.ringCount * SHADOW);
    gl.uniform1f(this.programs.shadows.at.ring, 1);
    gl.uniform3fv(this.programs.shadows.at.ringColour, colours.ring);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, things.ringCount);
  }

  /** @param {Program} program @param {Float32Array} numbers @param {number} count */
  fill(program, numbers, count) {
    const gl = this.gl;
    gl.bindVertexArray(program.vao);
    gl.bindBuffer(gl.ARRAY_BUFFER, program.instances);
    gl.bufferData(gl.ARRAY_BUFFER, numbers.subarray(0, count), gl.DYNAMIC_DRAW);
  }

  // The picture just drawn, four bytes a pixel.
  pixels() {
    const gl = this.gl, { width, height } = this.canvas;
    const bytes = new Uint8Array(width * height * 4);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return bytes;
  }
}
