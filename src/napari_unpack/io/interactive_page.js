
"use strict";
// Draws the bag of an interactive page; what it draws is written by interactive_page.py.
// Axes: right, up, towards the viewer, mm, from the middle of the bag.
{
const bag = JSON.parse(document.getElementById("bag").textContent);
const [view, live, stills] = ["view", "live", "stills"].map(id => document.getElementById(id));
const [back, slider, next, whole, said] =
  ["back", "step", "next", "whole", "said"].map(id => document.getElementById(id));
const canvas = live.querySelector("canvas");
const rows = new Map([...document.querySelectorAll("tr[data-id]")].map(r => [r.dataset.id, r]));
const calm = matchMedia("(prefers-reduced-motion: reduce)");
const gl = canvas.getContext("webgl2", { alpha: true, antialias: true, stencil: true });

const VERTEX = `#version 300 es
precision highp float;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
uniform mat4 projection;
uniform vec3 low, grid, place;
uniform vec4 turn;
uniform float size, level;
uniform vec2 shift;
out vec3 facing, seen;
vec3 turned(vec3 v) { return v + 2.0 * cross(turn.xyz, cross(turn.xyz, v) + turn.w * v); }
void main() {
  seen = turned(low + grid * position) * size + place;
  facing = turned(normal);
  gl_Position = projection * vec4(seen, 1.0);
  // What is out is seen from straight before it, as the plugin's sprites, wherever it stands.
  float away = mix(gl_Position.w, (projection * vec4(place, 1.0)).w, level);
  gl_Position.xy = (gl_Position.xy / away + shift) * gl_Position.w;
}`;
// Blinn-Phong with the lamp at the viewer's head, as the plugin's; distance is 0 without
// perspective.
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 facing, seen;
uniform vec4 color, light;
uniform float lit, distance, level;
out vec4 pixel;
void main() {
  vec3 ahead = vec3(0.0, 0.0, 1.0);
  vec3 eye = distance > 0.0 ? mix(normalize(ahead * distance - seen), ahead, level) : ahead;
  float c = abs(dot(normalize(facing), eye));
  vec3 shaded = color.rgb * (light.x + light.y * c) + light.z * pow(c, light.w);
  pixel = vec4(mix(color.rgb, min(shaded, 1.0), lit), 1.0);
}`;

// Quaternions x y z w.
const product = ([a, b, c, d], [x, y, z, w]) => [
  d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
  d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z];
const unit = v => { const n = Math.hypot(...v); return v.map(x => x / n); };
const about = (axis, angle) => [...axis.map(x => x * Math.sin(angle / 2)), Math.cos(angle / 2)];
const rotated = (q, v) =>
  product(product(q, [...v, 0]), [-q[0], -q[1], -q[2], q[3]]).slice(0, 3);
const power = (q, share) => {
  const sign = q[3] < 0 ? -1 : 1, sine = Math.hypot(q[0], q[1], q[2]);
  if (sine < 1e-9) return [0, 0, 0, 1];
  const half = share * Math.atan2(sine, sign * q[3]);
  return [...[0, 1, 2].map(k => sign * q[k] / sine * Math.sin(half)), Math.cos(half)];
};
const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

// What is seen: steps done now and wanted, how the bag is turned, and the picture's cut-out.
let now = bag.step, wanted = bag.step, selected = null;
let turn, zoom, pan, last = 0, waiting = false, shapes = [];

function whatIsSeen() { turn = [0, 0, 0, 1]; zoom = 1; pan = [0, 0]; }

function shapeOf(one) {
  const points = new Uint16Array(bytes(one.points).buffer);
  const triangles = new Uint16Array(bytes(one.triangles).buffer);
  const sums = new Float32Array(points.length), normals = new Int8Array(points.length / 3 * 4);
  const at = (i, k) => points[3 * i + k] * one.grid[k];
  for (let t = 0; t < triangles.length; t += 3) {
    const [i, j, l] = [triangles[t], triangles[t + 1], triangles[t + 2]];
    const a = [0, 1, 2].map(k => at(j, k) - at(i, k)), b = [0, 1, 2].map(k => at(l, k) - at(i, k));
    for (let k = 0; k < 3; k++) {
      const [m, n] = [(k + 1) % 3, (k + 2) % 3], normal = a[m] * b[n] - a[n] * b[m];
      for (const corner of [i, j, l]) sums[3 * corner + k] += normal;
    }
  }
  for (let i = 0; i < sums.length / 3; i++) {
    const length = Math.hypot(sums[3 * i], sums[3 * i + 1], sums[3 * i + 2]) || 1;
    for (let k = 0; k < 3; k++) normals[4 * i + k] = Math.round(127 * sums[3 * i + k] / length);
  }
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const send = (target, data) => {
    gl.bindBuffer(target, gl.createBuffer());
    gl.bufferData(target, data, gl.STATIC_DRAW);
  };
  send(gl.ARRAY_BUFFER, points);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.UNSIGNED_SHORT, false, 6, 0);
  send(gl.ARRAY_BUFFER, normals);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribPointer(1, 3, gl.BYTE, true, 4, 0);
  send(gl.ELEMENT_ARRAY_BUFFER, triangles);
  return { ...one, array, count: triangles.length };
}

function compiled() {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw gl.getProgramInfoLog(program);
  gl.useProgram(program);
  return program;
}

// Where an object stands: on its way out, of which each row is centre, size, turn, and how far
// it has left the bag's axes for the window's.
function poseOf(one) {
  const gone = clamp(now - one.step + 1, 0, 1), count = one.path.length / 9 - 1;
  const row = Math.min(Math.floor(gone * count), count - 1), share = gone * count - row;
  const [a, b] = [row, row + 1].map(k => one.path.slice(9 * k, 9 * k + 9));
  const near = a[4] * b[4] + a[5] * b[5] + a[6] * b[6] + a[7] * b[7] < 0 ? -1 : 1;
  const mixed = a.map((v, k) => v + share * ((k > 3 && k < 8 ? near : 1) * b[k] - v));
  const with_bag = power(turn, 1 - mixed[8]);
  return {
    place: rotated(with_bag, mixed.slice(0, 3)), size: mixed[3], level: mixed[8],
    turn: unit(product(with_bag, unit(mixed.slice(4, 8)))),
  };
}

function height() {
  const step = clamp(Math.floor(now), 0, bag.steps - 1);
  const [a, b] = [bag.heights[step], bag.heights[step + 1]];
  const wider = (bag.window[1] / bag.window[0]) / (canvas.clientWidth / canvas.clientHeight);
  return (a + (now - step) * (b - a)) * Math.max(1, wider) / zoom;
}

function projection() {
  const aspect = canvas.width / canvas.height, high = height(), reach = 2 * bag.heights.at(-1);
  const up = 2 / high, right = up / aspect;
  if (!bag.fov) {
    return [[right, 0, 0, 0, 0, up, 0, 0, 0, 0, -1 / reach, 0, 0, 0, 0, 1], 0];
  }
  const eye = high / (2 * Math.tan(bag.fov * Math.PI / 360));
  const near = Math.max(eye - reach, eye / 50), far = eye + reach, deep = far - near;
  // w is 1 in the plane through the bag's middle, so that sizes there are those of `height`.
  const z = (far + near) / deep / eye, shift = (far + near) / deep - 2 * far * near / deep / eye;
  return [[right, 0, 0, 0, 0, up, 0, 0, 0, 0, -z, -1 / eye, 0, 0, shift, 1], eye];
}

function draw(uniform, colorOf) {
  const [matrix, eye] = projection();
  gl.uniformMatrix4fv(uniform.projection, false, matrix);
  gl.uniform4fv(uniform.light, bag.light);
  gl.uniform1f(uniform.distance, eye);
  gl.uniform2f(uniform.shift, ...pan);
  gl.viewport(0, 0, canvas.width, canvas.height);
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
  gl.enable(gl.DEPTH_TEST);
  for (const one of shapes) drawOne(uniform, one, colorOf(one));
}

function drawOne(uniform, one, color) {
  const pose = poseOf(one);
  gl.uniform3fv(uniform.low, one.low);
  gl.uniform3fv(uniform.grid, one.grid);
  gl.uniform3fv(uniform.place, pose.place);
  gl.uniform4fv(uniform.turn, pose.turn);
  gl.uniform1f(uniform.size, pose.size);
  gl.uniform1f(uniform.level, pose.level);
  gl.uniform4f(uniform.color, ...color, 1);
  gl.bindVertexArray(one.array);
  gl.drawElements(gl.TRIANGLES, one.count, gl.UNSIGNED_SHORT, 0);
}

// A ring round the selected object, also where others hide it: drawn shifted to all sides, but
// not upon the object itself.
function ring(uniform, one) {
  const color = getComputedStyle(canvas).color.match(/[\d.]+/g).slice(0, 3).map(v => v / 255);
  const wide = 2.5 * devicePixelRatio;
  gl.disable(gl.DEPTH_TEST);
  gl.enable(gl.STENCIL_TEST);
  gl.uniform1f(uniform.lit, 0);
  gl.colorMask(false, false, false, false);
  gl.stencilFunc(gl.ALWAYS, 1, 1);
  gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
  drawOne(uniform, one, color);
  gl.colorMask(true, true, true, true);
  gl.stencilFunc(gl.NOTEQUAL, 1, 1);
  gl.stencilOp(gl.KEEP, gl.KEEP, gl.KEEP);
  for (let k = 0; k < 12; k++) {
    const [x, y] = [Math.cos(k * Math.PI / 6), Math.sin(k * Math.PI / 6)];
    const [right, up] = [2 * wide * x / canvas.width, 2 * wide * y / canvas.height];
    gl.uniform2f(uniform.shift, pan[0] + right, pan[1] + up);
    drawOne(uniform, one, color);
  }
  gl.disable(gl.STENCIL_TEST);
}

function start() {
  const program = compiled(), uniform = {};
  for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
    const { name } = gl.getActiveUniform(program, k);
    uniform[name] = gl.getUniformLocation(program, name);
  }
  shapes = bag.objects.map(shapeOf);
  const hidden = gl.createFramebuffer();
  const stores = [gl.createRenderbuffer(), gl.createRenderbuffer()];

  function frame(time) {
    waiting = false;
    if (now !== wanted) {
      // Far away it hurries: a bar drawn along must not lag by minutes.
      const passed = Math.min((time - last) / 1000, 0.1) / bag.seconds;
      const left = wanted - now, way = passed * Math.max(1, Math.abs(left));
      now = calm.matches || Math.abs(left) <= way ? wanted : now + Math.sign(left) * way;
    }
    const sharp = devicePixelRatio;
    const size = [canvas.clientWidth, canvas.clientHeight].map(n => Math.max(1, Math.round(n * sharp)));
    if (size[0] !== canvas.width || size[1] !== canvas.height) [canvas.width, canvas.height] = size;
    gl.uniform1f(uniform.lit, 1);
    draw(uniform, one => one.color);
    const chosen = shapes.find(one => one.id === selected);
    if (chosen) ring(uniform, chosen);
    last = time;
    if (now !== wanted) redraw();
  }

  function redraw() {
    if (!waiting) {
      waiting = true;
      requestAnimationFrame(time => frame(time));
    }
  }

  function goTo(step) {
    wanted = clamp(step, 0, bag.steps);
    slider.value = wanted;
    [back.disabled, next.disabled] = [wanted === 0, wanted === bag.steps];
    const names = bag.objects.filter(one => one.step === wanted).map(one => one.name).join(", ");
    const words = wanted ? `Step ${wanted} of ${bag.steps}: ${names}` : "Everything is packed";
    slider.setAttribute("aria-valuetext", words);
    said.textContent = words;
    last = performance.now();
    redraw();
  }

  // The number of the object at a place of the window, drawn as a colour; 0 where there is none.
  function objectAt(x, y) {
    const box = canvas.getBoundingClientRect();
    gl.bindFramebuffer(gl.FRAMEBUFFER, hidden);
    [[gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT24]]
      .forEach(([place, kind], k) => {
        gl.bindRenderbuffer(gl.RENDERBUFFER, stores[k]);
        gl.renderbufferStorage(gl.RENDERBUFFER, kind, canvas.width, canvas.height);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, stores[k]);
      });
    gl.uniform1f(uniform.lit, 0);
    const numbers = new Map(shapes.map((one, k) => [one, k + 1]));
    draw(uniform, one => [numbers.get(one) >> 8, numbers.get(one) & 255, 0].map(v => v / 255));
    const pixel = new Uint8Array(4);
    const [col, row] = [(x - box.left) / box.width, 1 - (y - box.top) / box.height];
    gl.readPixels(Math.floor(col * canvas.width), Math.floor(row * canvas.height), 1, 1,
                  gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixel[3] ? 256 * pixel[0] + pixel[1] : 0;
  }

  // Nearer or farther, about a place of the window that stays where it is.
  function near(times, x = null, y = 0) {
    const box = canvas.getBoundingClientRect(), before = zoom;
    zoom = clamp(zoom * times, 0.2, 40);
    const at = x === null ? [0, 0]
      : [2 * (x - box.left) / box.width - 1, 1 - 2 * (y - box.top) / box.height];
    pan = pan.map((p, k) => at[k] - (at[k] - p) * zoom / before);
    redraw();
  }

  function turnBy(right, down) {
    const angle = Math.hypot(right, down);
    if (angle) turn = unit(product(about([down / angle, right / angle, 0], angle), turn));
    redraw();
  }

  const shift = (x, y) => {
    pan = [pan[0] + 2 * x / canvas.clientWidth, pan[1] - 2 * y / canvas.clientHeight];
    redraw();
  };
  const pointers = new Map();
  let travelled = 0;
  canvas.addEventListener("pointerdown", event => {
    pointers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
    if (pointers.size === 1) travelled = 0;
  });
  canvas.addEventListener("pointermove", event => {
    const was = pointers.get(event.pointerId), is = [event.clientX, event.clientY];
    if (!was) return;
    const [x, y] = [is[0] - was[0], is[1] - was[1]];
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    travelled += Math.hypot(x, y) + (other ? 100 : 0);
    pointers.set(event.pointerId, is);
    if (other) {
      const apart = p => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      shift(x / 2, y / 2);
      near(apart(is) / apart(was), (is[0] + other[0]) / 2, (is[1] + other[1]) / 2);
    } else if (event.shiftKey || event.buttons & 6) shift(x, y);
    else turnBy(x * 0.008, y * 0.008);
  });
  const ended = event => pointers.delete(event.pointerId);
  canvas.addEventListener("pointerup", event => {
    // A hand moves a little as it clicks.
    if (pointers.size === 1 && travelled < 5 && event.button === 0) {
      const number = objectAt(event.clientX, event.clientY);
      select(number ? shapes[number - 1].id : null, true);
    }
    ended(event);
  });
  canvas.addEventListener("pointercancel", ended);
  canvas.addEventListener("contextmenu", event => event.preventDefault());
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    near(Math.exp(-clamp(event.deltaY, -120, 120) * 0.002), event.clientX, event.clientY);
  }, { passive: false });

  const all = () => { whatIsSeen(); redraw(); };
  const keys = {
    ArrowLeft: () => turnBy(-0.12, 0), ArrowRight: () => turnBy(0.12, 0),
    ArrowUp: () => turnBy(0, -0.12), ArrowDown: () => turnBy(0, 0.12),
    "+": () => near(1.15), "=": () => near(1.15), "-": () => near(1 / 1.15), 0: all,
    n: () => goTo(wanted + 1), b: () => goTo(wanted - 1), Escape: () => select(null),
  };
  canvas.addEventListener("keydown", event => {
    const does = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!does || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    does();
  });
  next.addEventListener("click", () => goTo(wanted + 1));
  back.addEventListener("click", () => goTo(wanted - 1));
  whole.addEventListener("click", all);
  slider.addEventListener("input", () => goTo(+slider.value));
  new ResizeObserver(redraw).observe(canvas);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  // Drivers take a context away at times; the pictures stay.
  canvas.addEventListener("webglcontextlost", () => {
    stills.querySelector("p").textContent = "The browser took the graphics away. Reload the page " +
      "to turn the bag; here are pictures of it.";
    [live.hidden, stills.hidden] = [true, false];
  });
  view.addEventListener("selected", redraw);
  [live.hidden, stills.hidden] = [false, true];
  goTo(bag.step);
}

// Scrolls the box of the table alone: scrollIntoView would scroll the page too, and the bag out of
// a small window. There the box is as tall as the table, and nothing is scrolled.
function scrollToRow(row) {
  const box = row.closest(".wide");
  const [outer, inner] = [box.getBoundingClientRect(), row.getBoundingClientRect()];
  // The table's head stands before the rows.
  const top = outer.top + box.querySelector("thead").offsetHeight;
  if (inner.top < top) box.scrollTop -= top - inner.top;
  else if (inner.bottom > outer.bottom) box.scrollTop += inner.bottom - outer.bottom;
}

function select(id, show = false) {
  selected = id;
  for (const [other, row] of rows) {
    const chosen = other === id;
    row.toggleAttribute("aria-current", chosen);
    if (chosen) row.setAttribute("aria-current", "true");
    row.querySelector("button").setAttribute("aria-pressed", chosen);
  }
  const one = bag.objects.find(object => object.id === id);
  said.textContent = one ? `${one.name}: ID ${one.id}, leaves at step ${one.step}` : "";
  if (show && one) scrollToRow(rows.get(id));
  view.dispatchEvent(new Event("selected"));
}

whatIsSeen();
for (const [id, row] of rows) row.addEventListener("click", () => select(id === selected ? null : id));
if (gl) start();
}
