// SPDX-License-Identifier: Apache-2.0
// Colour and power of one light, as its gain: what every kind of light has, and what costs no tracing.

const toLinear = (v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
const toCode = (v) => v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;

// A gain as {color: '#rrggbb', stops}, and back.
export function fromGain(gain) {
  const rgb = ['x', 'y', 'z'].map((a) => Math.max(0, gain?.[a] ?? (gain ? 0 : 1))), most = Math.max(...rgb);
  if (!(most > 0)) return { color: '#000000', stops: 0 };
  return { color: '#' + rgb.map((v) => Math.round(255 * toCode(v / most)).toString(16).padStart(2, '0')).join(''), stops: Math.log2(most) };
}
export function toGain({ color, stops }) {
  const [x, y, z] = [1, 3, 5].map((i) => Number((toLinear(parseInt(color.slice(i, i + 2), 16) / 255) * 2 ** stops).toPrecision(5)));
  return { x, y, z };
}

// Fills `root` (it holds input[type=color], input[type=range], .name) and tells `changed(name, gain)`.
export class Lamp {
  constructor(root, changed) {
    this.root = root;
    this.color = root.querySelector('input[type=color]');
    this.power = root.querySelector('input[type=range]');
    this.name = null;
    const tell = () => changed(this.name, toGain({ color: this.color.value, stops: Number(this.power.value) }));
    for (const input of [this.color, this.power]) input.addEventListener('input', tell);
  }
  show(name, gain) {
    const own = this.name === name && gain ? toGain({ color: this.color.value, stops: Number(this.power.value) }) : null;
    this.root.hidden = name === null;
    this.name = name;
    if (name === null) return;
    this.root.querySelector('.name').textContent = name;
    // What the inputs say already stays as it was put: the same light in other words would move them under the hand.
    if (own && ['x', 'y', 'z'].every((a) => own[a] === (gain[a] ?? 0))) return;
    const { color, stops } = fromGain(gain);
    this.color.value = color;
    this.power.value = stops;
  }
}
