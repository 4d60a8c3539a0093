// SPDX-License-Identifier: Apache-2.0
// The light map's picture, and over it the kernels of a pixel.
'use strict';

const overlay = (() => {
  const outlined = 12;

  /// Texels of a kernel: {x0, y0, x1, y1, value(x, y)}.
  function kernelOf(field, number) {
    const hats = field.hats.columns * field.hats.rows;
    if (number >= hats) {
      const n = field.boxes.length / 4, [x0, y0, x1, y1] = [0, 1, 2, 3].map((i) => field.boxes[i * n + number - hats]);
      return {x0, y0, x1, y1, hat: false, value: () => 1};
    }
    const {columns, rows} = field.hats, {width, height} = field.light;
    const along = (texel, texels, node, nodes) =>
        nodes === 1 ? 1 : Math.max(0, 1 - Math.abs((texel + 0.5) / texels * (nodes - 1) - node));
    const range = (texels, node, nodes) => nodes === 1 ? [0, texels] :
        [Math.max(0, Math.floor((node - 1) * texels / (nodes - 1))), Math.min(texels, Math.ceil((node + 1) * texels / (nodes - 1)))];
    const column = number % columns, row = Math.floor(number / columns);
    const [x0, x1] = range(width, column, columns), [y0, y1] = range(height, row, rows);
    return {x0, y0, x1, y1, hat: true, value: (x, y) => along(x, width, column, columns) * along(y, height, row, rows)};
  }

  /// A pixel's kernels, the one that gives most under white light first: {number, kernel, weight: [r, g, b], energy}.
  function kernelsOfPixel(field, x, y) {
    const pixel = y * field.width + x, list = [];
    for (let i = field.starts[pixel]; i < field.starts[pixel + 1]; ++i) {
      const bits = field.weights[i], power = 2 ** ((bits >>> 27) - field.exponentOffset);
      const weight = [0, 9, 18].map((shift) => ((bits >>> shift) & 511) * power);
      const kernel = kernelOf(field, field.kernels[i]);
      let area = (kernel.x1 - kernel.x0) * (kernel.y1 - kernel.y0);
      if (kernel.hat) {
        area = 0;
        for (let ty = kernel.y0; ty < kernel.y1; ++ty) for (let tx = kernel.x0; tx < kernel.x1; ++tx) area += kernel.value(tx, ty);
      }
      list.push({number: field.kernels[i], kernel, weight, energy: area * (weight[0] + weight[1] + weight[2]) / 3});
    }
    return list.sort((a, b) => b.energy - a.energy);
  }

  /// The pixel's row of the transfer matrix over the light map: what each texel gives it.
  function gathered(field, list) {
    const {width, height} = field.light, sum = new Float32Array(width * height);
    for (const {kernel, weight} of list) {
      const grey = (weight[0] + weight[1] + weight[2]) / 3;
      for (let y = kernel.y0; y < kernel.y1; ++y)
        for (let x = kernel.x0; x < kernel.x1; ++x) sum[y * width + x] += grey * kernel.value(x, y);
    }
    return sum;
  }

  function encodedByte(linear) {
    const v = Math.min(Math.max(linear, 0), 1);
    return 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
  }

  /// Draws the light, brought to white by `gain`, and over it in orange what the picked pixel gathers.
  function drawLight(context, map, gain, picked) {
    const image = context.createImageData(map.width, map.height);
    const most = picked ? picked.gathered.reduce((a, b) => Math.max(a, b), 0) : 0;
    for (let t = 0; t < map.width * map.height; ++t) {
      const share = most > 0 ? Math.sqrt(picked.gathered[t] / most) * 0.85 : 0;
      const glow = [255, 140, 40];
      for (let c = 0; c < 3; ++c)
        image.data[4 * t + c] = (1 - share) * encodedByte(map.values[3 * t + c] * gain) + share * glow[c];
      image.data[4 * t + 3] = 255;
    }
    context.putImageData(image, 0, 0);
    if (!picked) return;
    context.strokeStyle = '#ff8c28';
    context.lineWidth = Math.max(1, map.width / 400);
    for (const {kernel} of picked.list.filter((entry) => !entry.kernel.hat).slice(0, outlined))
      context.strokeRect(kernel.x0, kernel.y0, kernel.x1 - kernel.x0, kernel.y1 - kernel.y0);
  }

  return {kernelsOfPixel, gathered, drawLight};
})();
