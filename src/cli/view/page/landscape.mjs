// The page of a landscape: a camera that is moved, and pictures of what it sees.
import { Camera, MOST_STOPS } from "./camera.mjs";
import { Pictures } from "./pictures.mjs";
import { listen } from "./view.mjs";

const MOST_PIXELS = 4096; // a side, as the server has it
const STOPS = 0.25; // by which a key changes the exposure
const $ = (id) => document.getElementById(id);

function fail(text) {
  $("failure").textContent = text;
  $("failure").hidden = false;
  document.body.dataset.state = "failed";
}

async function start() {
  const about = await (await fetch("scene")).json(), canvas = $("picture");
  document.title = `${about.name} – vtex`;
  $("name").textContent = about.name;
  const camera = new Camera({ ...about.camera, exposure: about.exposure.stops }, about.radius);
  const pictures = new Pictures(canvas, ({ failure, step, lanes, done }) => {
    if (failure) {
      fail(failure);
      return;
    }
    $("failure").hidden = true;
    $("state").textContent = done ? "at rest" : step > 1 ? `coarse, 1/${step}` : `full size, ${lanes} ${lanes > 1 ? "lanes" : "lane"}`;
    document.body.dataset.state = done ? "rest" : "finer";
    window.landscapeView.pictures += 1;
  });
  window.landscapeView = { camera, pictures: 0, get first() { return pictures.first; } };
  const size = () => {
    const side = (css) => Math.min(MOST_PIXELS, Math.max(1, Math.round(css * devicePixelRatio)));
    return [side(canvas.clientWidth), side(canvas.clientHeight)];
  };
  // As `--exposure` takes it.
  const exposure = () => {
    const stops = Number(camera.exposure.toPrecision(7));
    if (!about.exposure.auto) return String(stops);
    return stops === 0 ? "auto" : `auto${stops > 0 ? "+" : ""}${stops}`;
  };
  const moved = () => {
    const words = { ...camera.words(), exposure: exposure() }, pixels = size();
    document.body.dataset.state = "moved";
    $("fov").value = camera.fov;
    $("fov-value").textContent = `${Math.round(camera.fov)}°`;
    $("exposure").value = camera.exposure;
    $("exposure-value").textContent = words.exposure;
    // Left out where it is what the command has without it.
    const exposed = about.exposure.said || camera.exposure !== about.exposure.stops ? `--exposure ${words.exposure} ` : "";
    $("command").value = `${about.command} --eye ${words.eye} --look-at ${words.target} --fov ${words.fov} ${exposed}` +
      `--size ${pixels.join("x")} --lanes ${about.lanes} -o view.png`;
    pictures.show({ ...words, size: pixels });
  };
  const walk = (...steps) => () => camera.walk(...steps);
  listen(canvas, camera, moved, {
    w: walk(1, 0, 0), s: walk(-1, 0, 0), a: walk(0, -1, 0), d: walk(0, 1, 0), e: walk(0, 0, 1), q: walk(0, 0, -1),
    ",": () => camera.expose(-STOPS), ".": () => camera.expose(STOPS),
  });
  canvas.addEventListener("dblclick", async (e) => {
    const pixels = size(), { eye, target, fov } = camera.words();
    const [x, y] = [e.offsetX, e.offsetY].map((v) => Math.floor(v * devicePixelRatio));
    const query = new URLSearchParams({ eye, target, fov, exposure: exposure(), size: pixels.join("x"), step: 1, x, y });
    const point = await (await fetch(`point?${query}`)).json();
    if (!point) return;
    camera.around(point);
    moved();
  });
  $("mode").addEventListener("input", () => { camera.mode = $("mode").value; });
  $("fov").addEventListener("input", () => {
    camera.fov = Number($("fov").value);
    moved();
  });
  $("exposure").min = about.exposure.stops - MOST_STOPS;
  $("exposure").max = about.exposure.stops + MOST_STOPS;
  $("exposure").addEventListener("input", () => {
    camera.exposure = Number($("exposure").value);
    moved();
  });
  $("copy").addEventListener("click", async () => {
    $("command").select();
    try {
      await navigator.clipboard.writeText($("command").value);
      $("state").textContent = "copied";
    } catch {
      $("state").textContent = "marked: copy it by the browser's own command";
    }
  });
  if (matchMedia("(max-width: 600px)").matches) $("panel").open = false;
  new ResizeObserver(moved).observe(canvas);
}

start().catch((error) => fail(error.message));
