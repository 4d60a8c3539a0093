// SPDX-License-Identifier: Apache-2.0
// Light maps and their sums over the field's kernels. A light map is {width, height, values}: linear RGB, row by row from the top.
'use strict';

const light = (() => {
  function black(width, height) {
    return {width, height, values: new Float32Array(width * height * 3)};
  }

  /// Length of the part of [left, right) that lies in [x, x + 1).
  function overlap(left, right, x) {
    return Math.max(0, Math.min(right, x + 1) - Math.max(left, x));
  }

  /// A vertical bar over columns [left, left + size); columns lit in part are dimmer. As sliding_bar() of include/refield/relight.h.
  function addBar(map, left, size, colour, wraps) {
    for (let x = 0; x < map.width; ++x) {
      let covered = overlap(left, left + size, x);
      if (wraps) covered += overlap(left - map.width, left + size - map.width, x) + overlap(left + map.width, left + size + map.width, x);
      if (covered <= 0) continue;
      for (let y = 0; y < map.height; ++y)
        for (let c = 0; c < 3; ++c) map.values[(y * map.width + x) * 3 + c] = colour[c] * Math.min(covered, 1);
    }
  }

  /// A disc with an edge one texel wide.
  function addSpot(map, centreX, centreY, radius, colour, wraps) {
    for (let y = Math.max(0, Math.floor(centreY - radius - 1)); y < Math.min(map.height, centreY + radius + 1); ++y) {
      for (let x = 0; x < map.width; ++x) {
        let dx = Math.abs(x + 0.5 - centreX);
        if (wraps) dx = Math.min(dx, map.width - dx);
        const covered = Math.min(1, Math.max(0, radius + 0.5 - Math.hypot(dx, y + 0.5 - centreY)));
        if (covered > 0) for (let c = 0; c < 3; ++c) map.values[(y * map.width + x) * 3 + c] = colour[c] * covered;
      }
    }
  }

  /// A lat-long map turned about the vertical axis, content moving to the right. As rotated() of include/refield/relight.h.
  function rotated(map, turns) {
    const shift = (turns - Math.floor(turns)) * map.width;
    const whole = Math.floor(shift), fraction = shift - whole;
    const turned = black(map.width, map.height);
    for (let x = 0; x < map.width; ++x) {
      const right = (x - whole + 2 * map.width) % map.width;
      const left = (right + map.width - 1) % map.width;
      for (let y = 0; y < map.height; ++y) {
        const row = y * map.width;
        for (let c = 0; c < 3; ++c)
          turned.values[(row + x) * 3 + c] =
              (1 - fraction) * map.values[(row + right) * 3 + c] + fraction * map.values[(row + left) * 3 + c];
      }
    }
    return turned;
  }

  /// Which source texels, with which weights, a target texel averages along one axis.
  function shares(from, to) {
    return Array.from({length: to}, (_, i) => {
      const left = i * from / to, right = (i + 1) * from / to, list = [];
      for (let s = Math.floor(left); s < Math.min(Math.ceil(right), from); ++s)
        list.push([s, overlap(left, right, s) / (right - left)]);
      return list;
    });
  }

  /// Each texel is the mean over its area: no small sun is lost.
  function resampled(map, width, height) {
    if (map.width === width && map.height === height) return map;
    const columns = shares(map.width, width), rows = shares(map.height, height);
    const result = black(width, height);
    for (let y = 0; y < height; ++y)
      for (let x = 0; x < width; ++x)
        for (const [sy, wy] of rows[y])
          for (const [sx, wx] of columns[x])
            for (let c = 0; c < 3; ++c)
              result.values[(y * width + x) * 3 + c] += wy * wx * map.values[(sy * map.width + sx) * 3 + c];
    return result;
  }

  /// A lat-long map, turned to the right, as a monitor's window shows it from the middle of the scene. `window`:
  /// the direction of its top left corner, and what its width and its height add to it. Each texel is the mean
  /// of samples about half a texel of the map apart.
  function throughWindow(map, window, width, height, degrees) {
    const result = black(width, height), [corner, across, down] = window;
    const length = Math.hypot(...corner.map((v, i) => v + across[i] / 2 + down[i] / 2));
    const texel = Math.max(Math.hypot(...across) / width, Math.hypot(...down) / height) / length;
    const samples = Math.min(Math.max(Math.ceil(2 * texel / (2 * Math.PI / map.width)), 2), 8);
    for (let y = 0; y < height; ++y)
      for (let x = 0; x < width; ++x) {
        const to = (y * width + x) * 3;
        for (let s = 0; s < samples * samples; ++s) {
          const u = (x + (s % samples + 0.5) / samples) / width, v = (y + (Math.floor(s / samples) + 0.5) / samples) / height;
          const [right, up, ahead] = corner.map((c, i) => c + u * across[i] + v * down[i]);
          const turns = 0.5 + Math.atan2(right, ahead) / (2 * Math.PI) - degrees / 360;
          const column = Math.min(Math.floor((turns - Math.floor(turns)) * map.width), map.width - 1);
          const latitude = Math.atan2(up, Math.hypot(right, ahead));
          const row = Math.min(Math.floor((0.5 - latitude / Math.PI) * map.height), map.height - 1);
          const from = (row * map.width + column) * 3;
          for (let c = 0; c < 3; ++c) result.values[to + c] += map.values[from + c] / (samples * samples);
        }
      }
    return result;
  }

  /// Moves light onto the sources of a light stage, as LightInterpolator of core/field/light_interpolation.h.
  class Interpolator {
    constructor({width, height}, {sources, length, fineShare, fineLength, reach}) {
      this.size = {width, height};
      this.sources = sources;
      const directionOf = (column, row) => {
        const phi = 2 * Math.PI * column / width, theta = Math.PI * row / height;
        return [-Math.sin(theta) * Math.sin(phi), Math.cos(theta), -Math.sin(theta) * Math.cos(phi)];
      };
      const matern = (x) => (1 + x) * Math.exp(-x);
      const covariance = (chord) =>
          (1 - fineShare) * matern(Math.sqrt(3) / length * chord) + fineShare * matern(Math.sqrt(3) / fineLength * chord);
      const chordOf = (a, b) => Math.sqrt(Math.max(2 - 2 * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]), 0));
      const middles = sources.map(([x0, y0, x1, y1]) => directionOf((x0 + x1) / 2, (y0 + y1) / 2)), n = middles.length;
      this.angles = Array.from({length: height}, (_, y) =>
          2 * Math.PI / width * (Math.cos(Math.PI * y / height) - Math.cos(Math.PI * (y + 1) / height)));
      this.isSource = new Uint8Array(width * height);
      for (const [x0, y0, x1, y1] of sources)
        for (let y = y0; y < y1; ++y) this.isSource.fill(1, y * width + x0, y * width + x1);
      this.factor = Interpolator.factorised(n, (i, j) => covariance(chordOf(middles[i], middles[j])) + (i === j ? 1e-9 : 0));
      // Of each texel, its covariance with the sources times its solid angle and its nearness; nothing for texels far away.
      this.weights = Array.from({length: width * height}, (_, texel) => {
        if (this.isSource[texel]) return null;
        const direction = directionOf(texel % width + 0.5, Math.floor(texel / width) + 0.5);
        const chords = middles.map((middle) => chordOf(middle, direction));
        const near = Math.min(1, 3 - 2 * Math.min(...chords) / reach);
        if (near <= 0) return null;
        const factor = near * this.angles[Math.floor(texel / width)];
        return Float32Array.from(chords, (chord) => factor * covariance(chord));
      });
    }

    /// Cholesky factor, row by row.
    static factorised(n, at) {
      const factor = new Float64Array(n * n);
      for (let i = 0; i < n; ++i)
        for (let j = 0; j <= i; ++j) {
          let sum = at(i, j);
          for (let k = 0; k < j; ++k) sum -= factor[i * n + k] * factor[j * n + k];
          factor[i * n + j] = i === j ? Math.sqrt(sum) : sum / factor[j * n + j];
        }
      return factor;
    }

    solve(values) {
      const n = values.length, factor = this.factor;
      for (let i = 0; i < n; ++i) {
        for (let k = 0; k < i; ++k) values[i] -= factor[i * n + k] * values[k];
        values[i] /= factor[i * n + i];
      }
      for (let i = n - 1; i >= 0; --i) {
        for (let k = i + 1; k < n; ++k) values[i] -= factor[k * n + i] * values[k];
        values[i] /= factor[i * n + i];
      }
      return values;
    }

    /// A map that is black outside the sources and gives the same picture.
    gathered(map) {
      const n = this.sources.length, {width, height} = this.size, result = black(width, height);
      const sums = [0, 1, 2].map(() => new Float64Array(n));
      for (let texel = 0; texel < width * height; ++texel) {
        const weights = this.weights[texel], at = 3 * texel;
        if (this.isSource[texel]) for (let c = 0; c < 3; ++c) result.values[at + c] = map.values[at + c];
        if (!weights) continue;
        for (let c = 0; c < 3; ++c) {
          const radiance = map.values[at + c];
          if (radiance !== 0) for (let i = 0; i < n; ++i) sums[c][i] += radiance * weights[i];
        }
      }
      sums.forEach((sum, c) => this.solve(sum).forEach((irradiance, i) => {
        const [x0, y0, x1, y1] = this.sources[i];
        let angle = 0;
        for (let y = y0; y < y1; ++y) angle += (x1 - x0) * this.angles[y];
        for (let y = y0; y < y1; ++y)
          for (let x = x0; x < x1; ++x) result.values[(y * width + x) * 3 + c] += irradiance / angle;
      }));
      return result;
    }
  }

  /// Sums of a map left of and above each corner of its texels.
  function fillTable(table, {width, height, values}) {
    const stride = (width + 1) * 3;
    for (let y = 0, from = 0; y < height; ++y) {
      let red = 0, green = 0, blue = 0;
      for (let x = 0, at = (y + 1) * stride + 3; x < width; ++x, at += 3, from += 3) {
        table[at] = table[at - stride] + (red += values[from]);
        table[at + 1] = table[at + 1 - stride] + (green += values[from + 1]);
        table[at + 2] = table[at + 2 - stride] + (blue += values[from + 2]);
      }
    }
  }

  /// Sums of a light over each kernel of a field (Crow 1984), in double as the program does: the sum over a small box is a
  /// small difference of large numbers.
  class Projector {
    constructor(field) {
      this.field = field;
      this.hatCount = field.hats.columns * field.hats.rows;
      this.table = new Float64Array((field.light.width + 1) * (field.light.height + 1) * 3);
      this.coefficients = new Float32Array((Math.ceil((this.hatCount + field.boxes.length / 4) / Projector.width) || 1) * Projector.width * 4);
      if (field.interpolation) this.interpolator = new Interpolator(field.light, field.interpolation);
    }

    projectBoxes() {
      const {boxes} = this.field, n = boxes.length / 4, {table, coefficients: result} = this;
      const stride = (this.field.light.width + 1) * 3;
      for (let k = 0, to = this.hatCount * 4; k < n; ++k, to += 4) {
        const top = boxes[n + k] * stride, bottom = boxes[3 * n + k] * stride;
        const left = boxes[k] * 3, right = boxes[2 * n + k] * 3;
        const a = top + left, b = top + right, c = bottom + left, d = bottom + right;
        result[to] = (table[d] - table[c]) - (table[b] - table[a]);
        result[to + 1] = (table[d + 1] - table[c + 1]) - (table[b + 1] - table[a + 1]);
        result[to + 2] = (table[d + 2] - table[c + 2]) - (table[b + 2] - table[a + 2]);
      }
    }

    /// Weighted sums along rows, then along columns.
    projectHats(map) {
      const {columns, rows} = this.field.hats;
      const sums = new Float64Array(columns * rows * 3), alongRow = new Float64Array(columns * 3);
      const nodesOf = (texel, texels, nodes) => {
        if (nodes === 1) return [[0, 1]];
        const p = (texel + 0.5) / texels * (nodes - 1), first = Math.min(Math.floor(p), nodes - 2);
        return [[first, 1 - (p - first)], [first + 1, p - first]];
      };
      const across = Array.from({length: map.width}, (_, x) => nodesOf(x, map.width, columns));
      for (let y = 0, from = 0; y < map.height; ++y) {
        alongRow.fill(0);
        for (let x = 0; x < map.width; ++x, from += 3)
          for (const [node, weight] of across[x])
            for (let c = 0; c < 3; ++c) alongRow[node * 3 + c] += weight * map.values[from + c];
        for (const [node, weight] of nodesOf(y, map.height, rows))
          for (let i = 0; i < alongRow.length; ++i) sums[node * columns * 3 + i] += weight * alongRow[i];
      }
      for (let k = 0; k < this.hatCount; ++k)
        for (let c = 0; c < 3; ++c) this.coefficients[k * 4 + c] = sums[k * 3 + c];
    }

    /// [rows × Projector.width × 4], kernel after kernel; the fourth value is unused. Valid until the next call.
    project(map) {
      if (this.interpolator) map = this.interpolator.gathered(map);
      fillTable(this.table, map);
      this.projectBoxes();
      if (this.hatCount > 0) this.projectHats(map);
      return this.coefficients;
    }
  }
  Projector.width = 2048;

  return {black, addBar, addSpot, rotated, resampled, throughWindow, Projector};
})();
