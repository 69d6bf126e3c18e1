'use strict';
// The stage: draws capsules, soft shadows and a floor with WebGL2. Knows nothing of dances, time or controls.

// ---- 4 x 4 matrices, column by column, as WebGL takes them ----
function multiply(a, b) {
  const c = new Float32Array(16);
  for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[k * 4 + j] * b[i * 4 + k];
    c[i * 4 + j] = sum;
  }
  return c;
}

function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2);
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0,
    0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0]);
}

// The view from `eye`, turned by yaw about y and pitch about x: no roll, so the axes are known in closed form.
function viewFrom(eye, yaw, pitch) {
  const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch);
  const x = [cy, 0, -sy], y = [-sy * sp, cp, -cy * sp], z = [sy * cp, sp, cy * cp];
  const dot = a => -(a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2]);
  return new Float32Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, dot(x), dot(y), dot(z), 1]);
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
uniform float flatColours, unit;
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
  pixel = vec4(tint * (0.42 + 0.50 * day + 0.24 * sky * day) * near + shine + rim * tint, 1);
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
out vec4 pixel;
void main() {
  float f = max(0.0, 1.0 - dot(from, from));
  pixel = vec4(0, 0, 0, dark * f * f);
}`;

// ---- meshes ----
// A capsule: rings of directions from one pole to the other, the equator twice, once for each end.
function capsuleMesh(around, half) {
  const vertices = [], faces = [];
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

// Floats in one instance of a capsule, and of a shadow.
const CAPSULE = 11, SHADOW = 4;

class Scene {
  constructor(canvas, antialias) {
    this.canvas = canvas;
    this.gl = canvas.getContext('webgl2', { antialias, alpha: true, premultipliedAlpha: true });
    if (!this.gl) throw new Error('this browser has no WebGL 2, which the page draws with');
    this.build();
  }

  // Everything that lives on the graphics card; called again when the card was lost and came back.
  build() {
    const gl = this.gl;
    this.capsules = this.program(CAPSULE_VERTEX, CAPSULE_FRAGMENT, ['view', 'eye', 'flatColours', 'unit']);
    this.floor = this.program(FLOOR_VERTEX, FLOOR_FRAGMENT, ['view', 'centre', 'reach', 'cell', 'floorColour', 'lineColour']);
    this.shadows = this.program(SHADOW_VERTEX, SHADOW_FRAGMENT, ['view']);
    const mesh = capsuleMesh(14, 4);
    this.faces = mesh.faces.length;
    this.capsules.vao = this.arrays(mesh.vertices, 4, [4, 4, 3], this.capsules);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, mesh.faces, gl.STATIC_DRAW);
    this.floor.vao = this.arrays(QUAD, 2, [], this.floor);
    this.shadows.vao = this.arrays(QUAD, 2, [4], this.shadows);
    gl.bindVertexArray(null);
  }

  program(vertex, fragment, uniforms) {
    const gl = this.gl, id = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(id, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.linkProgram(id);
    if (!gl.getProgramParameter(id, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(id));
    const program = { id };
    for (const name of uniforms) program[name] = gl.getUniformLocation(id, name);
    return program;
  }

  // A vertex array: attribute 0 from `mesh`, then one attribute for each size in `parts`, advanced once an instance.
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

  // camera: { view, eye, centre, reach, unit }; things: { capsules, capsuleCount, shadows, shadowCount };
  // colours: { floor, line }. With `flat` only the capsules are drawn, in their plain colours, for counting.
  draw(camera, things, colours, flat) {
    const gl = this.gl;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (!flat && camera.eye[1] > 0) this.drawGround(camera, things, colours);
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.useProgram(this.capsules.id);
    gl.uniformMatrix4fv(this.capsules.view, false, camera.view);
    gl.uniform3fv(this.capsules.eye, camera.eye);
    gl.uniform1f(this.capsules.unit, camera.unit);
    gl.uniform1f(this.capsules.flatColours, flat ? 1 : 0);
    this.fill(this.capsules, things.capsules, things.capsuleCount * CAPSULE);
    gl.drawElementsInstanced(gl.TRIANGLES, this.faces, gl.UNSIGNED_SHORT, 0, things.capsuleCount);
    gl.bindVertexArray(null);
  }

  drawGround(camera, things, colours) {
    const gl = this.gl;
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.floor.id);
    gl.uniformMatrix4fv(this.floor.view, false, camera.view);
    gl.uniform2f(this.floor.centre, camera.centre[0], camera.centre[1]);
    gl.uniform1f(this.floor.reach, camera.reach);
    gl.uniform1f(this.floor.cell, 0.25 * camera.unit);
    gl.uniform3fv(this.floor.floorColour, colours.floor);
    gl.uniform3fv(this.floor.lineColour, colours.line);
    gl.bindVertexArray(this.floor.vao);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.useProgram(this.shadows.id);
    gl.uniformMatrix4fv(this.shadows.view, false, camera.view);
    this.fill(this.shadows, things.shadows, things.shadowCount * SHADOW);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, things.shadowCount);
  }

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
