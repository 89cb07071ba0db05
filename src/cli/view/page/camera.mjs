// A camera that turns around a place, or walks. Metres, +Y up.

const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);

// Steepest look up or down, radians.
const STEEPEST = 1.55;
// How far the head turns, against a turn around what is seen.
const PACE = 0.25;

// How far the exposure goes from the first one, stops.
export const MOST_STOPS = 8;

export class Camera {
  // `first`: {eye, target, fov, exposure}, fov in degrees, exposure in stops; `radius`: half of the scene's extent.
  constructor(first, radius) {
    this.first = first;
    this.radius = radius;
    this.mode = "orbit";
    this.reset();
  }

  reset() {
    this.fov = this.first.fov;
    this.exposure = this.first.exposure;
    this.look(this.first.eye, this.first.target);
  }

  // Stand at `eye` and look at `target`.
  look(eye, target) {
    const ahead = add(target, eye, -1);
    this.eye = [...eye];
    this.distance = Math.max(length(ahead), 1e-6 * this.radius);
    this.turn = Math.atan2(ahead[0], -ahead[2]);
    this.tilt = clamp(Math.asin(clamp(ahead[1] / (length(ahead) || 1), -1, 1)), -STEEPEST, STEEPEST);
  }

  get ahead() {
    const [st, ct, sy, cy] = [Math.sin(this.tilt), Math.cos(this.tilt), Math.sin(this.turn), Math.cos(this.turn)];
    return [sy * ct, st, -cy * ct];
  }

  get right() {
    return [Math.cos(this.turn), 0, Math.sin(this.turn)];
  }

  get target() {
    return add(this.eye, this.ahead, this.distance);
  }

  expose(stops) {
    this.exposure = clamp(this.exposure + stops, this.first.exposure - MOST_STOPS, this.first.exposure + MOST_STOPS);
  }

  // Around the target, or of the head: what is seen follows the hand in both.
  orbit(dx, dy) {
    const { target } = this, around = this.mode === "orbit";
    this.turn += around ? dx : -PACE * dx;
    this.tilt = clamp(this.tilt + (around ? -dy : PACE * dy), -STEEPEST, STEEPEST);
    if (around) this.eye = add(target, this.ahead, -this.distance);
  }

  zoom(factor) {
    const { target } = this, before = this.distance;
    if (this.mode === "walk") {
      this.eye = add(this.eye, this.ahead, before * (1 - factor));
      return;
    }
    this.distance = clamp(before * factor, 1e-5 * this.radius, 50 * this.radius);
    this.eye = add(target, this.ahead, -this.distance);
  }

  // By shares of the picture's height.
  pan(dx, dy) {
    const scale = 2 * Math.tan(this.fov * Math.PI / 360) * this.distance, up = cross(this.right, this.ahead);
    this.eye = add(add(this.eye, this.right, -dx * scale), up, dy * scale);
  }

  // Ahead on the level, to the right, and up, in twentieths of the distance to what is looked at.
  walk(ahead, right, up) {
    const step = this.distance / 20, level = [Math.sin(this.turn), 0, -Math.cos(this.turn)];
    this.eye = add(add(add(this.eye, level, ahead * step), this.right, right * step), [0, 1, 0], up * step);
  }

  // Turn around another point from now on, without a jump of the view: the point comes to the middle.
  around(point) {
    this.look(this.eye, point);
  }

  // As the command line has it: seven digits place a pixel.
  words() {
    const short = (x) => String(Number(x.toPrecision(7)));
    return { eye: this.eye.map(short).join(","), target: this.target.map(short).join(","), fov: short(this.fov) };
  }
}
