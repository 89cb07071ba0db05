// The page: decodes the texel coarse first, draws it while the view moves, and finer when it rests.
import { Texel } from "./vtex.mjs";
import { Positions, bricks, extent, luminance } from "./octree.mjs";
import { Picture } from "./picture.mjs";
import { Orbit, listen } from "./view.mjs";

const MOST_BYTES = 400 * 2 ** 20; // of the graphics memory, for one depth
// The depth of the first picture: soon decoded, and fine enough to see what it is.
const FIRST_DEPTH = 4;
// Light is what foliage of this luminance looks well in; more for darker matter and less for brighter, though not wholly.
const FOLIAGE = 0.136;
const CHANNELS = ["shaded", "albedo", "normal", "opacity", "materials"];
// Stops by which a key changes the exposure.
const STOPS = 0.25;
const $ = (id) => document.getElementById(id);

function bytesOf(base64) {
  const text = atob(base64), out = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) out[i] = text.charCodeAt(i);
  return out;
}

const signed = (x) => (x > 0 ? `+${x}` : String(x));
const digits = (x) => Number(x.toPrecision(4)).toString();

function row(list, name, value) {
  const term = document.createElement("dt"), text = document.createElement("dd");
  term.textContent = name;
  text.textContent = value;
  list.append(term, text);
}

function describe(texel) {
  const { meta, depths, bounds, metres } = texel, list = $("figures");
  const voxels = depths.reduce((sum, d) => sum + d.n, 0);
  row(list, "resolution", `${2 ** (depths.length - 1)}³`);
  row(list, "voxels", voxels.toLocaleString("en"));
  row(list, "file", `${(texel.length / 1024).toLocaleString("en", { maximumFractionDigits: 0 })} kB`);
  row(list, metres ? "cube's edge, m" : "cube's edge", digits((bounds[3] - bounds[0]) * (metres || 1)));
  row(list, "model", meta.model);
  if (meta.error?.opacity?.mean !== undefined) row(list, "error of opacity", digits(meta.error.opacity.mean));
  const materials = meta.materials ?? [];
  materials.slice(0, 64).forEach((material, i) => {
    const item = document.createElement("li"), patch = document.createElement("span");
    patch.className = "patch";
    patch.style.background = css(colours(materials)[i]);
    item.append(patch, `${material.name}, ${digits(100 * material.share)} %`);
    $("materials").append(item);
  });
}

const css = (rgb) => `rgb(${rgb.map((v) => Math.round(255 * Math.sqrt(v))).join(" ")})`;

// Colours that tell materials apart: hues by the golden ratio.
function colours(materials) {
  return materials.map((_, i) => [0, 1, 2].map((k) => (0.5 + 0.45 * Math.cos(2 * Math.PI * (i * 0.618 + k / 3))) ** 2));
}

function start() {
  const texel = new Texel(bytesOf($("data").textContent.trim()));
  $("data").remove();
  describe(texel);
  const canvas = $("picture"), picture = Picture.on(canvas);
  if (!picture) throw new Error("This browser has no WebGL2, which is needed to draw the texel. Its figures are on the left.");
  const positions = new Positions(texel), finest = texel.depths.length - 1, first = Math.min(FIRST_DEPTH, finest);
  const { low: min, high: max, rings } = extent(positions, first);
  const orbit = new Orbit(min, max, rings), palette = new Float32Array(192);
  colours(texel.meta.materials ?? []).slice(0, 64).forEach((c, i) => palette.set(c, 3 * i));
  const exposure = Math.min(3, (FOLIAGE / Math.max(luminance(texel), 1e-3)) ** 0.7);
  let shown = -1, largest = finest, busy = false, timer = 0, speed = 0.5;
  window.texelView = { orbit, pictures: 0, get depth() { return shown; }, get time() { return speed; } };

  const show = (depth) => {
    if (depth === shown) return;
    try {
      picture.load(bricks(texel, positions, depth, MOST_BYTES));
      shown = depth;
    } catch (error) {
      if (!(error instanceof RangeError)) throw error;
      largest = depth - 1;
      show(largest);
    }
  };
  const wanted = () => {
    const chosen = Number($("depth").value);
    return Math.max(0, Math.min(chosen > finest ? orbit.depth(canvas.clientHeight * devicePixelRatio) : chosen, largest, finest));
  };
  const draw = (scale, samples) => {
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * scale));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * scale));
    const [azimuth, height] = [$("azimuth").value, $("height").value].map((v) => v * Math.PI / 180);
    const sun = [Math.sin(azimuth) * Math.cos(height), -Math.cos(azimuth) * Math.cos(height), Math.sin(height)];
    const [low, high] = [[...min], [...max]], axis = Number($("axis").value), at = Number($("slice").value);
    if (axis < 3) high[axis] = low[axis] + at * (high[axis] - low[axis]);
    const channel = CHANNELS.indexOf($("channel").value), isotropic = texel.meta.model === "neyret";
    const began = performance.now();
    picture.draw({ ...orbit.shader(), sun, low, high, channel, samples, isotropic, palette, exposure: exposure * 2 ** $("exposure").value });
    window.texelView.pictures += 1;
    return performance.now() - began;
  };
  // Coarse while it moves: as many pixels as a twelfth of a second allows.
  const moved = () => {
    if (busy) return;
    busy = true;
    requestAnimationFrame(() => {
      busy = false;
      const took = draw(speed, 1);
      speed = Math.min(devicePixelRatio, Math.max(0.12, speed * Math.sqrt(Math.min(4, 80 / Math.max(took, 5)))));
      clearTimeout(timer);
      timer = setTimeout(rest, 150);
    });
  };
  const rest = () => {
    const depth = wanted();
    const next = shown < depth ? shown + 1 : depth;
    show(next);
    const last = shown === Math.min(depth, largest);
    $("state").textContent = `depth ${shown}, ${2 ** shown}³`;
    draw(last ? devicePixelRatio : speed, last ? 4 : 1);
    document.body.dataset.state = last ? "rest" : "finer";
    if (!last) timer = setTimeout(rest, 0);
  };
  $("depth").max = String(finest + 1);
  $("depth").value = String(finest + 1);
  const told = () => {
    const chosen = Number($("depth").value);
    $("depth-value").textContent = chosen > finest ? "auto" : `${2 ** chosen}³`;
    for (const id of ["azimuth", "height"]) $(`${id}-value`).textContent = `${$(id).value}°`;
    $("exposure-value").textContent = signed($("exposure").value);
    $("slice").disabled = $("axis").value === "3";
    // What is not lit has neither a sun nor an exposure.
    for (const id of ["azimuth", "height", "exposure"]) $(id).disabled = $("channel").value !== "shaded";
  };
  told();
  for (const id of ["depth", "channel", "azimuth", "height", "exposure", "axis", "slice"]) {
    $(id).addEventListener("input", () => {
      document.body.dataset.state = "moved";
      told();
      moved();
    });
  }
  if (!texel.streams.some((s) => s.semantic === "MATL")) $("channel").querySelector("[value=materials]").remove();
  const expose = (stops) => () => {
    $("exposure").value = Number($("exposure").value) + stops;
    told();
  };
  listen(canvas, orbit, () => {
    document.body.dataset.state = "moved";
    moved();
  }, { ",": expose(-STOPS), ".": expose(STOPS) });
  // The texel stands in the part of the window that an open panel leaves free: beside it, or above it on a narrow screen.
  const fit = () => {
    const [width, height] = [Math.max(1, canvas.clientWidth), Math.max(1, canvas.clientHeight)];
    const panel = document.querySelector("aside").getBoundingClientRect(), narrow = panel.width > width / 2;
    const left = narrow || !$("panel").open ? 0 : panel.right, bottom = narrow ? panel.top : height;
    orbit.fit([left / height, 1 - bottom / height], [(width - left) / height, bottom / height].map((v) => Math.max(v, 0.1)));
    document.body.dataset.state = "moved";
    moved();
  };
  if (matchMedia("(max-width: 600px)").matches) $("panel").open = false;
  show(first);
  fit();
  $("panel").addEventListener("toggle", fit);
  new ResizeObserver(fit).observe(canvas);
}

try {
  start();
} catch (error) {
  $("failure").textContent = error.message;
  $("failure").hidden = false;
  document.body.dataset.state = "failed";
}
