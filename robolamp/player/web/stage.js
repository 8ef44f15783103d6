// The lamp in 3D: WebGL 2, triangles with one light, shadows thrown flat on the desk. Lengths in metres, z up.

const unpack = (text, kind) => new kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

const times = (a, b) => {  // product of two 4 x 4 matrices, by columns
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[k * 4 + r] * b[c * 4 + k];
    out[c * 4 + r] = sum;
  }
  return out;
};

const ofPose = (p, x = 0) => {  // position and quaternion (w, x, y, z) as a matrix
  const [px, py, pz, w, i, j, k] = p;
  return new Float32Array([
    1 - 2 * (j * j + k * k), 2 * (i * j + w * k), 2 * (i * k - w * j), 0,
    2 * (i * j - w * k), 1 - 2 * (i * i + k * k), 2 * (j * k + w * i), 0,
    2 * (i * k + w * j), 2 * (j * k - w * i), 1 - 2 * (i * i + j * j), 0,
    px + x, py, pz, 1,
  ]);
};

const VERTEX = `#version 300 es
layout(location = 0) in vec3 point;
layout(location = 1) in vec3 normal;
uniform mat4 view, pose;
uniform vec3 light;
uniform float flat_;
out vec3 at, up;
void main() {
  vec4 world = pose * vec4(point, 1.0);
  if (flat_ > 0.5) world.xyz = vec3(world.xy - light.xy * (world.z / light.z), 0.0004);
  at = world.xyz;
  up = mat3(pose) * normal;
  gl_Position = view * world;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec3 at, up;
uniform vec3 color, light, eye, sky_;
uniform float emission, shine, alpha, flat_, floor_, day_;
uniform vec2 middle;
out vec4 pixel;
float lines(float x, float step, float width) {
  float d = abs(fract(x / step - 0.5) - 0.5) * step;
  float soft = fwidth(x);
  return (1.0 - smoothstep(width, width + soft, d)) * clamp(step / (soft * 8.0), 0.0, 1.0);
}
void main() {
  if (flat_ > 0.5) { pixel = vec4(0.0, 0.0, 0.0, alpha); return; }
  vec3 toward = normalize(eye - at);
  if (floor_ > 0.5) {
    float far = smoothstep(0.5, 1.5, distance(at.xy, middle));
    float fine = max(lines(at.x, 0.05, 0.0004), lines(at.y, 0.05, 0.0004));
    float coarse = max(lines(at.x, 0.5, 0.0012), lines(at.y, 0.5, 0.0012));
    vec3 desk = vec3(0.80, 0.765, 0.71);
    desk = mix(desk, vec3(0.66, 0.62, 0.56), max(0.45 * fine, 0.9 * coarse));
    pixel = vec4(mix(desk * day_, sky_, far), 1.0);
    return;
  }
  vec3 n = normalize(up);
  if (dot(n, toward) < 0.0) n = -n;
  float day = max(dot(n, light), 0.0), sky = 0.5 + 0.5 * n.z;
  float spot = pow(max(dot(reflect(-light, n), toward), 0.0), 28.0) * shine * 0.45;
  vec3 lit = color * (0.34 + 0.26 * sky + 0.52 * day) + spot;
  pixel = vec4(mix(lit, color, emission), 1.0) * vec4(1.0, 1.0, 1.0, alpha);
}`;

class Stage {
  constructor(canvas, data, names) {
    this.canvas = canvas;
    this.data = data;
    this.look = { turn: -1.2, rise: 0.16, far: 0.85 };
    this.follow = true;
    this.night = matchMedia("(prefers-color-scheme: dark)");
    this.target = [0, 0, 0.12];
    this.light = [0.32, -0.5, 0.8];
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true, preserveDrawingBuffer: true });
    this.gl = gl;
    if (!gl) return;
    const shader = (kind, text) => {
      const made = gl.createShader(kind);
      gl.shaderSource(made, text);
      gl.compileShader(made);
      if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
      return made;
    };
    const program = gl.createProgram();
    gl.attachShader(program, shader(gl.VERTEX_SHADER, VERTEX));
    gl.attachShader(program, shader(gl.FRAGMENT_SHADER, FRAGMENT));
    gl.linkProgram(program);
    gl.useProgram(program);
    this.places = {};
    for (const name of ["view", "pose", "light", "eye", "color", "emission", "shine", "alpha", "flat_", "floor_", "middle", "sky_", "day_"]) {
      this.places[name] = gl.getUniformLocation(program, name);
    }
    const buffers = (vertices, indices) => {
      const made = gl.createVertexArray();
      gl.bindVertexArray(made);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
      for (const place of [0, 1]) {
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, place * 12);
      }
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
      return made;
    };
    this.lamp = buffers(unpack(data.vertices, Float32Array), unpack(data.indices, Uint32Array));
    const s = 6;
    this.desk = buffers(
      new Float32Array([-s, -s, 0, 0, 0, 1, s, -s, 0, 0, 0, 1, s, s, 0, 0, 0, 1, -s, s, 0, 0, 0, 1]),
      new Uint32Array([0, 1, 2, 0, 2, 3]),
    );
    this.line = buffers(
      new Float32Array([-0.002, -0.09, 0.0006, 0, 0, 1, 0.002, -0.09, 0.0006, 0, 0, 1, 0.002, 0.09, 0.0006, 0, 0, 1, -0.002, 0.09, 0.0006, 0, 0, 1]),
      new Uint32Array([0, 1, 2, 0, 2, 3]),
    );
  }

  eye() {
    const { turn, rise, far } = this.look, [x, y, z] = this.target;
    return [
      x + far * Math.cos(rise) * Math.cos(turn), y + far * Math.cos(rise) * Math.sin(turn), z + far * Math.sin(rise),
    ];
  }

  matrix() {
    const eye = this.eye(), [tx, ty, tz] = this.target;
    const norm = (v) => { const l = Math.hypot(...v); return v.map((c) => c / l); };
    const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const back = norm([eye[0] - tx, eye[1] - ty, eye[2] - tz]);
    const right = norm(cross([0, 0, 1], back)), up = cross(back, right);
    const view = new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
    ]);
    const near = 0.02, far = 12, zoom = 1 / Math.tan(0.3), wide = this.canvas.width / this.canvas.height;
    const fit = zoom * Math.min(1, wide / 0.9);  // a narrow window sees as much from side to side
    return times(new Float32Array([
      fit / wide, 0, 0, 0, 0, fit, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, 2 * far * near / (near - far), 0,
    ]), view);
  }

  onScreen(point) {  // CSS pixels, or null where it is behind the eye
    const m = this.matrix(), [x, y, z] = point;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w <= 0) return null;
    return [
      (0.5 + 0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12]) / w) * this.canvas.clientWidth,
      (0.5 - 0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) * this.canvas.clientHeight,
    ];
  }

  // motions: [{poses of this moment (one array of 7 a body), ghost}], the first being the one to follow
  draw(motions) {
    const gl = this.gl, ratio = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    if (this.follow) this.target[0] = motions[0].poses[this.data.base][0] + 0.02;
    if (!gl) return;
    const set = this.places;
    gl.viewport(0, 0, width, height);
    const sky = this.night.matches ? [0.15, 0.16, 0.18] : [0.875, 0.89, 0.91];
    gl.clearColor(...sky, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.uniformMatrix4fv(set.view, false, this.matrix());
    gl.uniform3fv(set.sky_, sky);
    gl.uniform1f(set.day_, this.night.matches ? 0.45 : 1);
    gl.uniform3fv(set.light, this.light);
    gl.uniform3fv(set.eye, this.eye());
    const still = [0, 0, 0, 1, 0, 0, 0];
    const plain = (array, x, color, floor) => {
      gl.bindVertexArray(array);
      gl.uniformMatrix4fv(set.pose, false, ofPose(still, x));
      gl.uniform3fv(set.color, color);
      gl.uniform1f(set.emission, 1);
      gl.uniform1f(set.alpha, 1);
      gl.uniform1f(set.flat_, 0);
      gl.uniform1f(set.floor_, floor);
      gl.drawElements(gl.TRIANGLES, 6, gl.UNSIGNED_INT, 0);
      gl.uniform1f(set.floor_, 0);
    };
    gl.disable(gl.BLEND);
    gl.uniform2f(set.middle, this.target[0], 0);
    plain(this.desk, Math.round(this.target[0]), [1, 1, 1], 1);
    if (this.data.goal !== null) plain(this.line, this.data.goal + this.data.start, this.colour("goal"), 0);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    gl.bindVertexArray(this.lamp);
    gl.enable(gl.STENCIL_TEST);  // where shadows overlap they are no darker
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.depthMask(false);
    this.parts(motions[0].poses, 1, 0.26);
    gl.disable(gl.STENCIL_TEST);
    gl.depthMask(true);
    for (const { poses, ghost } of motions) {
      if (ghost) {  // first its depth alone, so that it is one veil and not many
        gl.colorMask(false, false, false, false);
        this.parts(poses, 0, 1, true);
        gl.colorMask(true, true, true, true);
        gl.depthFunc(gl.LEQUAL);
        this.parts(poses, 0, 0.5, true);
        gl.depthFunc(gl.LESS);
      } else this.parts(poses, 0, 1);
    }
  }

  colour(role) {  // the page's, as red, green and blue from 0 to 1
    const text = getComputedStyle(document.documentElement).getPropertyValue(`--${role}`).trim();
    return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255);
  }

  parts(poses, flat, alpha, ghost = false) {
    const gl = this.gl, set = this.places, twin = ghost ? this.colour("twin") : null;
    gl.uniform1f(set.flat_, flat);
    gl.uniform1f(set.alpha, alpha);
    for (const [body, first, count, red, green, blue, emission, shine] of this.data.parts) {
      gl.uniformMatrix4fv(set.pose, false, ofPose(poses[body]));
      gl.uniform3fv(set.color, ghost ? twin : [red, green, blue]);
      gl.uniform1f(set.emission, ghost ? 0.25 : emission);
      gl.uniform1f(set.shine, shine);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, first * 4);
    }
  }
}
