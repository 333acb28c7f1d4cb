// The lens in three dimensions, coloured by a figure, with rays by fate: drag, arrow keys, wheel, plus and minus.
import { TABLE, sized } from "./frames.js";
import { short } from "./picture.js";

const UNITS = { sag: "mm", slope: "° from the axis", curvature: "1/mm, concave is negative", wall: "mm", ball: "mm, largest ball that touches" };
const FATES = { "left lens": [0.95, 0.65, 0.15], "total reflection": [0.85, 0.2, 0.2] };
const VERTEX = `attribute vec3 place, normal; attribute vec3 tint; uniform mat3 turn; uniform vec3 centre; uniform vec2 scale;
  varying vec3 n, t; void main() { n = turn * normal; t = tint; vec3 q = turn * (place - centre);
  gl_Position = vec4(q.xy * scale, -q.z * min(scale.x, scale.y) * 0.2, 1.0); }`;
const FRAGMENT = `precision mediump float; varying vec3 n, t; uniform float lit; void main() {
  vec3 m = normalize(n + 1e-6); if (m.z < 0.0) m = -m; float light = 0.45 + 0.5 * max(dot(m, normalize(vec3(-0.4, 0.6, 0.7))), 0.0);
  gl_FragColor = vec4(mix(t, t * light + 0.12 * pow(m.z, 30.0), lit), 1.0); }`;

export class Solid {
  constructor(canvas, scale) {
    Object.assign(this, { canvas, scale, yaw: 0.6, tilt: -1.05, zoom: 1, frame: null, inner: false, rays: false });
    const gl = this.gl = canvas.getContext("webgl", { antialias: true });
    if (!gl) { scale.textContent = "No WebGL in this browser: the section shows the lens."; return; }
    this.program = this.compiled();
    canvas.addEventListener("pointerdown", event => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", event => event.buttons && this.turn(0.01 * event.movementX, 0.01 * event.movementY));
    canvas.addEventListener("wheel", event => { event.preventDefault(); this.near(Math.exp(-0.001 * event.deltaY)); }, { passive: false });
    canvas.addEventListener("keydown", event => {
      const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      const zoom = { "+": 1.15, "=": 1.15, "-": 1 / 1.15 }[event.key];
      if (turn) this.turn(...turn);
      if (zoom) this.near(zoom);
      if (turn || zoom) event.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  compiled() {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["place", "normal", "tint"].forEach((name, k) => gl.bindAttribLocation(program, k, name));
    gl.linkProgram(program);
    return program;
  }

  turn(yaw, tilt) {
    this.yaw += yaw;
    this.tilt = Math.max(-Math.PI, Math.min(0.3, this.tilt + tilt));
    this.draw();
  }

  near(factor) {
    this.zoom = Math.max(0.3, Math.min(20, this.zoom * factor));
    this.draw();
  }

  show(frame) {
    this.frame = frame;
    this.draw();
  }

  draw() {
    const { gl, frame } = this, { width, height } = sized(this.canvas);
    if (!gl || !frame?.arrays.outer || !width) return;
    const side = this.inner ? "inner" : "outer", net = frame.arrays[side], figure = frame.arrays[`${side}_figure`];
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    let reach = 0, top = 0;
    for (let k = 0; k < net.values.length; k += 3) {
      reach = Math.max(reach, Math.hypot(net.values[k], net.values[k + 1]));
      top = Math.max(top, net.values[k + 2]);
    }
    const half = (this.rays && frame.arrays.rays ? 2.2 : 1.15) * Math.max(reach, top / 1.4) / this.zoom;
    const [cy, sy, ct, st] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.tilt), Math.sin(this.tilt)];
    gl.uniformMatrix3fv(this.at("turn"), false, [cy, sy * ct, sy * st, -sy, cy * ct, cy * st, 0, -st, ct]);
    gl.uniform3f(this.at("centre"), 0, 0, top * 0.45);
    gl.uniform2f(this.at("scale"), Math.min(1, height / width) / half, Math.min(1, width / height) / half);
    this.net(net, frame.arrays[`${side}_normal`], figure, frame.figure);
    if (this.rays && frame.arrays.rays) this.lines(frame);
  }

  at(name) { return this.gl.getUniformLocation(this.program, name); }

  load(slot, values) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STREAM_DRAW);
    gl.enableVertexAttribArray(slot);
    gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 0, 0);
    return buffer;
  }

  net(net, normals, figure, name) {
    const gl = this.gl, [rings, spokes] = net.shape, known = Array.from(figure.values).filter(value => name !== "ball" || value >= 0).sort((a, b) => a - b);
    const low = known[Math.floor(0.01 * known.length)] ?? 0, high = known[Math.ceil(0.99 * known.length) - 1] ?? 1;
    const tints = new Float32Array(3 * figure.values.length);
    figure.values.forEach((value, k) => {
      const share = Math.max(0, Math.min(1, (value - low) / Math.max(high - low, 1e-12)));
      for (let c = 0; c < 3; c += 1) tints[3 * k + c] = name === "ball" && value < 0 ? [0.55, 0.75, 0.85][c] : TABLE[3 * Math.round(40 + 200 * share) + c] / 255;
    });
    const order = [];
    for (let r = 0; r + 1 < rings; r += 1) for (let s = 0; s + 1 < spokes; s += 1) {
      const k = r * spokes + s;
      order.push(k, k + spokes, k + 1, k + 1, k + spokes, k + spokes + 1);
    }
    const used = [this.load(0, net.values), this.load(1, normals.values), this.load(2, tints), gl.createBuffer()];
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, used[3]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint16Array(order), gl.STREAM_DRAW);
    gl.uniform1f(this.at("lit"), 1);
    gl.drawElements(gl.TRIANGLES, order.length, gl.UNSIGNED_SHORT, 0);
    used.forEach(buffer => gl.deleteBuffer(buffer));
    this.scale.textContent = `dark ${short(low)} … bright ${short(high)} ${UNITS[name]}`;
  }

  lines(frame) {
    const gl = this.gl, { shape: [count, points], values } = frame.arrays.rays, fates = frame.arrays.fates.values, place = [], tint = [], seen = {};
    for (let ray = 0; ray < count; ray += 1) {
      const fate = frame.fates[fates[ray]], ink = FATES[fate] ?? [0.45, 0.45, 0.5];
      seen[fate] = (seen[fate] ?? 0) + 1;
      for (let k = 0; k + 1 < points; k += 1) for (const end of [k, k + 1]) {
        place.push(...values.subarray(3 * (ray * points + end), 3 * (ray * points + end) + 3));
        tint.push(...ink);
      }
    }
    const used = [this.load(0, new Float32Array(place)), this.load(1, new Float32Array(place.length)), this.load(2, new Float32Array(tint))];
    gl.uniform1f(this.at("lit"), 0);
    gl.drawArrays(gl.LINES, 0, place.length / 3);
    used.forEach(buffer => gl.deleteBuffer(buffer));
    this.scale.textContent = `rays: ${Object.entries(seen).map(([fate, number]) => `${fate} ${short(100 * number / count)} %`).join(", ")}`;
  }
}
