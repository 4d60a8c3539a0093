// SPDX-License-Identifier: Apache-2.0
// Pictures too large for a page: every n-th pixel is there from the start, and where the picture is enlarged, tiles of more
// pixels are loaded.
'use strict';

/// Which part of a picture the canvas shows. `left`, `top` and all sizes are in pixels of the overview.
class PictureView {
  constructor(canvas, columns, rows, closest) {
    Object.assign(this, {canvas, columns, rows, closest});
    this.reset();
  }

  reset() {
    Object.assign(this, {zoom: 1, left: 0, top: 0});
  }

  /// What is at a point of the canvas stays there; without one, what is in its middle.
  approach(factor, [x, y] = [this.canvas.width / 2, this.canvas.height / 2]) {
    const zoom = Math.min(Math.max(this.zoom * factor, 1), this.closest), change = 1 / this.zoom - 1 / zoom;
    this.zoom = zoom;
    this.move(this.left + x * change, this.top + y * change);
  }

  /// The picture moves by that many pixels of the canvas.
  pan(right, down) {
    this.move(this.left - right / this.zoom, this.top - down / this.zoom);
  }

  move(left, top) {
    const limited = (start, length, seen) => Math.min(Math.max(start, 0), Math.max(0, length - seen / this.zoom));
    this.left = limited(left, this.columns, this.canvas.width);
    this.top = limited(top, this.rows, this.canvas.height);
  }
}

class TiledRelighter extends Relighter {
  static kept = 32;        // tiles: of an estimated field 45 million weights, 360 MB for the graphics and as much beside
  static enlargement = 4;  // of the finest pixels, at most

  /// `changed` is called when there is something new to draw.
  constructor(canvas, field, projector, changed) {
    super(canvas, field);
    Object.assign(this, {projector, changed, tiles: new Map(), missing: new Set(), wanted: [], lights: 0, loading: null});
    const {stride, finest, width, height} = field.tiles;
    this.camera = new PictureView(canvas, width / stride, height / stride, TiledRelighter.enlargement * stride / finest);
  }

  setCoefficients(values) {
    super.setCoefficients(values);
    ++this.lights;
  }

  /// Of the level to draw: its pixels are one to two pixels of the canvas wide, or wider where there is no finer level.
  stride() {
    const {stride, finest} = this.field.tiles;
    return Math.max(stride / 2 ** Math.floor(Math.log2(this.camera.zoom)), finest);
  }

  /// How many pixels of a level make one of the overview.
  density(stride) {
    return this.field.tiles.stride / stride;
  }

  /// The tiles in sight, those in the middle first.
  inSight() {
    const {side, width, height, stride: coarsest} = this.field.tiles, {canvas, left, top, zoom} = this.camera, stride = this.stride();
    if (stride === coarsest) return [];
    const size = side / this.density(stride);
    const range = (start, seen, pixels) =>
        [Math.floor(start / size), Math.min(Math.ceil((start + seen / zoom) / size), Math.ceil(pixels / (side * stride)))];
    const [firstColumn, lastColumn] = range(left, canvas.width, width), [firstRow, lastRow] = range(top, canvas.height, height);
    const tiles = [];
    for (let row = firstRow; row < lastRow; ++row)
      for (let column = firstColumn; column < lastColumn; ++column) {
        const away = Math.hypot((column + 0.5) * size - left - canvas.width / zoom / 2, (row + 0.5) * size - top - canvas.height / zoom / 2);
        tiles.push({name: `${stride}-${column}-${row}`, stride, column, row, away});
      }
    return tiles.sort((a, b) => a.away - b.away);
  }

  /// How a tile lies on the canvas: pixels of it for one of the canvas, and the one at the canvas's top left corner.
  placeOf({stride, column, row}) {
    const {left, top, zoom} = this.camera, density = this.density(stride), {side} = this.field.tiles;
    return {scale: density / zoom, shift: [left * density - column * side, top * density - row * side]};
  }

  placeOfOverview() {
    return {scale: 1 / this.camera.zoom, shift: [this.camera.left, this.camera.top]};
  }

  drawLayers(exposure, spacing) {
    const gl = this.gl, wanted = this.inSight(), there = wanted.filter(({name}) => this.tiles.has(name));
    if (there.length === 0 || there.length < wanted.length) this.drawLayer(this.layer, exposure, this.placeOfOverview());
    gl.enable(gl.SCISSOR_TEST);
    for (const tile of there) {
      const {layer} = this.used(tile.name), place = this.placeOf(tile);
      this.clip(layer.field, place, spacing);
      this.drawLayer(layer, exposure, place);
    }
    gl.disable(gl.SCISSOR_TEST);
    this.wanted = wanted;
    this.loadNext();
  }

  /// A tile, under the present light; moved to the end of the list of those that may go.
  used(name) {
    const tile = this.tiles.get(name);
    this.tiles.delete(name);
    this.tiles.set(name, tile);
    if (tile.lights !== this.lights) super.setCoefficients(this.projector.projectTile(tile.layer.field.boxes), tile.layer);
    tile.lights = this.lights;
    return tile;
  }

  /// Only what lies on the tile is drawn.
  clip({width, height}, {scale, shift: [left, top]}, spacing) {
    const first = (start) => Math.floor(-start / scale / spacing), last = (start, pixels) => Math.ceil((pixels - start) / scale / spacing);
    const rows = Math.ceil(this.field.height / spacing), x = Math.max(first(left), 0), y = Math.max(first(top), 0);
    const bottom = Math.max(Math.min(last(top, height), rows), y);
    this.gl.scissor(x, rows - bottom, Math.max(last(left, width) - x, 0), bottom - y);
  }

  waiting() {
    return this.wanted.filter(({name}) => !this.tiles.has(name) && !this.missing.has(name));
  }

  /// One after another; whoever looks elsewhere meanwhile gets the tiles there first.
  async loadNext() {
    const [next] = this.waiting();
    if (this.loading || !next) return;
    const {name} = this.loading = next;
    try {
      this.tiles.set(name, {layer: this.layerOf(await refield.loadTile(name)), lights: null});
      this.forget();
    } catch (error) {
      this.missing.add(name);
      console.warn(error.message);
    }
    this.loading = null;
    this.changed();
  }

  /// Those that were drawn the longest time ago.
  forget() {
    const inSight = new Set(this.wanted.map(({name}) => name));
    for (const [name, {layer}] of this.tiles) {
      if (this.tiles.size <= TiledRelighter.kept) return;
      if (inSight.has(name)) continue;
      for (const texture of layer.textures) this.gl.deleteTexture(texture);
      this.tiles.delete(name);
    }
  }

  pixelAt(x, y) {
    const at = ({scale, shift}) => [x, y].map((value, i) => Math.floor((value + 0.5) * scale + shift[i]));
    for (const tile of this.inSight()) {
      if (!this.tiles.has(tile.name)) continue;
      const {field} = this.tiles.get(tile.name).layer, [column, row] = at(this.placeOf(tile)), {side} = this.field.tiles;
      if (column < 0 || row < 0 || column >= field.width || row >= field.height) continue;
      return {field, column, row, x: (tile.column * side + column) * tile.stride, y: (tile.row * side + row) * tile.stride};
    }
    const {field} = this, [column, row] = at(this.placeOfOverview()).map((value, i) => Math.min(value, [field.width, field.height][i] - 1));
    return {field, column, row, x: column * field.tiles.stride, y: row * field.tiles.stride};
  }

  /// What the page says of the picture.
  describe() {
    const {width, height} = this.field.tiles, stride = this.stride(), waiting = this.waiting().length;
    const shown = stride === 1 ? 'all in sight' : `1 of ${stride}×${stride} in sight`;
    const missing = this.wanted.filter(({name}) => this.missing.has(name)).length;
    return `${width}×${height} pixels, ${shown}` + (waiting > 0 ? `, loading ${waiting}` : '') +
        (missing > 0 ? `, ${missing} tiles are missing: copy the whole folder` : '');
  }
}
