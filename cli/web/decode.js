// SPDX-License-Identifier: Apache-2.0
// The field's data come as scripts, since pages opened from disk may not fetch files: data.js describes the arrays, each
// data-NNN.js hands over a part of one.
'use strict';

const refield = (() => {
  let description = null;
  let received = null;

  function loadScript(name) {
    return new Promise((resolve, reject) => {
      const script = document.createElement('script');
      script.src = name;
      script.onload = () => { script.remove(); resolve(); };
      script.onerror = () => reject(new Error(`${name} is missing; copy the whole folder`));
      document.head.append(script);
    });
  }

  function bytesOfBase64(text) {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const binary = atob(text);
    const bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; ++i) bytes[i] = binary.charCodeAt(i);
    return bytes;
  }

  async function inflated(bytes) {
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  /// An array whose bytes were written by significance, the lowest of all values first, and then divided into parts.
  class ArrayReader {
    constructor({values, bytes, kind}) {
      Object.assign(this, {values, bytes, kind, at: 0, significance: 0});
      this.result = new ({1: Uint8Array, 2: Uint16Array, 4: Uint32Array})[bytes](values);
    }

    async add(base64) {
      const chunk = await inflated(bytesOfBase64(base64)), {result, values} = this;
      let {at, significance} = this;
      for (let i = 0; i < chunk.length; ++i) {
        result[at] |= chunk[i] << (8 * significance);
        if (++at === values) { at = 0; ++significance; }
      }
      Object.assign(this, {at, significance});
    }

    finish() {
      if (this.significance !== this.bytes && this.values > 0) throw new Error('the data are incomplete; export the page again');
      if (this.kind === 'half') return Float32Array.from(this.result, valueOfHalf);
      return this.result;
    }
  }

  async function loadArray(described, onPart) {
    const reader = new ArrayReader(described);
    for (const part of described.parts) {
      await loadScript(part);
      const base64 = received;
      received = null;
      await reader.add(base64);
      onPart();
    }
    return reader.finish();
  }

  function startsOf(counts) {
    const starts = new Uint32Array(counts.length + 1);
    for (let p = 0; p < counts.length; ++p) starts[p + 1] = starts[p] + counts[p];
    return starts;
  }

  /// {width, height, light, hats, exponentOffset, exposure, title, mixing (3 × 3, row by row)} and the arrays: starts, kernels,
  /// weights, boxes. boxes holds all x0, then y0, x1, y1. `onProgress` is called with a share
  /// from 0 to 1.
  async function loadField(onProgress) {
    await loadScript('data.js');
    const arrays = description.arrays, loaded = Object.keys(arrays).filter((name) => !/^map\d/.test(name));
    const total = loaded.reduce((sum, name) => sum + arrays[name].parts.length, 0);
    let done = 0;
    const onPart = () => onProgress(++done / total);
    const field = {mixing: [1, 0, 0, 0, 1, 0, 0, 0, 1], ...description, exponentOffset: description.exponent_offset};
    for (const name of loaded) field[name] = await loadArray(arrays[name], onPart);
    field.starts = startsOf(field.counts);
    return field;
  }

  function valueOfHalf(bits) {
    const exponent = (bits >> 10) & 31, mantissa = bits & 1023;
    return exponent === 0 ? mantissa * 2 ** -24 : (1 + mantissa / 1024) * 2 ** (exponent - 15);
  }

  /// One of the maps that the page brings along: {width, height, values}, linear RGB.
  async function loadMap(index) {
    const {width, height, scale, array} = description.maps[index];
    const values = await loadArray(description.arrays[array], () => {});
    return {width, height, values: values.map((value) => scale * value)};
  }

  return {
    loadField,
    loadMap,
    describe: (given) => { description = given; },
    receive: (base64) => { received = base64; },
  };
})();
