// A camera on an orbit, moved by mouse, touch and keys.

const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((v) => v / Math.hypot(...a));

// Half of the vertical field of view, as its tangent.
const HALF = 0.32;
// Where the first view is from, radians.
const FIRST = { turn: 0.6, tilt: 0.25 };

export class Orbit {
  // Around the middle of the box from `low` to `high`, in cube edges. `rings`: [height, radius] of circles around the upright line
  // through it that hold all there is.
  constructor(low, high, rings) {
    this.centre = low.map((v, i) => (v + high[i]) / 2);
    this.rings = rings.map(([level, radius]) => [level - this.centre[2], radius]);
    this.shift = [0, 0];
    this.reset();
    this.fit([0, 0], [1, 1]);
  }

  reset() {
    [this.turn, this.tilt, this.near, this.target] = [FIRST.turn, FIRST.tilt, 1, [...this.centre]];
  }

  // The first view just fills, from wherever one turns to, a part of the picture that is free: its middle and its half width and
  // height, in halves of the picture's height, up and to the right of the picture's middle.
  fit(middle, half) {
    const [st, ct] = [Math.sin(FIRST.tilt), Math.cos(FIRST.tilt)];
    this.shift = middle;
    this.fitted = 0;
    for (const [rise, radius] of this.rings) {
      for (let k = 0; k < 32; k++) {
        const [beside, away] = [radius * Math.sin(k * Math.PI / 16), radius * Math.cos(k * Math.PI / 16)];
        const [x, y, ahead] = [Math.abs(beside), Math.abs(rise * ct + away * st), away * ct - rise * st];
        this.fitted = Math.max(this.fitted, x / (HALF * half[0]) - ahead, y / (HALF * half[1]) - ahead);
      }
    }
    this.fitted *= 1.04;
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
    return this.near * this.fitted;
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
    return { eye, ahead, right: right.map((v) => v * HALF), up: up.map((v) => v * HALF), shift: this.shift };
  }

  // The depth whose voxels are as large as a pixel of a picture `height` pixels high.
  depth(height) {
    return Math.round(Math.log2(height / (2 * HALF * this.distance)));
  }
}

// What keys are for that are pressed in it.
const CONTROLS = "input, select, textarea, button, summary";

// Calls `moved` after each change. `own`: keys that do something else. Keys count wherever they are pressed but in a control.
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
    // Keys are for the picture again.
    document.activeElement?.blur();
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
  window.addEventListener("keydown", (e) => {
    const key = e.key.length === 1 ? e.key.toLowerCase() : e.key;
    if (!keys[key] || e.ctrlKey || e.metaKey || e.altKey || e.target.closest?.(CONTROLS)) return;
    e.preventDefault();
    keys[key]();
    moved();
  });
}
