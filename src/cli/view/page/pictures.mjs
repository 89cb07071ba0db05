// Asks the server for pictures of a camera and draws their tiles as they arrive.

// A record's head, bytes; `landscape.rs` says what is in it.
const HEAD = 16;
const [TILE, END, FAILURE] = [1, 2, 3];
// The first, coarsest picture of a camera is to be there after so many milliseconds.
const SOON = 80;

export class Pictures {
  // `told` is called with {step, lanes, size, done} after each tile, or with {failure}.
  constructor(canvas, told) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.part = document.createElement("canvas");
    this.told = told;
    this.step = 16;
    this.next = null;
    this.first = 0;
  }

  // Show what `camera` sees: its words, and the picture's size. What is on its way is given up once it has shown something.
  show(camera) {
    this.next = camera;
    if (this.running && !this.shown) return;
    if (this.running) this.running.abort();
    else this.run();
  }

  async run() {
    while (this.next) {
      const camera = this.next;
      this.next = null;
      this.running = new AbortController();
      this.shown = false;
      try {
        await this.picture(camera, this.running.signal);
      } catch (error) {
        if (error.name !== "AbortError") {
          this.told({ failure: error.name === "TypeError" ? "the server has ended: start `vtex view` again" : error.message });
        }
      }
      this.running = null;
    }
  }

  async picture({ eye, target, fov, exposure, size }, signal) {
    const query = new URLSearchParams({ eye, target, fov, exposure, size: size.join("x"), step: this.step });
    const began = performance.now(), answer = await fetch(`picture?${query}`, { signal });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    const reader = answer.body.getReader();
    let kept = new Uint8Array(0), drawn = 0;
    for (;;) {
      const { value, done } = await reader.read();
      if (done) throw new Error("the picture broke off");
      const bytes = new Uint8Array(kept.length + value.length);
      bytes.set(kept);
      bytes.set(value, kept.length);
      let at = 0;
      while (bytes.length - at >= HEAD) {
        const head = new Uint16Array(bytes.slice(at, at + HEAD).buffer), [kind, lanes, width, height, x, y, w, h] = head;
        const length = kind === TILE ? 3 * w * h : kind === FAILURE ? w + 65536 * h : 0;
        if (bytes.length - at < HEAD + length) break;
        const body = bytes.subarray(at + HEAD, at + HEAD + length);
        at += HEAD + length;
        if (kind === END) {
          this.told({ step: 1, lanes: 0, done: true });
          return;
        }
        if (kind === FAILURE) throw new Error(new TextDecoder().decode(body));
        this.draw(size, { width, height, x, y, w, h }, body);
        // The sum over a picture's tiles tells when it is whole.
        drawn = x === 0 && y === 0 && w === width && h === height ? w * h : drawn + w * h;
        const whole = drawn >= width * height;
        if (whole) drawn = 0;
        this.told({ step: Math.round(size[0] / width), lanes, whole });
        if (whole && !this.shown) {
          this.shown = true;
          this.pace(performance.now() - began);
          if (this.next) {
            this.running.abort();
            return;
          }
        }
      }
      kept = bytes.slice(at);
    }
  }

  // Finer first pictures where they come soon, coarser ones where they do not.
  pace(took) {
    this.first = took;
    if (took > 1.5 * SOON && this.step < 64) this.step *= 2;
    else if (took < 0.3 * SOON && this.step > 2) this.step /= 2;
  }

  draw(size, { width, height, x, y, w, h }, rgb) {
    const { canvas, context, part } = this;
    if (canvas.width !== size[0] || canvas.height !== size[1]) {
      // What was seen stays until there is better.
      const before = document.createElement("canvas");
      [before.width, before.height] = [Math.max(1, canvas.width), Math.max(1, canvas.height)];
      before.getContext("2d").drawImage(canvas, 0, 0);
      [canvas.width, canvas.height] = size;
      context.drawImage(before, 0, 0, ...size);
    }
    const image = new ImageData(w, h);
    for (let i = 0, j = 0; i < rgb.length; i += 3, j += 4) {
      image.data[j] = rgb[i];
      image.data[j + 1] = rgb[i + 1];
      image.data[j + 2] = rgb[i + 2];
      image.data[j + 3] = 255;
    }
    [part.width, part.height] = [w, h];
    part.getContext("2d").putImageData(image, 0, 0);
    const [sx, sy] = [size[0] / width, size[1] / height];
    context.imageSmoothingEnabled = sx > 1;
    context.drawImage(part, x * sx, y * sy, w * sx, h * sy);
  }
}
