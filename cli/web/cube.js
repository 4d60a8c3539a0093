// SPDX-License-Identifier: Apache-2.0
// Fields over cube maps under panoramas: sums of the light over boxes, boxes that weigh it by its direction and
// spherical harmonics. As core/light/cube_map.h, core/field/light_basis.h and core/light/harmonics.h.
'use strict';

const cube = (() => {
  // To the right, up and ahead on each face.
  const faceAxes = [
    [[0, 0, -1], [0, 1, 0], [1, 0, 0]], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
  ];
  const largestSide = 256, samplesOfPanorama = 2 ** 21;
  const gauss = [0.21132486540518712, 0.78867513459481288];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  /// Number of the texel that a direction lies in.
  function texelOf(direction, side) {
    const sizes = direction.map(Math.abs), axis = sizes.indexOf(Math.max(...sizes));
    const face = 2 * axis + (direction[axis] < 0 ? 1 : 0), [right, up] = faceAxes[face];
    const place = (across) => Math.min(Math.max(Math.floor(0.5 * (1 + across / sizes[axis]) * side), 0), side - 1);
    return (face * side + place(-dot(up, direction))) * side + place(dot(right, direction));
  }

  /// Points of a texel of a face, in the axes of the face: [[x, y, z], share of the solid angle], of unit length.
  function pointsOfTexel(x, y, side) {
    const points = [];
    let total = 0;
    for (const row of gauss)
      for (const column of gauss) {
        const point = [(x + column) * 2 / side - 1, 1 - (y + row) * 2 / side, 1], length = Math.hypot(...point);
        points.push([point.map((v) => v / length), length ** -3]);
        total += length ** -3;
      }
    for (const point of points) point[1] /= total;
    return points;
  }

  function evaluateHarmonics(order, [x, y, z], values) {
    let diagonal = Math.sqrt(0.25 / Math.PI), cosine = 1, sine = 0;
    for (let m = 0; m < order; ++m) {
      const scale = m === 0 ? 1 : Math.SQRT2;
      for (let l = m, before = 0, now = diagonal; l < order; ++l) {
        const middle = l * (l + 1), next = l + 1;
        values[middle + m] = scale * cosine * now;
        if (m > 0) values[middle - m] = scale * sine * now;
        const grow = Math.sqrt((4 * next * next - 1) / (next * next - m * m));
        const back = l === m ? 0 : Math.sqrt((l * l - m * m) / (4 * l * l - 1));
        [before, now] = [now, grow * (z * now - back * before)];
      }
      [cosine, sine] = [x * cosine - y * sine, x * sine + y * cosine];
      diagonal *= Math.sqrt((2 * m + 3) / (2 * m + 2));
    }
  }

  /// Sums of a panorama over each kernel of a field. Each texel of the panorama is divided, and its parts are added to the
  /// texels of a cube map that they lie in, so that small suns keep their power; boxes are summed by tables (Crow 1984). A
  /// cube map of more than 256 texels a side is replaced by one of 256; boxes may then begin within its texels.
  class Projector {
    constructor(field) {
      const {light: {cube: resolution}, harmonics, boxes, vectors} = field;
      this.side = Math.min(resolution, largestSide);
      this.order = harmonics;
      this.harmonicCount = 2 * harmonics * harmonics;
      this.vectorCount = vectors.length / 3;
      this.boxCount = boxes.length / 4;
      this.corners = Float64Array.from(boxes, (corner) => corner * this.side / resolution);
      this.energy = new Float64Array(6 * this.side * this.side * 3);
      const rows = Math.ceil((this.harmonicCount + this.boxCount) / light.Projector.width) || 1;
      this.coefficients = new Float32Array(rows * light.Projector.width * 4);
      this.divide(field.light);
      if (this.boxCount > 0) this.prepareBoxes(vectors);
      if (this.order > 0) this.prepareHarmonics();
    }

    divide({width, height}) {
      const parts = Math.max(2, Math.floor(Math.sqrt(samplesOfPanorama / (width * height))));
      this.partsOfTexel = parts;
      this.targets = new Uint32Array(width * height * parts * parts);
      this.angles = Float64Array.from({length: height * parts}, (_, row) =>
          2 * Math.PI / (width * parts) * (Math.cos(Math.PI * row / (height * parts)) - Math.cos(Math.PI * (row + 1) / (height * parts))));
      for (let y = 0, to = 0; y < height; ++y)
        for (let x = 0; x < width; ++x)
          for (let j = 0; j < parts; ++j) {
            const theta = Math.PI * (y + (j + 0.5) / parts) / height, sine = Math.sin(theta), up = Math.cos(theta);
            for (let i = 0; i < parts; ++i) {
              const phi = 2 * Math.PI * (x + (i + 0.5) / parts) / width;
              this.targets[to++] = 3 * texelOf([-sine * Math.sin(phi), up, -sine * Math.cos(phi)], this.side);
            }
          }
    }

    /// Tables of a column and a row more than there are texels: of all faces' energy, and of the moments of one face.
    prepareBoxes(vectors) {
      const side = this.side;
      this.table = new Float64Array((side + 1) * (6 * side + 1) * 3);
      this.found = new Float64Array(9);
      if (this.vectorCount === 0) return;
      this.moments = new Float64Array((side + 1) * (side + 1) * 9);
      this.means = new Float64Array(side * side * 3);
      for (let y = 0, to = 0; y < side; ++y)
        for (let x = 0; x < side; ++x, to += 3)
          for (const [point, share] of pointsOfTexel(x, y, side))
            for (let a = 0; a < 3; ++a) this.means[to + a] += share * point[a];
      this.vectors = new Float64Array(vectors.length);
      this.ofFace = Array.from({length: 6}, () => []);
      for (let k = 0; k < this.vectorCount; ++k) {
        const face = Math.floor((this.corners[this.boxCount + k] + 1e-6) / side), vector = vectors.subarray(3 * k, 3 * k + 3);
        this.ofFace[face].push(k);
        faceAxes[face].forEach((axis, a) => { this.vectors[3 * k + a] = dot(axis, vector); });
      }
    }

    /// Means of the harmonics over the texels. [texels × order²]
    prepareHarmonics() {
      const side = this.side, count = this.order * this.order, values = new Float64Array(count);
      this.harmonics = new Float32Array(6 * side * side * count);
      for (let face = 0, to = 0; face < 6; ++face)
        for (let y = 0; y < side; ++y)
          for (let x = 0; x < side; ++x, to += count)
            for (const [point, share] of pointsOfTexel(x, y, side)) {
              const direction = [0, 1, 2].map((axis) => faceAxes[face].reduce((sum, of, a) => sum + of[axis] * point[a], 0));
              evaluateHarmonics(this.order, direction, values);
              for (let i = 0; i < count; ++i) this.harmonics[to + i] += share * values[i];
            }
    }

    spread(map) {
      const {targets, angles, energy, partsOfTexel: parts} = this, {values, width, height} = map;
      energy.fill(0);
      for (let y = 0, from = 0, target = 0; y < height; ++y)
        for (let x = 0; x < width; ++x, from += 3) {
          const red = values[from], green = values[from + 1], blue = values[from + 2];
          if (red === 0 && green === 0 && blue === 0) { target += parts * parts; continue; }
          for (let j = 0; j < parts; ++j) {
            const angle = angles[y * parts + j];
            for (let i = 0; i < parts; ++i) {
              const to = targets[target++];
              energy[to] += red * angle;
              energy[to + 1] += green * angle;
              energy[to + 2] += blue * angle;
            }
          }
        }
    }

    /// Adds ± the sum left of and above (x, y), linear within texels, to `found`.
    lookUp(table, channels, x, y, sign) {
      const found = this.found, stride = (this.side + 1) * channels;
      const column = Math.floor(x), row = Math.floor(y), dx = x - column, dy = y - row;
      const at = row * stride + column * channels;
      if (dx === 0 && dy === 0) {
        for (let c = 0; c < channels; ++c) found[c] += sign * table[at + c];
        return;
      }
      const right = dx > 0 ? channels : 0, below = dy > 0 ? stride : 0;
      for (let c = 0; c < channels; ++c)
        found[c] += sign * ((1 - dy) * ((1 - dx) * table[at + c] + dx * table[at + right + c]) +
                            dy * ((1 - dx) * table[at + below + c] + dx * table[at + below + right + c]));
    }

    sumBox(table, channels, k, top) {
      const {corners, boxCount: n, found} = this;
      const x0 = corners[k], y0 = corners[n + k] - top, x1 = corners[2 * n + k], y1 = corners[3 * n + k] - top;
      found.fill(0, 0, channels);
      this.lookUp(table, channels, x1, y1, 1);
      this.lookUp(table, channels, x0, y1, -1);
      this.lookUp(table, channels, x1, y0, -1);
      this.lookUp(table, channels, x0, y0, 1);
    }

    projectBoxes() {
      const {side, table, energy, found, coefficients} = this;
      light.fillTable(table, {width: side, height: 6 * side, values: energy});
      for (let k = this.vectorCount; k < this.boxCount; ++k) {
        this.sumBox(table, 3, k, 0);
        for (let c = 0; c < 3; ++c) coefficients[4 * (this.harmonicCount + k) + c] = found[c];
      }
    }

    /// Of a face: sums of energy times direction, in the axes of the face.
    fillMoments(face) {
      const {side, moments, means, energy} = this, stride = (side + 1) * 9, row = new Float64Array(9);
      for (let y = 0, from = face * side * side * 3, mean = 0; y < side; ++y) {
        row.fill(0);
        for (let x = 0, at = (y + 1) * stride + 9; x < side; ++x, at += 9, from += 3, mean += 3)
          for (let a = 0, i = 0; a < 3; ++a)
            for (let c = 0; c < 3; ++c, ++i)
              moments[at + i] = moments[at - stride + i] + (row[i] += energy[from + c] * means[mean + a]);
      }
    }

    projectVectorBoxes() {
      const {found, vectors, coefficients} = this;
      for (let face = 0; face < 6; ++face) {
        if (this.ofFace[face].length === 0) continue;
        this.fillMoments(face);
        for (const k of this.ofFace[face]) {
          this.sumBox(this.moments, 9, k, face * this.side);
          for (let c = 0; c < 3; ++c)
            coefficients[4 * (this.harmonicCount + k) + c] =
                vectors[3 * k] * found[c] + vectors[3 * k + 1] * found[3 + c] + vectors[3 * k + 2] * found[6 + c];
        }
      }
    }

    /// Kernel 2i is harmonic i, kernel 2i + 1 its negative.
    projectHarmonics() {
      const {energy, harmonics, coefficients} = this, count = this.order * this.order, sums = new Float64Array(count * 3);
      for (let texel = 0; texel < energy.length / 3; ++texel) {
        if (energy[3 * texel] === 0 && energy[3 * texel + 1] === 0 && energy[3 * texel + 2] === 0) continue;
        for (let i = 0; i < count; ++i)
          for (let c = 0; c < 3; ++c) sums[3 * i + c] += harmonics[texel * count + i] * energy[3 * texel + c];
      }
      for (let i = 0; i < count; ++i)
        for (let c = 0; c < 3; ++c) {
          coefficients[8 * i + c] = sums[3 * i + c];
          coefficients[8 * i + 4 + c] = -sums[3 * i + c];
        }
    }

    /// Of a panorama of the size of field.light, as light.Projector's: harmonics, boxes with a direction, boxes.
    project(map) {
      this.spread(map);
      if (this.boxCount > 0) this.projectBoxes();
      if (this.vectorCount > 0) this.projectVectorBoxes();
      if (this.order > 0) this.projectHarmonics();
      return this.coefficients;
    }
  }

  return {Projector};
})();
