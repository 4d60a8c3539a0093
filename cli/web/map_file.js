// SPDX-License-Identifier: Apache-2.0
// Light maps from files: Radiance HDR as stored, whatever else the browser shows (PNG, JPEG, WebP) decoded from sRGB.
'use strict';

const mapFile = (() => {
  const linearFromSrgb = Float32Array.from({length: 256}, (_, i) => {
    const v = i / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  });
  const largestPixels = 1 << 26;

  async function fromPicture(file) {
    const bitmap = await createImageBitmap(file, {colorSpaceConversion: 'none', premultiplyAlpha: 'none'});
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext('2d', {willReadFrequently: true});
    context.drawImage(bitmap, 0, 0);
    const {data} = context.getImageData(0, 0, bitmap.width, bitmap.height);
    const map = light.black(bitmap.width, bitmap.height);
    for (let from = 0, to = 0; from < data.length; from += 4)
      for (let c = 0; c < 3; ++c) map.values[to++] = linearFromSrgb[data[from + c]];
    return map;
  }

  /// Ward's run-length encoding (Graphics Gems II, II.8): new per channel, old per pixel, or plain.
  class HdrReader {
    constructor(bytes) {
      this.bytes = bytes;
      this.at = 0;
    }

    line() {
      const end = this.bytes.indexOf(10, this.at);
      if (end < 0) throw new Error('the HDR file ends within its header');
      const text = String.fromCharCode(...this.bytes.subarray(this.at, Math.min(end, this.at + 256)));
      this.at = end + 1;
      return text;
    }

    byte() {
      if (this.at >= this.bytes.length) throw new Error('the HDR file is truncated');
      return this.bytes[this.at++];
    }

    /// One row of R, G, B, exponent, pixel after pixel.
    row(width) {
      const row = new Uint8Array(width * 4), b = this.bytes, i = this.at;
      const newRuns = width >= 8 && width < 32768 && b[i] === 2 && b[i + 1] === 2 && b[i + 2] < 128;
      if (!newRuns) return this.oldRow(row, width);
      this.at += 4;
      for (let c = 0; c < 4; ++c) {
        for (let x = 0; x < width;) {
          let count = this.byte();
          const run = count > 128;
          if (run) count -= 128;
          if (count === 0 || x + count > width) throw new Error('the HDR file is damaged');
          const value = run ? this.byte() : 0;
          for (; count > 0; --count) row[4 * x++ + c] = run ? value : this.byte();
        }
      }
      return row;
    }

    oldRow(row, width) {
      for (let x = 0, shift = 0; x < width;) {
        const rgbe = [this.byte(), this.byte(), this.byte(), this.byte()];
        if (rgbe[0] === 1 && rgbe[1] === 1 && rgbe[2] === 1 && x > 0) {
          for (let count = rgbe[3] << shift; count > 0 && x < width; --count, ++x) row.copyWithin(4 * x, 4 * x - 4, 4 * x);
          shift = Math.min(shift + 8, 16);
        } else {
          row.set(rgbe, 4 * x++);
          shift = 0;
        }
      }
      return row;
    }
  }

  function fromHdr(buffer) {
    const reader = new HdrReader(new Uint8Array(buffer));
    while (reader.line() !== '');
    const size = /^-Y (\d+) \+X (\d+)/.exec(reader.line());
    if (!size) throw new Error('the HDR file is turned; save it with rows from top to bottom');
    const height = Number(size[1]), width = Number(size[2]);
    if (!(width > 0 && height > 0 && width * height <= largestPixels)) throw new Error('the HDR file is too large');
    const map = light.black(width, height);
    for (let y = 0, to = 0; y < height; ++y) {
      const row = reader.row(width);
      for (let x = 0; x < width; ++x) {
        const scale = row[4 * x + 3] === 0 ? 0 : 2 ** (row[4 * x + 3] - 136);
        for (let c = 0; c < 3; ++c) map.values[to++] = row[4 * x + c] * scale;
      }
    }
    return map;
  }

  async function read(file) {
    const start = new Uint8Array(await file.slice(0, 2).arrayBuffer());
    if (start[0] === 35 && start[1] === 63) return fromHdr(await file.arrayBuffer());
    try {
      return await fromPicture(file);
    } catch {
      throw new Error(`${file.name} is no map that a browser can read; give HDR, PNG or JPEG`);
    }
  }

  return {read, linearFromSrgb};
})();
