// The vehicle in space, with WebGL 2. Two programs: lines of a width in pixels, and flat triangles in light.

const LINE_VERTEX = `#version 300 es
uniform mat4 uView; uniform vec2 uSize;
in vec2 aCorner; in vec3 aFrom; in vec3 aTo; in vec4 aColour; in float aWidth;
out vec4 vColour;
void main() {
  vec4 from = uView * vec4(aFrom, 1.0), to = uView * vec4(aTo, 1.0);
  const float NEAR = 0.02;
  if (from.w < NEAR && to.w < NEAR) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  if (from.w < NEAR) from = mix(from, to, (NEAR - from.w) / (to.w - from.w));
  if (to.w < NEAR) to = mix(to, from, (NEAR - to.w) / (from.w - to.w));
  vec2 along = (to.xy / to.w - from.xy / from.w) * uSize;
  float reach = length(along);
  along = reach > 1e-4 ? along / reach : vec2(1.0, 0.0);
  vec4 end = mix(from, to, aCorner.x);
  vec2 aside = vec2(-along.y, along.x) * aCorner.y * aWidth + along * (aCorner.x * 2.0 - 1.0) * 0.5 * aWidth;
  gl_Position = end + vec4(aside / uSize * end.w, 0.0, 0.0);
  vColour = aColour;
}`;
const FACE_VERTEX = `#version 300 es
uniform mat4 uView;
in vec3 aPlace; in vec3 aNormal; in vec4 aColour;
out vec4 vColour;
void main() {
  gl_Position = uView * vec4(aPlace, 1.0);
  float light = 0.62 + 0.38 * abs(dot(aNormal, vec3(0.36, 0.24, 0.9)));
  vColour = vec4(aColour.rgb * light, aColour.a);
}`;
const FRAGMENT = `#version 300 es
precision mediump float;
in vec4 vColour; out vec4 colour;
void main() { colour = vec4(vColour.rgb * vColour.a, vColour.a); }`;

/** Multiplies two 4 × 4 matrices, stored by columns. */
function times(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
    let sum = 0;
    for (let k = 0; k < 4; k++) sum += a[4 * k + r] * b[4 * c + k];
    out[4 * c + r] = sum;
  }
  return out;
}

/** World to clip space, seen from `eye` towards `target`, with z up. */
function lookAt(eye, target, aspect) {
  const back = unit(sub(eye, target));
  const right = unit(cross([0, 0, 1], back));
  const up = cross(back, right);
  const view = new Float32Array([
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ]);
  const [near, far, tall] = [0.03, 200, 1 / Math.tan(0.36)];
  const lens = new Float32Array([tall / Math.max(aspect, 1e-3), 0, 0, 0, 0, tall, 0, 0,
    0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
  return times(lens, view);
}

class SpaceView {
  /** Null if the browser has no WebGL 2. */
  static on(canvas, labels, flight) {
    const gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true });
    return gl ? new SpaceView(gl, canvas, labels, flight) : null;
  }

  constructor(gl, canvas, labels, flight) {
    Object.assign(this, { gl, canvas, flight, mode: "follow" });
    this.labels = labels.getContext("2d");
    // How far the eye is: in metres, and in sizes of the course.
    this.camera = { turn: -2.2, tilt: 0.48, far: { follow: 0.95, course: 1 } };
    this.lines = this.program(LINE_VERTEX, [["aFrom", 3], ["aTo", 3], ["aColour", 4], ["aWidth", 1]], 1);
    this.faces = this.program(FACE_VERTEX, [["aPlace", 3], ["aNormal", 3], ["aColour", 4]], 0);
    this.theme();
    this.listen();
  }

  program(vertex, attributes, divisor) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    if (divisor) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, -1, 0, 1, 1, -1, 1, 1]), gl.STATIC_DRAW);
      const corner = gl.getAttribLocation(program, "aCorner");
      gl.enableVertexAttribArray(corner);
      gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
    }
    const buffer = gl.createBuffer();
    const stride = attributes.reduce((sum, [, size]) => sum + size, 0);
    const attach = (from) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, from);
      let offset = 0;
      for (const [name, size] of attributes) {
        const place = gl.getAttribLocation(program, name);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, size, gl.FLOAT, false, 4 * stride, 4 * offset);
        gl.vertexAttribDivisor(place, divisor);
        offset += size;
      }
    };
    return { program, array, buffer, stride, attach };
  }

  /** Takes up the colours of the page. */
  theme() {
    this.colours = palette();
    this.refresh();
  }

  /** Draws up what stands still: the courses and the ground below them. */
  refresh() {
    this.extent = extentOf(this.flight);
    const { body, wanted_w_m: wanted, count } = this.flight.frames;
    const { blue, orange, line, grid } = this.colours;
    this.flown = this.still(this.flown, this.course(body, 8, count, [...blue, 1], 2.2));
    this.planned = this.still(this.planned, this.course(wanted, 3, count, [...orange, 0.95], 1.8, 6));
    const ground = [];
    const [low, high] = this.extent;
    const step = Math.max(1, Math.ceil((high[0] - low[0]) / 20));
    for (let x = low[0]; x <= high[0]; x += step) this.put(ground, [x, low[1], 0], [x, high[1], 0], [...(x === 0 ? line : grid), 1], 1);
    for (let y = low[1]; y <= high[1]; y += step) this.put(ground, [low[0], y, 0], [high[0], y, 0], [...(y === 0 ? line : grid), 1], 1);
    this.ground = { ...this.still(this.ground, new Float32Array(ground)), step };
  }

  /** Hands strokes to the graphics card, in place of those before. */
  still(before, data) {
    const { gl } = this;
    const buffer = before?.buffer ?? gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return { buffer, count: data.length / 11 };
  }

  /** One line from each frame to the next; every `gap`-th stretch is left out to make dashes. */
  course(values, width, count, colour, px, gap = 0) {
    if (values.length === 0) return new Float32Array(0);
    const data = new Float32Array(Math.max(count - 1, 0) * 11);
    for (let i = 0; i + 1 < count; i++) {
      const [a, b] = [i * width, (i + 1) * width];
      const visible = gap === 0 || Math.floor(i / gap) % 2 === 0;
      data.set([values[a], values[a + 1], values[a + 2], values[b], values[b + 1], values[b + 2], ...colour, visible ? px : 0], i * 11);
    }
    return data;
  }

  listen() {
    const { canvas, camera } = this;
    let held = null;
    canvas.addEventListener("pointerdown", (e) => { held = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("pointermove", (e) => {
      if (!held) return;
      camera.turn -= (e.clientX - held[0]) * 0.008;
      camera.tilt = Math.max(-0.2, Math.min(1.55, camera.tilt + (e.clientY - held[1]) * 0.008));
      held = [e.clientX, e.clientY];
      this.changed?.();
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      const [nearest, furthest] = this.mode === "follow" ? [0.3, 80] : [0.05, 10];
      camera.far[this.mode] = Math.max(nearest, Math.min(furthest, camera.far[this.mode] * Math.exp(e.deltaY * 0.001)));
      this.changed?.();
    }, { passive: false });
  }

  put(list, from, to, colour, px) {
    list.push(...from, ...to, ...colour, px);
  }

  face(list, a, b, c, colour) {
    const normal = unit(cross(sub(b, a), sub(c, a)));
    for (const point of [a, b, c]) list.push(...point, ...normal, ...colour);
  }

  /** A bar of rectangular section. */
  bar(list, from, to, wide, up, colour) {
    const along = unit(sub(to, from));
    const aside = unit(cross(up, along)).map((v) => (v * wide) / 2);
    const high = unit(cross(along, aside)).map((v) => (v * wide) / 2);
    const corner = (p, s, t) => add(add(p, aside, s), high, t);
    const ring = [[1, 1], [-1, 1], [-1, -1], [1, -1]];
    ring.forEach(([s, t], i) => {
      const [u, v] = ring[(i + 1) % 4];
      const [a, b, c, d] = [corner(from, s, t), corner(to, s, t), corner(to, u, v), corner(from, u, v)];
      this.face(list, a, b, c, colour);
      this.face(list, a, c, d, colour);
    });
  }

  disc(list, centre, radius, x, y, colour) {
    const at = (i) => add(add(centre, x, radius * Math.cos((i * Math.PI) / 16)), y, radius * Math.sin((i * Math.PI) / 16));
    for (let i = 0; i < 32; i++) this.face(list, centre, at(i), at(i + 1), colour);
  }

  arrow(faces, from, vector, wide, colour) {
    const length = Math.hypot(...vector);
    if (length < 1e-3) return;
    const along = unit(vector);
    const head = Math.min(length, 5 * wide);
    const neck = add(from, along, length - head);
    const side = Math.abs(along[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1];
    if (length > head) this.bar(faces, from, neck, wide, side, colour);
    const x = unit(cross(side, along));
    const y = cross(along, x);
    const tip = add(from, along, length);
    const at = (i) => add(add(neck, x, 1.6 * wide * Math.cos((i * Math.PI) / 6)), y, 1.6 * wide * Math.sin((i * Math.PI) / 6));
    for (let i = 0; i < 12; i++) this.face(faces, at(i), at(i + 1), tip, colour);
    this.disc(faces, neck, 1.6 * wide, x, y, colour);
  }

  vehicle(pose, scale, lines, solid, clear) {
    const { black, grey, red, blue, orange, sky, purple } = this.colours;
    const shape = shapeOf(this.flight.vehicle, pose.beta);
    const world = (p) => add(pose.position, turn(pose.attitude, p.map((v) => v * scale)));
    const [x, y, z] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => turn(pose.attitude, axis));
    const reach = arrows(this.flight.vehicle, scale);
    const r = shape.hub * scale;
    const wide = 0.012 * scale;
    this.bar(solid, world([-shape.hub, 0, 0]), world([shape.hub, 0, 0]), r * 0.9, z, [...grey, 1]);
    this.bar(solid, world([0, -shape.hub, 0]), world([0, shape.hub, 0]), r * 0.9, z, [...grey, 1]);
    shape.arms.forEach(({ root, elbows, rotor }, i) => {
      for (const elbow of elbows) {
        this.bar(solid, world(root), world(elbow), wide, z, [...black, 1]);
        this.bar(solid, world(elbow), world(rotor), wide, z, [...purple, 1]);
      }
      const top = add(world(rotor), z, 0.02 * scale);
      // The front rotor shows which way the vehicle looks.
      this.disc(clear, top, shape.propeller * scale, x, y, [...(i === 0 ? orange : sky), 0.42]);
      this.arrow(solid, top, z.map((v) => v * pose.thrust[i] * reach.thrust), 0.011 * scale, [...blue, 1]);
    });
    this.arrow(solid, add(pose.position, z, 0.05 * scale), pose.wind.map((v) => v * reach.wind), 0.014 * scale, [...sky, 1]);
    this.arrow(solid, pose.position, pose.force.map((v) => v * reach.force), 0.018 * scale, [...red, 1]);
    const below = [pose.position[0], pose.position[1], 0];
    this.put(lines, pose.position, below, [...grey, 0.5], 0.8);
    this.disc(clear, below, shape.arm * scale, [1, 0, 0], [0, 1, 0], [...grey, 0.22]);
    if (pose.wanted) for (const axis of [[1, 0, 0], [0, 1, 0], [0, 0, 1]]) {
      const at = (k) => add(pose.wanted, axis, k * 0.035 * scale);
      this.put(lines, at(-1), at(1), [...orange, 1], 2);
    }
  }

  draw(pose, t) {
    const { gl, canvas, camera, flight } = this;
    const ratio = fit(canvas);
    const aspect = canvas.width / Math.max(canvas.height, 1);
    const [low, high] = this.extent;
    const follows = this.mode === "follow";
    const target = follows ? pose.position : low.map((v, i) => (v + high[i]) / 2);
    const size = 1.2 * Math.hypot(...sub(high, low)) + 0.5;
    const far = camera.far[this.mode] * (follows ? 1 : size * Math.max(1, 1.1 / aspect));
    const eye = add(target, [Math.cos(camera.turn) * Math.cos(camera.tilt), Math.sin(camera.turn) * Math.cos(camera.tilt), Math.sin(camera.tilt)], far);
    eye[2] = Math.max(eye[2], 0.05);
    this.view = lookAt(eye, target, aspect);
    this.scale = follows ? 1 : 3;
    const [lines, solid, clear] = [[], [], []];
    this.vehicle(pose, this.scale, lines, solid, clear);
    const ghost = rehearsedPose(flight, pose);
    if (ghost) {
      const { course } = flight.rehearsed;
      for (let i = 1; i < course.length; i++) this.put(lines, course[i - 1].slice(1, 4), course[i].slice(1, 4), [...this.colours.red, 1], 2.6);
      this.vehicle(ghost, this.scale, lines, solid, clear);
    }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...this.colours.back, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.strokes(this.ground.buffer, this.ground.count, ratio);
    this.strokes(this.planned.buffer, this.planned.count, ratio);
    const until = Math.ceil((t - flight.from_s) / flight.frames.step_s);
    this.strokes(this.flown.buffer, Math.max(0, Math.min(until, this.flown.count)), ratio);
    this.triangles(solid);
    this.strokes(this.upload(lines), lines.length / 11, ratio);
    gl.depthMask(false);
    this.triangles(clear);
    gl.depthMask(true);
    this.label(ratio);
  }

  upload(list) {
    const { gl, lines } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, lines.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list), gl.DYNAMIC_DRAW);
    return lines.buffer;
  }

  strokes(buffer, count, ratio) {
    const { gl, lines, canvas } = this;
    if (count === 0) return;
    gl.useProgram(lines.program);
    gl.bindVertexArray(lines.array);
    lines.attach(buffer);
    gl.uniformMatrix4fv(gl.getUniformLocation(lines.program, "uView"), false, this.view);
    gl.uniform2f(gl.getUniformLocation(lines.program, "uSize"), canvas.width / ratio, canvas.height / ratio);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, count);
  }

  triangles(list) {
    const { gl, faces } = this;
    if (list.length === 0) return;
    gl.useProgram(faces.program);
    gl.bindVertexArray(faces.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, faces.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(list), gl.DYNAMIC_DRAW);
    faces.attach(faces.buffer);
    gl.uniformMatrix4fv(gl.getUniformLocation(faces.program, "uView"), false, this.view);
    gl.drawArrays(gl.TRIANGLES, 0, list.length / faces.stride);
  }

  /** Point of the world on the canvas [px], or null behind the eye. */
  project(point, wide, tall) {
    const v = this.view;
    const row = (r) => v[r] * point[0] + v[4 + r] * point[1] + v[8 + r] * point[2] + v[12 + r];
    const w = row(3);
    return w > 0.05 ? [((row(0) / w + 1) / 2) * wide, ((1 - row(1) / w) / 2) * tall] : null;
  }

  /** Numbers along two edges of the ground, and a scale of height. */
  label() {
    const context = this.labels;
    const ratio = fit(context.canvas);
    const [wide, tall] = [context.canvas.width / ratio, context.canvas.height / ratio];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, wide, tall);
    context.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--faint");
    const taken = [];
    // What the lines mean stands before the same ground.
    const [own, key] = [context.canvas, document.getElementById("key")].map((one) => one.getBoundingClientRect());
    const hides = (x, y, room) => x - room < key.right - own.left && x + room > key.left - own.left && y + 8 > key.top - own.top && y - 8 < key.bottom - own.top;
    const write = (text, point) => {
      const at = this.project(point, wide, tall);
      const room = 5 + context.measureText(text).width / 2;
      if (!at || at[0] < room || at[0] > wide - room || at[1] < 40 || at[1] > tall - 12 || hides(...at, room)) return;
      if (taken.some(([x, y, r]) => Math.abs(x - at[0]) < r + room && Math.abs(y - at[1]) < 14)) return;
      taken.push([...at, room]);
      context.fillText(text, at[0], at[1]);
    };
    const [low, high] = this.extent;
    const { step } = this.ground;
    write("x [m] east", [(low[0] + high[0]) / 2 + 0.5 * step, low[1] - 0.55, 0]);
    write("y [m] north", [low[0] - 0.55, (low[1] + high[1]) / 2 + 0.5 * step, 0]);
    for (let x = low[0]; x <= high[0]; x += step) write(figure(x, 0), [x, low[1] - 0.2, 0]);
    for (let y = low[1]; y <= high[1]; y += step) write(figure(y, 0), [low[0] - 0.2, y, 0]);
  }
}

/** Gives a canvas as many pixels as it covers, and their number per CSS pixel. */
function fit(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [wide, tall] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (canvas.width !== wide) canvas.width = wide;
  if (canvas.height !== tall) canvas.height = tall;
  return ratio;
}
