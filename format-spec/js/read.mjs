// node read.mjs [--check] FILE: the decoded content as plain text, or the code of the rule that the file breaks (exit 1).
import { readFileSync } from "node:fs";
import { Broken, Texel } from "./vtex.mjs";

const check = process.argv[2] === "--check";
try {
  const texel = new Texel(new Uint8Array(readFileSync(process.argv[check ? 3 : 2])));
  texel.verify();
  if (!check) process.stdout.write(texel.text());
} catch (error) {
  if (!(error instanceof Broken)) throw error;
  console.log(error.message);
  process.exitCode = 1;
}
