// SPDX-License-Identifier: Apache-2.0
// A request as the command that renders it: `gobo render SCENE --set ...`, or with the request as it is where --set has no words for it.

const quoted = (text) => /^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`;

class NoWords extends Error {}

function settings(messages, name, value, path, out) {
  for (const [key, v] of Object.entries(value)) {
    const field = messages[name].fields.find((f) => f.name === key), where = [...path, key].join('.');
    if (!field || field.repeated) throw new NoWords();
    if (field.kind === 'map') {
      for (const [entry, inner] of Object.entries(v)) {
        if (!field.message || field.name === 'curves' || field.name === 'expressions' || !/^[\w-]+$/.test(entry)) throw new NoWords();
        settings(messages, field.message, inner, [...path, key, entry], out);
      }
    } else if (field.kind === 'vector') out.push(`${where}=${['x', 'y', 'z'].map((a) => v[a] ?? 0).join(',')}`);
    else if (field.kind !== 'message') out.push(`${where}=${v}`);
    else if (Object.keys(v).length) settings(messages, field.message, v, [...path, key], out);
    else if (field.oneof) out.push(`${path.join('.')}=${key}`);  // a technique with its defaults
    else throw new NoWords();
  }
}

export function command(schema, request) {
  const { scene, width, height, outputs, ...rest } = request;
  delete rest.scheduling;
  try {
    const out = [];
    settings(schema.messages, schema.root, rest, [], out);
    return ['gobo render', quoted(scene), '-o picture.png', ...(width || height ? [`--size ${width ?? 640}x${height ?? 480}`] : []),
      ...(outputs?.length ? [`--outputs ${quoted(outputs.join(','))}`] : []), ...out.map((s) => '--set ' + quoted(s))].join(' ');
  } catch (error) {
    if (!(error instanceof NoWords)) throw error;
    return `gobo render --request - -o picture.png <<'END'\n${JSON.stringify(request)}\nEND`;
  }
}
