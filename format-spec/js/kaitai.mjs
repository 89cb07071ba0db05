// node kaitai.mjs FORMAT-SPEC: compile vtex.ksy, read every vector with it, and compare what it refuses with rules.md.
// Run where kaitai-struct-compiler, kaitai-struct and js-yaml are installed (conformance.sh does).
import { readFileSync, readdirSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import compiler from "kaitai-struct-compiler";
import KaitaiStream from "kaitai-struct/KaitaiStream.js";
import * as yaml from "js-yaml";

const folder = process.argv[2], require = createRequire(join(process.cwd(), "kaitai.mjs"));
const files = await compiler.compile("javascript", yaml.load(readFileSync(join(folder, "vtex.ksy"), "utf8")), null, false);
for (const [name, text] of Object.entries(files)) writeFileSync(name.replace(".js", ".cjs"), text);
const { Vtex } = require("./Vtex.cjs");

const reads = (name) => {
  try {
    const bytes = readFileSync(join(folder, "vectors", name));
    const texel = new Vtex(new KaitaiStream(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length)));
    texel.sections.forEach((section) => section.body);
    return true;
  } catch {
    return false;
  }
};
const vectors = readdirSync(join(folder, "vectors")).filter((name) => name.endsWith(".vtex"));
vectors.sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
const refused = {};
let wrong = 0;
for (const name of vectors) {
  if (name.startsWith("ok-")) {
    if (!reads(name)) console.log(`WRONG: Kaitai refuses ${name}`), wrong++;
    continue;
  }
  const [, code, number] = /^bad-(.*)-(\d+)\.vtex$/.exec(name);
  refused[code] ??= [];
  if (!reads(name)) refused[code].push(number);
}
const rules = readFileSync(join(folder, "rules.md"), "utf8");
for (const [code, numbers] of Object.entries(refused)) {
  const row = rules.split("\n").find((line) => line.startsWith(`| \`${code}\` |`)) ?? "";
  const listed = row.split("|")[4]?.trim(), found = numbers.join(", ") || "–";
  if (listed !== found) console.log(`WRONG: rules.md says that Kaitai refuses "${listed}" of ${code}, it refuses "${found}"`), wrong++;
}
process.exitCode = wrong ? 1 : 0;
