// SPDX-License-Identifier: Apache-2.0
// Runs the notebook's module (argument 1) on a document of a few lines, with the kernel's first message (argument 2), drags once, edits a light, shows a
// picture, and prints what the kernel is told as JSON.
import { readFileSync } from 'node:fs';
import { pathToFileURL } from 'node:url';

class Element {
  constructor(tag) {
    this.tag = tag;
    this.children = [];
    this.listeners = {};
    this.dataset = {};
    this.clientHeight = 480;
    this.value = '';
    this.classes = new Set();
    this.classList = { toggle: (name, on) => { this.classes[on ? 'add' : 'delete'](name); }, contains: (name) => this.classes.has(name) || this.className === name };
  }
  append(...children) { this.children.push(...children); }
  replaceChildren(...children) { this.children = children; }
  addEventListener(kind, listener) { (this.listeners[kind] ??= []).push(listener); }
  dispatchEvent(event) { this.tell(event.type, event); }
  tell(kind, event = {}) { for (const listener of this.listeners[kind] ?? []) listener({ target: this, preventDefault() {}, stopPropagation() {}, ...event }); }
  setPointerCapture() {}
  getContext() { return { drawImage: (...args) => drawn.push(args) }; }
  attachShadow() {
    const named = {};
    return { set innerHTML(text) { this.text = text; }, querySelector: (name) => named[name] ??= new Element(name), named };
  }
  querySelectorAll() { return []; }
  all() { return [this, ...this.children.flatMap((c) => c instanceof Element ? c.all() : [])]; }
}

const drawn = [], roots = [];
globalThis.document = { createElement: (tag) => {
  const e = new Element(tag);
  if (tag === 'div') { const attach = e.attachShadow; e.attachShadow = () => { const s = attach(); roots.push(s); return s; }; }
  return e;
} };
globalThis.createImageBitmap = async (blob) => ({ size: blob.size });
globalThis.Option ??= class extends Element {};

const { default: widget } = await import(pathToFileURL(process.argv[2]).href);
const start = JSON.parse(readFileSync(process.argv[3], 'utf8'));
const said = [], listeners = [];
const model = { send: (m) => said.push(JSON.parse(JSON.stringify(m))), on: (_, f) => listeners.push(f), off: (_, f) => listeners.splice(listeners.indexOf(f), 1) };
const hear = async (message, buffers = []) => { for (const f of [...listeners]) await f(message, buffers); };

const clean = widget.render({ model, el: new Element('body') });
const $ = (name) => roots[0].querySelector(name);
if (!roots[0].text.includes(':host')) throw new Error('the styles are not those of a shadow root');
const canvas = $('canvas');
canvas.tell('pointerdown', { pointerId: 1, clientX: 10, clientY: 10 });
canvas.tell('pointermove', { pointerId: 1, clientX: 40, clientY: 20 });   // before the start there is nothing to turn
canvas.tell('pointerup', { pointerId: 1 });
await hear({ ...start, to: 'another view' });
if ($('#panel').children.length) throw new Error('a message to another view was taken');
await hear({ ...start, to: said[0].view });
canvas.tell('pointerdown', { pointerId: 1, clientX: 10, clientY: 10 });
canvas.tell('pointermove', { pointerId: 1, clientX: 40, clientY: 20 });
const row = $('#lights').children.flatMap((c) => c.all()).find((e) => e.dataset.path === 'lights.light.intensity');
const number = row.all().find((e) => e.type === 'number');
number.value = '7';
row.tell('input', { target: number });
await hear({ type: 'picture', width: 32, height: 24, text: 'words', final: true }, [new DataView(new ArrayBuffer(3))]);
if (drawn.length !== 1 || canvas.width !== 32 || $('#status').textContent !== 'words') throw new Error('the picture is not shown');
await hear({ type: 'error', message: 'wrong' });
if ($('#error').textContent !== 'wrong') throw new Error('the error is not shown');
clean();
if (listeners.length) throw new Error('it listens on');
console.log(JSON.stringify(said));
