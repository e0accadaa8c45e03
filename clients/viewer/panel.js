// SPDX-License-Identifier: Apache-2.0
// A panel of controls made from the server's schema: a field that is new there is here as well. Only what was touched goes into the request.

const node = (tag, properties = {}, ...children) => {
  const e = Object.assign(document.createElement(tag), properties);
  e.append(...children);
  return e;
};
const axes = ['x', 'y', 'z'];

function get(object, path) {
  return path.reduce((o, key) => o?.[key], object);
}
function put(object, path, value) {
  const [key, ...rest] = path;
  if (!rest.length) {
    if (value === undefined) delete object[key];
    else object[key] = value;
    return;
  }
  if (value === undefined && !(key in object)) return;
  put(object[key] ??= {}, rest, value);
  if (!Object.keys(object[key]).length && value === undefined) delete object[key];
}

// Of what is dragged rather than typed: a slider of the whole range would jump over all that is wanted.
const comfortable = { stops: [-8, 8], deg: [-180, 180] };

// Rows of texts or numbers and maps are typed: the former with commas, the latter as JSON.
const listed = (field) => ({
  show: (v) => (v ?? []).join(', '),
  read: (text) => text.split(',').map((t) => t.trim()).filter(Boolean).map((t) => field.kind === 'text' ? t : Number(t)),
});
const json = { show: (v) => v ? JSON.stringify(v) : '', read: (text) => text.trim() ? JSON.parse(text) : undefined };

// `edits` is the request that the controls make; `changed(path)` after every edit.
export class Panel {
  constructor(schema, edits, changed) {
    this.messages = schema.messages;
    this.edits = edits;
    this.changed = changed;
    this.shown = new Map();  // path of a field -> shows what `edits` has now
  }

  get(path) { return get(this.edits, path); }

  // From outside the panel: a handle, a key. The field shows it if it is there.
  put(path, value) {
    put(this.edits, path, value);
    this.shown.get(path.join('.'))?.();
  }

  set(path, value, row) {
    put(this.edits, path, value);
    row?.classList.toggle('set', value !== undefined);
    this.changed(path);
  }

  // Says what is wrong next to the field that a message of the server names; whether there is one.
  fault(message, roots) {
    const text = message.replace(/^.*?\brequest\./, '');
    const rows = roots.flatMap((root) => [...root.querySelectorAll('.field')]).filter((row) => text.startsWith(row.dataset.path) && !/\w/.test(text[row.dataset.path.length] ?? ''));
    const row = rows.sort((a, b) => b.dataset.path.length - a.dataset.path.length)[0];
    if (!row) return false;
    const note = row.querySelector('.fault') ?? row.appendChild(node('p', { className: 'fault', id: 'fault-' + row.dataset.path }));
    note.textContent = message;
    for (const input of row.querySelectorAll('input, select, textarea')) {
      input.setAttribute('aria-invalid', 'true');
      input.setAttribute('aria-describedby', note.id);
    }
    for (let group = row.closest('details'); group; group = group.parentElement.closest('details')) group.open = true;
    return true;
  }
  static clearFaults(roots) {
    for (const root of roots) {
      for (const note of root.querySelectorAll('.fault')) note.remove();
      for (const input of root.querySelectorAll('[aria-invalid]')) for (const name of ['aria-invalid', 'aria-describedby']) input.removeAttribute(name);
    }
  }

  // The controls of a message's fields; `skip`: names of fields that have their place elsewhere.
  fields(name, path, skip = new Set()) {
    const out = [];
    const choices = new Map();
    for (const field of this.messages[name].fields) {
      if (skip.has(field.name)) continue;
      if (field.oneof) {
        if (!choices.has(field.oneof)) {
          choices.set(field.oneof, []);
          out.push([field.oneof, choices.get(field.oneof)]);
        }
        choices.get(field.oneof).push(field);
      } else out.push(field);
    }
    return out.map((entry) => Array.isArray(entry) ? this.choice(...entry, path) : this.control(entry, path));
  }

  group(title, children, open = false) {
    return node('details', { open }, node('summary', { textContent: title }), ...children);
  }

  row(field, path, ...inputs) {
    const row = node('div', { className: 'field', title: field.help ?? '' });
    row.dataset.path = path.join('.');
    const back = node('button', { type: 'button', textContent: '\u00d7', title: 'Default' });
    back.ariaLabel = `${field.name}: back to the default`;
    row.append(node('span', { textContent: field.name.replaceAll('_', ' ') + (field.unit ? `, ${field.unit}` : '') }), ...inputs, back);
    return [row, back];
  }

  control(field, parent) {
    const path = [...parent, field.name], now = get(this.edits, path);
    const label = path.join(' ');
    if (field.kind === 'message' && !field.repeated) return this.group(field.name.replaceAll('_', ' '), this.fields(field.message, path));
    let inputs, show, read;
    if (field.repeated || field.kind === 'map') {
      const form = field.kind === 'map' || field.kind === 'message' ? json : listed(field);
      const text = node(form === json ? 'textarea' : 'input', { ariaLabel: label, placeholder: form === json ? 'JSON' : 'a, b, ...', spellcheck: false });
      if (form !== json) text.type = 'text';
      inputs = [text];
      show = (v) => { text.value = form.show(v); };
      read = () => {
        text.setCustomValidity('');
        try {
          const value = form.read(text.value);
          return Array.isArray(value) && !value.length ? undefined : value;
        } catch (error) {
          text.setCustomValidity(String(error.message));
          text.reportValidity();
          throw error;
        }
      };
    } else if (field.kind === 'bool') {
      const box = node('input', { type: 'checkbox', ariaLabel: label });
      [inputs, show, read] = [[box], (v) => { box.checked = v ?? field.default; }, () => box.checked];
    } else if (field.kind === 'enum') {
      const list = node('select', { ariaLabel: label }, node('option', { value: '', textContent: field.default ? `${field.default} (default)` : 'not given' }),
        ...field.values.map((value) => node('option', { value, textContent: value })));
      [inputs, show, read] = [[list], (v) => { list.value = v ?? ''; }, () => list.value || undefined];
    } else if (field.kind === 'text') {
      const text = node('input', { type: 'text', ariaLabel: label });
      [inputs, show, read] = [[text], (v) => { text.value = v ?? ''; }, () => text.value || undefined];
    } else if (field.kind === 'vector') {
      const three = axes.map((a) => node('input', { type: 'number', step: 'any', ariaLabel: `${label} ${a}` }));
      inputs = [node('div', { className: 'vector' }, ...three)];
      show = (v) => three.forEach((input, i) => { input.value = v?.[axes[i]] ?? ''; });
      read = () => three.every((input) => input.value === '') ? undefined : Object.fromEntries(three.map((input, i) => [axes[i], Number(input.value)]));
    } else {
      const number = node('input', { type: 'number', step: field.kind === 'integer' ? 1 : 'any', ariaLabel: label, placeholder: field.default ?? '' });
      if (field.min !== undefined) number.min = field.min;
      if (field.max !== undefined) number.max = field.max;
      inputs = [number];
      read = () => number.value === '' ? undefined : Number(number.value);
      show = (v) => { number.value = v ?? ''; };
      if (field.min !== undefined && field.max !== undefined) {  // wide ranges by powers of the slider's place: most wanted values are near their least
        const [least, most] = field.min < 0 && comfortable[field.unit] ? comfortable[field.unit] : [field.min, field.max];
        const power = least < 0 ? 1 : most - least > 1000 ? 6 : most - least > 20 ? 2 : 1;
        const range = node('input', { type: 'range', min: 0, max: 1, step: 'any', ariaLabel: `${label}, slider` });
        const place = (v) => { range.value = (Math.max(0, Math.min(1, (v - least) / (most - least)))) ** (1 / power); };
        range.addEventListener('input', () => {
          const v = least + (most - least) * range.value ** power;
          number.value = field.kind === 'integer' ? Math.round(v) : Number(v.toPrecision(4));
          number.dispatchEvent(new Event('input', { bubbles: true }));
        });
        number.addEventListener('change', () => place(read() ?? field.default ?? field.min));
        show = (v) => { number.value = v ?? ''; place(v ?? field.default ?? field.min); };
        inputs.unshift(range);
      }
    }
    const [row, back] = this.row(field, path, ...inputs);
    show(now);
    row.classList.toggle('set', now !== undefined);
    this.shown.set(path.join('.'), () => {
      const value = get(this.edits, path);
      show(value);
      row.classList.toggle('set', value !== undefined);
    });
    row.addEventListener('input', (e) => {
      if (e.target.type === 'range') return;
      let value;
      try { value = read(); } catch { return; }  // half typed JSON
      this.set(path, value, row);
    });
    back.addEventListener('click', () => { show(undefined); this.set(path, undefined, row); });
    return row;
  }

  // One of several messages or numbers: a list of names, and the chosen one's fields.
  choice(name, fields, path) {
    const list = node('select', { ariaLabel: [...path, name].join(' ') }, node('option', { value: '', textContent: 'default' }),
      ...fields.map((f) => node('option', { value: f.name, textContent: f.name.replaceAll('_', ' ') })));
    const inner = node('div');
    const show = () => {
      const field = fields.find((f) => f.name === list.value);
      inner.replaceChildren(...(field?.kind === 'message' ? this.fields(field.message, [...path, field.name]) : field ? [this.control(field, path)] : []));
    };
    list.value = fields.find((f) => get(this.edits, [...path, f.name]) !== undefined)?.name ?? '';
    const [row, back] = this.row({ name }, [...path, name], list);
    const choose = () => {
      for (const f of fields) put(this.edits, [...path, f.name], undefined);
      const field = fields.find((f) => f.name === list.value);
      if (field?.kind === 'message') put(this.edits, [...path, field.name], {});
      row.classList.toggle('set', Boolean(field));
      show();
      this.changed(path);
    };
    row.classList.toggle('set', Boolean(list.value));
    list.addEventListener('input', (e) => { e.stopPropagation(); choose(); });
    back.addEventListener('click', () => { list.value = ''; choose(); });
    show();
    return node('div', {}, row, inner);
  }
}

// Shows the rows whose path has the text, and the groups that have such rows.
export function filterRows(root, text) {
  const wanted = text.trim().toLowerCase().replaceAll(' ', '_');
  for (const row of root.querySelectorAll('.field')) row.hidden = Boolean(wanted) && !row.dataset.path.toLowerCase().includes(wanted);
  for (const group of [...root.querySelectorAll('details')].reverse()) {
    const found = [...group.querySelectorAll('.field')].some((row) => !row.hidden);
    group.hidden = !found;
    if (wanted) group.open = found;
  }
}
