// Clicks, drags, touches and types on the pages, and looks at what they draw.
// view.mjs VTEX TEXEL LANDSCAPE FOLDER CHROMIUM
import assert from "node:assert/strict";
import { spawn, execFileSync } from "node:child_process";
import { copyFileSync, mkdirSync, statSync, writeFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { chromium } from "playwright-core";

const [vtex, texel, landscape, folder, executablePath] = process.argv.slice(2).map((path) => resolve(path));
const SLOW = 1000 * Number(process.env.PATIENCE ?? 600); // milliseconds, for programs that were not optimised
// Wide enough for the panel to stand at the side.
const [width, height] = (process.env.SIZE ?? "640x300").split("x").map(Number);
const PHONE = { hasTouch: true, isMobile: true, viewport: { width: 240, height: 400 } };
const MIDDLE = [width * 0.6, height / 2];

const browser = await chromium.launch({
  executablePath,
  args: ["--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
});
console.log(`Chromium ${browser.version()}`);

// A page, and what went wrong on it or was asked of others.
async function open(url, options = {}) {
  const context = await browser.newContext({ viewport: { width, height }, ...options });
  const page = await context.newPage(), wrong = [], asked = [];
  page.setDefaultTimeout(SLOW);
  page.on("pageerror", (error) => wrong.push(error.message));
  page.on("console", (message) => {
    const { url } = message.location();
    if (message.type() === "error" && !url.endsWith("/favicon.ico")) wrong.push(message.text());
  });
  page.on("request", (request) => asked.push(request.url()));
  // When the texel's page has drawn its first picture: a poll from outside waits until the page has nothing to do.
  await page.addInitScript(() => {
    Object.defineProperty(window, "texelView", {
      get() { return this.kept; },
      set(view) {
        let pictures = 0;
        Object.defineProperty(view, "pictures", {
          get: () => pictures,
          set(count) {
            pictures = count;
            window.firstPicture ??= performance.now();
          },
        });
        this.kept = view;
      },
    });
  });
  await page.goto(url);
  return { page, context, wrong, asked };
}

const rested = (page) => page.waitForFunction(() => document.body.dataset.state === "rest");
// What the canvas shows, as text that differs where the picture does.
const seen = (page) => page.evaluate(() => document.querySelector("canvas").toDataURL());

async function changes(page, what, act) {
  const count = () => (window.texelView ?? window.landscapeView).pictures;
  const [before, made] = [await seen(page), await page.evaluate(count)];
  await act();
  await page.waitForFunction((made) => (window.texelView ?? window.landscapeView).pictures > made, made);
  await rested(page);
  // Not `notEqual`, which would print both.
  assert.ok(await seen(page) !== before, `${what} changes the picture`);
}

async function drag(page, [x, y], [dx, dy], steps = 5) {
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + dx, y + dy, { steps });
  await page.mouse.up();
}

// Fingers that go from some places to others.
async function touch(page, from, to, steps = 4) {
  const client = await page.context().newCDPSession(page);
  const points = (k) => from.map(([x, y], i) => ({ x: x + (to[i][0] - x) * k / steps, y: y + (to[i][1] - y) * k / steps, id: i }));
  await client.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: points(0) });
  for (let k = 1; k <= steps; k++) await client.send("Input.dispatchTouchEvent", { type: "touchMove", touchPoints: points(k) });
  await client.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
}

// Pictures a second while the hand moves.
async function rate(page, view) {
  const count = () => page.evaluate((view) => window[view].pictures, view);
  const [before, began] = [await count(), Date.now()];
  await page.mouse.move(...MIDDLE);
  await page.mouse.down();
  for (let k = 0; Date.now() - began < 3000; k++) await page.mouse.move(MIDDLE[0] + 80 * Math.sin(k / 9), MIDDLE[1]);
  const pictures = (await count() - before) / ((Date.now() - began) / 1000);
  await page.mouse.up();
  await rested(page);
  return pictures.toFixed(1);
}

async function texelPage(name, url) {
  const { page, context, wrong, asked } = await open(url);
  await page.waitForFunction(() => window.texelView?.pictures > 0 || document.body.dataset.state === "failed");
  const first = await page.evaluate(() => window.firstPicture);
  await rested(page);
  const whole = await page.evaluate(() => performance.now());
  await page.screenshot({ path: join(folder, `${name}.png`) });
  const view = (what) => page.evaluate((what) => what.split(".").reduce((v, k) => v[k], window.texelView), what);

  const [turn, near] = [await view("orbit.turn"), await view("orbit.near")];
  await changes(page, "a drag", () => drag(page, MIDDLE, [60, 20]));
  assert.ok(Math.abs(await view("orbit.turn") - turn) > 0.1);
  await changes(page, "the wheel", () => page.mouse.wheel(0, 240));
  assert.ok(await view("orbit.near") > near);
  // Keys are for the picture wherever one is on the page, but in a control.
  for (const key of ["ArrowLeft", "+", "w"]) await changes(page, key, () => page.keyboard.press(key));
  await page.focus("canvas");
  await changes(page, "ArrowUp", () => page.keyboard.press("ArrowUp"));
  const stands = await view("orbit.turn");
  await page.focus("#azimuth");
  await changes(page, "an arrow key on a control", () => page.keyboard.press("ArrowRight"));
  assert.equal(await view("orbit.turn"), stands);
  await page.locator("#azimuth").fill("-35");
  await page.focus("summary");
  await changes(page, "a panel that is folded", () => page.keyboard.press("Enter"));
  await changes(page, "a panel that is opened", () => page.keyboard.press("Enter"));
  await page.focus("canvas");
  await changes(page, "0", () => page.keyboard.press("0"));
  assert.equal(await view("orbit.turn"), turn);

  const channels = await page.locator("#channel option").evaluateAll((list) => list.map((o) => o.value));
  assert.ok(channels.length >= 4);
  const pictures = new Set([await seen(page)]);
  for (const channel of channels.slice(1)) {
    await page.selectOption("#channel", channel);
    await page.waitForFunction(() => document.body.dataset.state === "rest");
    pictures.add(await seen(page));
    await page.screenshot({ path: join(folder, `${name}-${channel}.png`) });
  }
  assert.equal(pictures.size, channels.length, "each channel has a picture of its own");
  await page.selectOption("#channel", "shaded");
  await rested(page);
  for (const axis of ["0", "1", "2"]) {
    await changes(page, `a cut along ${axis}`, () => page.selectOption("#axis", axis));
  }
  await page.screenshot({ path: join(folder, `${name}-cut.png`) });
  await changes(page, "the cut's place", () => page.locator("#slice").fill("0.3"));
  await changes(page, "no cut", () => page.selectOption("#axis", "3"));
  await changes(page, "the exposure", () => page.locator("#exposure").fill("1.5"));
  assert.equal(await page.locator("#exposure-value").textContent(), "+1.5");
  await page.focus("canvas");
  await changes(page, "a full stop", () => page.keyboard.press("."));
  await changes(page, "a comma", () => page.keyboard.press(","));
  assert.equal(await page.locator("#exposure").inputValue(), "1.5");
  await page.locator("#exposure").fill("0");
  await page.selectOption("#channel", "albedo");
  assert.ok(await page.locator("#exposure").isDisabled(), "what is not lit has no exposure");
  await page.selectOption("#channel", "shaded");
  await rested(page);
  await changes(page, "the sun", () => page.locator("#azimuth").fill("60"));
  await changes(page, "depth 3", () => page.locator("#depth").fill("3"));
  assert.equal(await view("depth"), 3);
  await page.locator("#depth").fill(await page.locator("#depth").getAttribute("max"));
  await rested(page);
  const pace = await rate(page, "texelView");
  assert.deepEqual(wrong, []);
  assert.deepEqual(asked.filter((one) => one !== url && !one.endsWith("/favicon.ico")), [], "nothing else is loaded");
  console.log(`${name}: first picture after ${first.toFixed(0)} ms, at rest after ${whole.toFixed(0)} ms, ${pace} pictures a second`);
  await context.close();

  const phone = await open(url, PHONE);
  await rested(phone.page);
  const own = (what) => phone.page.evaluate((what) => window.texelView.orbit[what], what);
  const [angle, distance] = [await own("turn"), await own("near")];
  await changes(phone.page, "a finger", () => touch(phone.page, [[120, 60]], [[180, 60]]));
  assert.ok(Math.abs(await own("turn") - angle) > 0.1);
  await changes(phone.page, "two fingers", () => touch(phone.page, [[90, 60], [150, 60]], [[60, 60], [180, 60]]));
  assert.ok(await own("near") < distance, "fingers that part bring the texel nearer");
  await phone.page.screenshot({ path: join(folder, `${name}-phone.png`) });
  assert.deepEqual(phone.wrong, []);
  await phone.context.close();
}

// A server, and what it says.
async function serve(...words) {
  const server = spawn(vtex, ["view", ...words], { stdio: ["ignore", "pipe", "inherit"] });
  let text = "";
  for await (const part of server.stdout) {
    text += part;
    if (text.includes("\n")) break;
  }
  return { server, url: text.trim() };
}

async function stop(server) {
  const ended = new Promise((resolve) => server.on("exit", (code, signal) => resolve(signal ?? code)));
  server.kill("SIGINT");
  assert.equal(await ended, 130);
}

async function landscapePage() {
  const { server, url } = await serve(landscape, "-q", "--", "--sun", "40,220");
  const { page, context, wrong, asked } = await open(url, { permissions: ["clipboard-read", "clipboard-write"] });
  await page.waitForFunction(() => window.landscapeView?.first > 0);
  const first = await page.evaluate(() => performance.now());
  await page.screenshot({ path: join(folder, "landscape-first.png") });
  await rested(page);
  const whole = await page.evaluate(() => performance.now());
  await page.screenshot({ path: join(folder, "landscape.png") });
  const view = (what) => page.evaluate((what) => window.landscapeView.camera[what], what);

  // Without the command line, which names a folder of this run.
  await golden("landscape", url, SMALL, (page) => page.locator("#command").evaluate((line) => { line.value = "vtex render"; }));
  // The command line makes the very picture.
  const same = async (name) => {
    await page.click("#copy");
    const command = await page.evaluate(() => navigator.clipboard.readText());
    assert.equal(command, await page.locator("#command").inputValue());
    assert.match(command, /^vtex render .* --sun 40,220 --eye .* --look-at .* --fov \S+ (--exposure \S+ )?--size \d+x\d+ --lanes 4 -o view.png$/);
    const [shown, made] = [join(folder, `${name}-shown.png`), join(folder, `${name}-made.png`)];
    writeFileSync(shown, Buffer.from((await seen(page)).split(",")[1], "base64"));
    execFileSync("sh", ["-c", `${command.replace("vtex", `'${vtex}'`).replace("view.png", `'${made}'`)} -q`]);
    const { all } = JSON.parse(execFileSync(vtex, ["compare", shown, made, "--json"]));
    assert.equal(all.rmse, 0, `${name}: the command's picture is the page's`);
  };
  await same("landscape");

  const eye = await view("eye");
  await changes(page, "a drag", () => drag(page, MIDDLE, [40, 10]));
  assert.notDeepEqual(await view("eye"), eye, "a drag turns around what is seen");
  const target = await view("target");
  await changes(page, "the wheel", () => page.mouse.wheel(0, -200));
  (await view("target")).forEach((v, k) => assert.ok(Math.abs(v - target[k]) < 1e-6, "the wheel comes nearer to it"));
  await page.focus("canvas");
  for (const key of ["w", "a", "e", "ArrowLeft", "-"]) await changes(page, key, () => page.keyboard.press(key));
  await page.selectOption("#mode", "walk");
  const stands = await view("eye");
  await changes(page, "a turn of the head", () => drag(page, MIDDLE, [60, 0]));
  assert.deepEqual(await view("eye"), stands);
  await page.selectOption("#mode", "orbit");
  await changes(page, "a double click", () => page.mouse.dblclick(MIDDLE[0], height * 0.8));
  await changes(page, "the field of view", () => page.locator("#fov").fill("70"));
  // The exposure, by hand and by keys, is one of the command line.
  await changes(page, "the exposure", () => page.locator("#exposure").fill("1.5"));
  await page.focus("canvas");
  await changes(page, "a comma", () => page.keyboard.press(","));
  assert.match(await page.locator("#command").inputValue(), / --exposure 1.25 /);
  await same("landscape-moved");
  await page.screenshot({ path: join(folder, "landscape-moved.png") });
  const pace = await rate(page, "landscapeView");
  const soon = await page.evaluate(() => window.landscapeView.first);
  assert.deepEqual(wrong, []);
  assert.deepEqual(asked.filter((one) => !one.startsWith(url)), [], "nothing but this server is asked");
  console.log(`landscape: first picture after ${first.toFixed(0)} ms, at rest after ${whole.toFixed(0)} ms; while it moves ` +
    `${pace} tiles a second, a picture after ${soon.toFixed(0)} ms`);

  const phone = await open(url, PHONE);
  await rested(phone.page);
  const stood = await phone.page.evaluate(() => window.landscapeView.camera.eye);
  await changes(phone.page, "a finger", () => touch(phone.page, [[120, 60]], [[160, 60]]));
  assert.notDeepEqual(await phone.page.evaluate(() => window.landscapeView.camera.eye), stood);
  const apart = await phone.page.evaluate(() => window.landscapeView.camera.distance);
  await changes(phone.page, "two fingers", () => touch(phone.page, [[90, 60], [150, 60]], [[60, 60], [180, 60]]));
  assert.ok(await phone.page.evaluate(() => window.landscapeView.camera.distance) < apart);
  await phone.page.screenshot({ path: join(folder, "landscape-phone.png") });
  assert.deepEqual(phone.wrong, []);
  await phone.context.close();

  // Ctrl-C ends the server, and the page says so.
  await stop(server);
  await page.keyboard.press("0");
  await page.waitForFunction(() => !document.getElementById("failure").hidden);
  assert.match(await page.locator("#failure").textContent(), /start `vtex view` again/);
  await context.close();
}

// Mean FLIP up to which a page is the golden one. The same Chromium draws it again with 0.0000. A tree without the top tenth of
// its crown differs by 0.008, one that stands 2 pixels aside by 0.07, another channel by 0.45. Another Chromium that rounds powers and
// roots differently, or other fonts, may differ by more than this: look at both pictures then, and store the new ones.
const MOST_FLIP = 0.006;

// The page as a small picture, against the one in golden/.
async function golden(name, url, options = {}, prepare = async () => {}) {
  if (!process.env.GOLDEN) return;
  const { page, context } = await open(url, options);
  await rested(page);
  await prepare(page);
  await rested(page);
  const [seen, kept] = [join(folder, `golden-${name}.png`), join(process.env.GOLDEN, `${name}.png`)];
  await page.screenshot({ path: seen });
  await context.close();
  if (process.env.BLESS) {
    mkdirSync(process.env.GOLDEN, { recursive: true });
    copyFileSync(seen, kept);
  }
  const { all } = JSON.parse(execFileSync(vtex, ["compare", seen, kept, "--json", "-q"]));
  console.log(`${name}: FLIP ${all.flip.toFixed(4)} from the golden picture`);
  assert.ok(all.flip <= MOST_FLIP, `${seen} is ${kept}`);
}
// Half as many pixels as the page has, so that the panel stands at the side of a small picture.
const SMALL = { viewport: { width: 640, height: 400 }, deviceScaleFactor: 0.5 };

// ONLY=landscape leaves the texel out.
if (process.env.ONLY !== "landscape") {
  const page = join(folder, "texel.html");
  execFileSync(vtex, ["export", texel, "-o", page, "-q"]);
  console.log(`the page has ${statSync(page).size} bytes, ${statSync(page).size - Math.ceil(statSync(texel).size / 3) * 4} without its texel`);
  const file = pathToFileURL(page).href;
  await golden("texel", file, SMALL);
  await golden("texel-cut", file, SMALL, async (page) => {
    await page.selectOption("#channel", "normal");
    await page.selectOption("#axis", "1");
  });
  await golden("texel-phone", file, { ...PHONE, deviceScaleFactor: 0.5 });
  if (process.env.POST) {
    execFileSync(vtex, ["export", process.env.POST, "-o", join(folder, "post.html"), "-q"]);
    await golden("post", pathToFileURL(join(folder, "post.html")).href, SMALL, (page) => page.locator("#depth").fill("9"));
  }
  await texelPage("exported", file);
  const { server, url } = await serve(texel, "-q");
  await texelPage("viewed", url);
  await stop(server);
}
await landscapePage();
await browser.close();
console.log("all pages do what they say");
