// Turns the lens: an orthographic view of the mesh that the page carries. Without WebGL the picture stays.
(() => {
  "use strict";
  const figure = document.querySelector(".turn");
  const canvas = figure.querySelector("canvas");
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) return;

  const bytes = Uint8Array.from(atob(document.getElementById("mesh").textContent.trim()), c => c.charCodeAt(0));
  const header = new DataView(bytes.buffer);
  const vertices = header.getUint32(0, true), triangles = header.getUint32(4, true);
  const unit = header.getFloat32(8, true), half = header.getFloat32(12, true), centre = header.getFloat32(16, true);
  const positions = new Int16Array(bytes.buffer, 20, 3 * vertices);
  const indices = new Uint16Array(bytes.buffer, 20 + 6 * vertices, 3 * triangles);
  const normals = new Int8Array(bytes.buffer, 20 + 6 * vertices + 6 * triangles, 3 * vertices);

  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, `
    attribute vec3 position, normal;
    uniform mat3 turn; uniform vec2 scale; uniform float unit, centre, depth;
    varying vec3 n, p;
    void main() {
      p = position * unit; n = turn * normal;
      vec3 q = turn * (p - vec3(0.0, 0.0, centre));
      gl_Position = vec4(q.xy * scale, -q.z * depth, 1.0);
    }`], [gl.FRAGMENT_SHADER, `
    precision mediump float;
    uniform bool cut;
    varying vec3 n, p;
    void main() {
      if (cut && p.y < 0.0) discard;
      if (!gl_FrontFacing) { gl_FragColor = vec4(0.93, 0.72, 0.50, 1.0); return; }
      vec3 m = normalize(n), glass = vec3(0.66, 0.79, 0.90);
      float key = max(dot(m, normalize(vec3(-0.45, 0.65, 0.62))), 0.0);
      float fill = max(dot(m, normalize(vec3(0.7, -0.1, 0.6))), 0.0);
      float shine = pow(max(dot(m, normalize(vec3(-0.25, 0.36, 0.9))), 0.0), 40.0);
      float rim = pow(1.0 - max(m.z, 0.0), 3.0);
      gl_FragColor = vec4(glass * (0.42 + 0.54 * key + 0.22 * fill) + 0.30 * shine + 0.10 * rim, 1.0);
    }`]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return;
  gl.useProgram(program);
  for (const [name, data, type, normalised] of [["position", positions, gl.SHORT, false], ["normal", normals, gl.BYTE, true]]) {
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    const place = gl.getAttribLocation(program, name);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, 3, type, normalised, 0, 0);
  }
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  gl.enable(gl.DEPTH_TEST);
  const at = name => gl.getUniformLocation(program, name);

  // Azimuth about the lens axis and elevation of the eye, in rad.
  const first = { azimuth: -1.0, elevation: 0.5, zoom: 1.0, cut: false };
  const view = { ...first };

  function draw() {
    const ca = Math.cos(view.azimuth), sa = Math.sin(view.azimuth);
    const ce = Math.cos(view.elevation), se = Math.sin(view.elevation);
    // Columns: where x, y and z go; rows: to the right, up, towards the eye.
    const turn = [-sa, -se * ca, ce * ca, ca, -se * sa, ce * sa, 0, ce, se];
    const up = view.zoom / half;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix3fv(at("turn"), false, turn);
    gl.uniform2f(at("scale"), up * canvas.height / canvas.width, up);
    gl.uniform1f(at("unit"), unit);
    gl.uniform1f(at("centre"), centre);
    gl.uniform1f(at("depth"), 1 / (4 * 32767 * unit));
    gl.uniform1i(at("cut"), view.cut);
    gl.drawElements(gl.TRIANGLES, 3 * triangles, gl.UNSIGNED_SHORT, 0);
  }

  function change(by) {
    Object.assign(view, by);
    view.elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, view.elevation));
    view.zoom = Math.max(0.3, Math.min(20, view.zoom));
    figure.querySelector('[data-view="cut"]').setAttribute("aria-pressed", view.cut);
    draw();
  }

  let held = null;
  canvas.addEventListener("pointerdown", event => {
    held = { x: event.clientX, y: event.clientY };
    if (event.isTrusted) canvas.setPointerCapture(event.pointerId);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  canvas.addEventListener("pointermove", event => {
    if (!held) return;
    const right = event.clientX - held.x, down = event.clientY - held.y;
    held = { x: event.clientX, y: event.clientY };
    change({ azimuth: view.azimuth - 0.008 * right, elevation: view.elevation + 0.008 * down });
  });
  canvas.addEventListener("wheel", event => {
    if (!event.ctrlKey) return; // the page scrolls as everywhere else
    event.preventDefault();
    change({ zoom: view.zoom * Math.exp(-0.002 * event.deltaY) });
  }, { passive: false });
  canvas.addEventListener("keydown", event => {
    const steps = {
      ArrowLeft: { azimuth: view.azimuth + 0.1 }, ArrowRight: { azimuth: view.azimuth - 0.1 },
      ArrowUp: { elevation: view.elevation + 0.1 }, ArrowDown: { elevation: view.elevation - 0.1 },
      "+": { zoom: 1.15 * view.zoom }, "-": { zoom: view.zoom / 1.15 },
    };
    if (!(event.key in steps)) return;
    event.preventDefault();
    change(steps[event.key]);
  });
  const views = {
    cut: () => ({ cut: !view.cut, ...(view.cut ? {} : { azimuth: -1.35, elevation: 0.3 }) }),
    below: () => ({ azimuth: first.azimuth, elevation: -0.8, cut: false }),
    first: () => first,
  };
  for (const button of figure.querySelectorAll("button")) {
    button.addEventListener("click", () => change(views[button.dataset.view]()));
  }

  figure.classList.add("live");
  new ResizeObserver(() => {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    canvas.width = Math.max(1, Math.round(ratio * canvas.clientWidth));
    canvas.height = Math.max(1, Math.round(ratio * canvas.clientHeight));
    draw();
  }).observe(canvas);
  canvas.addEventListener("webglcontextlost", () => figure.classList.remove("live"));
})();
