// The textures and the program on a canvas; draws one picture for a view.
import { VERTEX, FRAGMENT } from "./shader.mjs";

export class Picture {
  // null where there is no WebGL2.
  static on(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    return gl && new Picture(gl);
  }

  constructor(gl) {
    this.gl = gl;
    this.most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    this.program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) {
      const logs = gl.getAttachedShaders(this.program).map((s) => gl.getShaderInfoLog(s)).join("\n");
      throw new Error(`${gl.getProgramInfoLog(this.program)}\n${logs}`);
    }
    gl.useProgram(this.program);
    this.textures = [0, 1, 2].map(() => gl.createTexture());
    ["index_", "atlas", "kinds"].forEach((name, i) => this.set(name, (at) => gl.uniform1i(at, i)));
  }

  set(name, put) {
    put(this.gl.getUniformLocation(this.program, name));
  }

  texture(unit, internal, format, type, side, data) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_3D, this.textures[unit]);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, filter, gl.NEAREST);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage3D(gl.TEXTURE_3D, 0, internal, side, side, side, 0, format, type, data);
  }

  // Show one depth, as `bricks` gives it.
  load(bricks) {
    const { gl } = this, edge = bricks.across * 8;
    this.texture(0, gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, bricks.cells, bricks.index);
    this.texture(1, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT, edge, new Uint32Array(bricks.atlas.buffer));
    const kinds = bricks.materials ?? new Uint8Array(1);
    this.texture(2, gl.R8UI, gl.RED_INTEGER, gl.UNSIGNED_BYTE, bricks.materials ? edge : 1, kinds);
    for (const name of ["cells", "across", "side"]) this.set(name, (at) => gl.uniform1i(at, bricks[name]));
    this.set("mixed", (at) => gl.uniform1i(at, bricks.materials ? 1 : 0));
  }

  // `view`: {eye, right, up, ahead, sun, low, high} in cube edges, {shift} in halves of the height, {channel, samples, isotropic, palette, exposure}.
  draw(view) {
    const { gl } = this, { width, height } = gl.canvas;
    gl.viewport(0, 0, width, height);
    this.set("size", (at) => gl.uniform2f(at, width, height));
    this.set("shift", (at) => gl.uniform2f(at, ...view.shift));
    for (const name of ["eye", "right", "up", "ahead", "sun", "low", "high"]) this.set(name, (at) => gl.uniform3fv(at, view[name]));
    for (const name of ["channel", "samples", "isotropic"]) this.set(name, (at) => gl.uniform1i(at, Number(view[name])));
    this.set("exposure", (at) => gl.uniform1f(at, view.exposure));
    this.set("palette", (at) => gl.uniform3fv(at, view.palette));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.finish();
  }
}
