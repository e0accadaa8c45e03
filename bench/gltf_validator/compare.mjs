// SPDX-License-Identifier: Apache-2.0
// node compare.mjs GLTF_CONFORMANCE FOLDER OUT [--mutants N]: the Khronos validator (npm install gltf-validator beside OUT or
// here) and Gobo's loader over every model below FOLDER and over mutants of the valid ones; prints the table by validator code.
import fs from 'node:fs';
import path from 'node:path';
import {createRequire} from 'node:module';
import {execFileSync} from 'node:child_process';
import {asText, modelsBelow, selfContained} from './files.mjs';
import {containerMutants, dataMutants, jsonMutants} from './mutants.mjs';

const [program, folder, out] = process.argv.slice(2), flag = process.argv.indexOf('--mutants');
const most = flag > 0 ? Number(process.argv[flag + 1]) : 6000;
if (!out) { console.error('usage: compare.mjs GLTF_CONFORMANCE FOLDER OUT [--mutants N]'); process.exit(2); }
fs.mkdirSync(path.join(out, 'mutants'), {recursive: true});
const validator = createRequire(path.resolve(out) + '/')('gltf-validator');

async function verdict(file) {
  const bytes = fs.readFileSync(file), options = {
    uri: path.basename(file), maxIssues: 500, writeTimestamp: false,
    externalResourceFunction: async (uri) => new Uint8Array(fs.readFileSync(path.resolve(path.dirname(file), decodeURIComponent(uri)))),
  };
  if (file.endsWith('.gltf')) options.format = 'gltf';
  if (file.endsWith('.glb')) options.format = 'glb';
  try {
    const report = await validator.validateBytes(new Uint8Array(bytes), options);
    return report.issues.messages.filter((m) => m.severity === 0).map((m) => ({code: m.code, pointer: m.pointer ?? '', message: m.message}));
  } catch (e) {
    return [{code: 'NOT_READ', pointer: '', message: String(e)}];
  }
}

/** One place lies inside the other. */
function related(a, b) {
  const [s, l] = a.length < b.length ? [a, b] : [b, a];
  return l.startsWith(s) && (l.length === s.length || l[s.length] === '/' || s === '');
}

const models = modelsBelow(folder), files = [], errors = new Map();
for (const file of models) { errors.set(file, await verdict(file)); files.push({file, name: path.relative(folder, file)}); }
const taken = new Set();
let bases = 0;
const own = [path.join(out, 'bases')].filter((d) => fs.existsSync(d)).flatMap(modelsBelow);
for (const file of [...own, ...models]) {
  if (own.includes(file)) errors.set(file, await verdict(file));
  if (errors.get(file).length || fs.statSync(file).size > 300000) continue;
  let base;
  try { base = selfContained(file); } catch { continue; }
  if (base.buffers.some((b) => b === null) || asText(base).length > 300000) continue;
  let made = 0;
  const keep = (m) => {
    if (files.length - models.length >= most) return;
    const to = path.join(out, 'mutants', `${files.length}.${m.ext ?? 'gltf'}`);
    fs.writeFileSync(to, m.bytes ?? m.text);
    files.push({file: to, name: `${m.name} (${path.relative(folder, file)})`});
    ++made;
  };
  if (!taken.has('container') && base.buffers.length === 1) { taken.add('container'); for (const m of containerMutants(base)) keep(m); }
  for (const m of jsonMutants(base, taken)) keep(m);
  for (const m of dataMutants(base, taken)) keep(m);
  bases += made > 0;
}
for (const {file} of files) if (!errors.has(file)) errors.set(file, await verdict(file));

fs.writeFileSync(path.join(out, 'list.txt'), files.map((f) => f.file).join('\n') + '\n');
const lines = execFileSync(program, ['--verdicts', path.join(out, 'list.txt')], {maxBuffer: 1 << 30}).toString().trim().split('\n').map((l) => JSON.parse(l));
const ours = new Map(lines.map((l) => [l.file, l]));

const table = new Map(), silent = [], stricter = [];
const row = (code) => table.get(code) ?? table.set(code, {refused: 0, warned: 0, silent: 0}).get(code);
let faulty = 0, silentFiles = 0, bothLoad = 0;
for (const {file, name} of files) {
  const theirs = errors.get(file), own = ours.get(file);
  if (!own) { silent.push({code: 'NO ANSWER', name}); continue; }
  if (!theirs.length) {
    if (own.error) stricter.push({name, error: own.error.replace(file, ''), valid: file});
    else ++bothLoad;
    continue;
  }
  ++faulty;
  let missed = false;
  for (const e of theirs) {
    if (own.error) { ++row(e.code).refused; continue; }
    const named = own.warnings.some((w) => { const place = w.slice(0, w.indexOf(': ')); return place === '(file)' ? e.pointer === '' : related(place, e.pointer); });
    if (named) { ++row(e.code).warned; continue; }
    ++row(e.code).silent;
    missed = true;
    silent.push({code: e.code, pointer: e.pointer, name, message: e.message, warnings: own.warnings.slice(0, 3)});
  }
  silentFiles += missed;
}
console.log(`${models.length} models, ${files.length - models.length} mutants of ${bases} valid ones; the validator finds errors in ${faulty}; ${silentFiles} of these load without a word about one of them;` +
            ` ${stricter.length} files without its errors are refused here, ${bothLoad} load in both.\n`);
console.log('| validator code | refused | warned | silent |\n|---|---|---|---|');
for (const [code, r] of [...table].sort()) console.log(`| ${code} | ${r.refused} | ${r.warned} | ${r.silent} |`);
const kinds = new Map();
for (const s of stricter) { const k = s.error.replace(/^.*?: /, '').replace(/"[^"]*"|\d[\d.e+-]*/g, 'N').slice(0, 90); kinds.set(k, [...(kinds.get(k) ?? []), s]); }
console.log('\n| refused here, no error there | files | example |\n|---|---|---|');
for (const [k, list] of [...kinds].sort((a, b) => b[1].length - a[1].length)) console.log(`| ${k} | ${list.length} | ${list[0].name} |`);
fs.writeFileSync(path.join(out, 'silent.json'), JSON.stringify(silent, null, 1));
fs.writeFileSync(path.join(out, 'stricter.json'), JSON.stringify(stricter, null, 1));
