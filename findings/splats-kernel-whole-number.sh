#!/usr/bin/env bash
# The kernel2DSize of gaussian-splats-3d, the viewer of Gaussian splats on three.js.
#
# One would guess: kernel2DSize is a number in pixels², added to the variance of each splat in the picture. 0 shows splats as they
#   are, 1 makes them wider than the default of 0.3.
# What happens: the number is put into the shader's text as JavaScript prints it. "+= 0" adds an int to a float, which GLSL ES does
#   not have, so that with any whole number the shader does not compile: the viewer throws nothing, counts splats as rendered, and
#   its picture is empty. 0.000001 does what 0 should.
# Why it matters: whoever measures splats without the usual dilation compares black pictures, whose error may well pass for one.
# Versions: @mkkellogg/gaussian-splats-3d 0.4.7, three 0.180.0, Debian's chromium (CHROMIUM=path takes another browser).
# Written on 2026-11-30.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm install --silent --no-audit --no-fund --ignore-scripts --prefix . @mkkellogg/gaussian-splats-3d@0.4.7 three@0.180.0 playwright-core@1.64.1

cat > run.mjs <<'JAVASCRIPT'
import { createServer } from "node:http";
import { readFile } from "node:fs/promises";
import { join } from "node:path";
import { chromium } from "playwright-core";

// 27 white, opaque, round splats of deviation 0.3 around the origin.
const names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
const splat = (k) => [k % 3 - 1, Math.floor(k / 3) % 3 - 1, Math.floor(k / 9) - 1, 1.7, 1.7, 1.7, 8, ...Array(3).fill(Math.log(0.3)), 1, 0, 0, 0];
const values = Array.from({ length: 27 }, (_, k) => splat(k)).flat();
const head = `ply\nformat binary_little_endian 1.0\nelement vertex 27\n${names.map((n) => `property float ${n}\n`).join("")}end_header\n`;
const ply = Buffer.concat([Buffer.from(head), Buffer.from(new Float32Array(values).buffer)]);
const page = `<!doctype html><div id="root"></div>
<script type="importmap">{ "imports": { "three": "/three/build/three.module.js" } }</script>
<script type="module">
import * as THREE from "three";
import * as Splats from "/@mkkellogg/gaussian-splats-3d/build/gaussian-splats-3d.module.js";
window.show = async (kernel2DSize) => {
  const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
  renderer.setSize(64, 64);
  const camera = new THREE.PerspectiveCamera(50, 1, 0.1, 100);
  camera.position.set(0, 0, -6);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld(true);
  const viewer = new Splats.Viewer({ camera, renderer, rootElement: document.getElementById("root"), selfDrivenMode: false,
    useBuiltInControls: false, sharedMemoryForWorkers: false, sphericalHarmonicsDegree: 0, kernel2DSize,
    sceneRevealMode: Splats.SceneRevealMode.Instant });
  await viewer.addSplatScene("/splats.ply", { showLoadingUI: false, progressiveLoad: false });
  // Splats are sorted by a worker: some pictures more than that takes.
  for (let k = 0; k < 20; k++) {
    viewer.update();
    await viewer.sortPromise;
    await new Promise((done) => setTimeout(done, 100));
    viewer.render();
  }
  viewer.update();
  viewer.render();
  return viewer.splatRenderCount;
};
window.ready = true;
</script>`;
const server = createServer(async (request, answer) => {
  const path = new URL(request.url, "http://x").pathname;
  if (path === "/") return answer.writeHead(200, { "Content-Type": "text/html" }).end(page);
  if (path === "/splats.ply") return answer.writeHead(200).end(ply);
  try {
    const text = await readFile(join("node_modules", path));
    return answer.writeHead(200, { "Content-Type": "text/javascript" }).end(text);
  } catch {
    return answer.writeHead(404).end();
  }
}).listen(0, "127.0.0.1");
await new Promise((done) => server.on("listening", done));
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"] });
for (const kernel of [0, 1e-6, 0.3, 1, 1.5]) {
  const tab = await browser.newPage(), said = new Set();
  tab.setDefaultTimeout(300_000);
  tab.on("console", (message) => {
    const found = message.text().match(/ERROR: [\d:]+ ('assign' : [\w '-]*)/);
    if (found) said.add(found[1]);
  });
  await tab.goto(`http://127.0.0.1:${server.address().port}/`);
  await tab.waitForFunction(() => window.ready);
  const counted = await tab.evaluate((kernel) => window.show(kernel), kernel);
  console.log(`kernel2DSize ${kernel}: ${counted} splats counted as rendered, the shader ${said.size ? "does not compile:" : "compiles"}`, ...said);
  await tab.close();
}
await browser.close();
server.close();
JAVASCRIPT
node run.mjs > seen

cat > expected <<'EXPECTED'
kernel2DSize 0: 27 splats counted as rendered, the shader does not compile: 'assign' : cannot convert from 'const int' to 'highp float'
kernel2DSize 0.000001: 27 splats counted as rendered, the shader compiles
kernel2DSize 0.3: 27 splats counted as rendered, the shader compiles
kernel2DSize 1: 27 splats counted as rendered, the shader does not compile: 'assign' : cannot convert from 'const int' to 'highp float'
kernel2DSize 1.5: 27 splats counted as rendered, the shader compiles
EXPECTED

echo "@mkkellogg/gaussian-splats-3d 0.4.7, three 0.180.0, $("${CHROMIUM:-/usr/bin/chromium}" --version 2> /dev/null)"
cat seen
if ! diff expected seen; then
    echo "CHANGED: the behaviour is no longer what this finding says" >&2
    exit 1
fi
echo "UNCHANGED"
