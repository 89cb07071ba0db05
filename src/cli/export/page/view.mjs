// A camera on an orbit, moved by mouse, touch and keys.

const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((v) => v / Math.hypot(...a));

// Half of the vertical field of view, as its tangent.
const HALF = 0.32;

export class Orbit {
  // Around a box in cube edges.
  constructor(low, high) {
    this.centre = low.map((v, i) => (v + high[i]) / 2);
    this.radius = Math.max(0.02, Math.hypot(...low.map((v, i) => high[i] - v)) / 2);
    this.reset();
  }

  reset() {
    [this.turn, this.tilt, this.near, this.target] = [0.6, 0.25, 1, [...this.centre]];
  }

  orbit(dx, dy) {
    this.turn -= dx;
    this.tilt = clamp(this.tilt + dy, -1.5, 1.5);
  }

  zoom(factor) {
    this.near = clamp(this.near * factor, 0.02, 6);
  }

  pan(dx, dy) {
    const { right, up } = this.frame(), scale = 2 * HALF * this.distance;
    this.target = add(add(this.target, right, -dx * scale), up, dy * scale);
  }

  get distance() {
    return this.near * this.radius / HALF * 1.05;
  }

  // Eye and axes in cube edges; right and up are as long as half the field of view is high.
  frame() {
    const [st, ct, sy, cy] = [Math.sin(this.tilt), Math.cos(this.tilt), Math.sin(this.turn), Math.cos(this.turn)];
    const back = [sy * ct, -cy * ct, st], ahead = back.map((v) => -v);
    const right = unit(cross(ahead, [0, 0, 1])), up = cross(right, ahead);
    return { eye: add(this.target, back, this.distance), ahead, right, up };
  }

  // With right and up scaled for the shader.
  shader() {
    const { eye, ahead, right, up } = this.frame();
    return { eye, ahead, right: right.map((v) => v * HALF), up: up.map((v) => v * HALF) };
  }

  // The depth whose voxels are as large as a pixel of a picture `height` pixels high.
  depth(height) {
    return Math.round(Math.log2(height / (2 * HALF * this.distance)));
  }
}

// Calls `moved` after each change. `own`: keys that do something else.
export function listen(canvas, orbit, moved, own = {}) {
  const fingers = new Map();
  let apart = 0;
  const step = (e) => {
    const before = fingers.get(e.pointerId);
    if (!before) return;
    const [dx, dy] = [(e.clientX - before[0]) / canvas.clientHeight, (e.clientY - before[1]) / canvas.clientHeight];
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (fingers.size === 2) {
      const [a, b] = [...fingers.values()], now = Math.hypot(a[0] - b[0], a[1] - b[1]);
      if (apart) orbit.zoom(apart / now);
      apart = now;
      orbit.pan(dx / 2, dy / 2);
    } else if (e.shiftKey || e.buttons === 2) {
      orbit.pan(dx, dy);
    } else {
      orbit.orbit(4 * dx, 4 * dy);
    }
    moved();
  };
  canvas.addEventListener("pointerdown", (e) => {
    canvas.setPointerCapture(e.pointerId);
    canvas.focus();
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    apart = 0;
  });
  canvas.addEventListener("pointermove", step);
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (e) => {
      fingers.delete(e.pointerId);
      apart = 0;
    });
  }
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    orbit.zoom(Math.exp(clamp(e.deltaY, -200, 200) * 0.002));
    moved();
  }, { passive: false });
  const keys = {
    ArrowLeft: () => orbit.orbit(0.1, 0), ArrowRight: () => orbit.orbit(-0.1, 0), ArrowUp: () => orbit.orbit(0, 0.1),
    ArrowDown: () => orbit.orbit(0, -0.1), "+": () => orbit.zoom(0.85), "=": () => orbit.zoom(0.85), "-": () => orbit.zoom(1 / 0.85),
    0: () => orbit.reset(), a: () => orbit.pan(0.05, 0), d: () => orbit.pan(-0.05, 0), w: () => orbit.pan(0, 0.05), s: () => orbit.pan(0, -0.05),
    ...own,
  };
  canvas.addEventListener("keydown", (e) => {
    if (!keys[e.key] || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    keys[e.key]();
    moved();
  });
}
