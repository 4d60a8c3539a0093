// SPDX-License-Identifier: Apache-2.0
// The page: what is shown, and when a frame is drawn.
'use strict';

class Viewer {
  static slowMs = 60;
  static restMs = 150;
  static pictureHelp = 'Click a pixel to see which light it gathers.';

  constructor(field) {
    this.field = field;
    this.projector = new light.Projector(field);
    this.relighter = new Relighter(Viewer.element('scene'), field);
    this.latLong = field.light.parameterisation === 'lat_long';
    this.lightContext = this.prepareLightCanvas();
    this.reset();
    controls.connect(this);
  }

  static element(id) {
    return document.getElementById(id);
  }

  prepareLightCanvas() {
    const canvas = Viewer.element('light');
    canvas.width = this.field.light.width;
    canvas.height = this.field.light.height;
    return canvas.getContext('2d');
  }

  reset() {
    this.state = {kind: 'bar', x: 0.5, y: 0.5, size: 0.2, colour: [1, 1, 1], stops: 0, degrees: 0, playing: false};
    this.map = this.panorama = null;
    this.picked = null;
    Viewer.element('colour').value = '#ffffff';
    this.changed();
  }

  /// The light of the current state.
  composed() {
    const {width, height} = this.field.light, {kind, x, y, size, colour, degrees} = this.state;
    if (kind === 'map' && this.panorama) return light.throughWindow(this.panorama, this.field.light.window, width, height, degrees);
    if (kind === 'map' && this.map) return degrees === 0 || !this.latLong ? this.map : light.rotated(this.map, degrees / 360);
    const map = light.black(width, height);
    if (kind === 'spot') light.addSpot(map, x * width, y * height, size * height / 2, colour, this.latLong);
    else light.addBar(map, this.barLeft(), size * width, colour, this.latLong);
    return map;
  }

  /// On a monitor the bar stays within the edges.
  barLeft() {
    const {width} = this.field.light, bar = this.state.size * width, left = this.state.x * width - bar / 2;
    return this.latLong ? left : Math.min(Math.max(left, 0), width - bar);
  }

  /// Asks for a frame; `lightChanged` is false where the exposure alone did.
  changed(lightChanged = true) {
    this.lightChanged ||= lightChanged;
    if (this.requested) return;
    this.requested = true;
    clearTimeout(this.refinement);
    this.refinement = null;
    requestAnimationFrame((time) => { this.requested = false; this.frame(time); });
  }

  /// Where a whole image takes long, drafts are drawn while something moves, and the whole when it rests.
  spacing() {
    const slow = this.wholeTime ?? 0;
    return slow < Viewer.slowMs ? 1 : slow < 4 * Viewer.slowMs ? 2 : 3;
  }

  refineLater() {
    this.refinement = setTimeout(() => {
      this.refinement = null;
      this.frame(performance.now(), 1);
    }, Viewer.restMs);
  }

  frame(time, spacing = this.spacing()) {
    if (this.state.playing) this.advance(time);
    const start = performance.now();
    if (this.lightChanged) {
      this.light = this.composed();
      const coefficients = this.projector.project(this.light);
      this.relighter.setCoefficients(coefficients);
      if (this.mapExposure === null && this.state.kind === 'map') this.mapExposure = this.relighter.exposureToWhite(coefficients);
    }
    const projected = performance.now();
    this.relighter.draw(this.exposure(), spacing);
    this.relighter.readPixels(0, 0, 1, 1);  // waits for the image
    this.timing = {light: projected - start, draw: performance.now() - projected};
    if (spacing === 1) this.wholeTime = this.timing.draw;
    if (this.lightChanged || this.pickedChanged) this.showLight();
    this.lightChanged = this.pickedChanged = false;
    this.showState();
    if (this.state.playing) this.changed();
    else if (spacing > 1) this.refineLater();
  }

  /// Maps are of any brightness; each is exposed for when it is shown first.
  exposure() {
    return (this.state.kind === 'map' ? this.mapExposure : this.field.exposure) * 2 ** this.state.stops;
  }

  /// The bar or light source crosses in eight seconds, there and back; a lat-long map turns in sixteen.
  advance(time) {
    const seconds = (time - (this.before ?? time)) / 1000;
    this.before = time;
    if (this.state.kind === 'map') {
      this.state.degrees = (this.state.degrees + seconds * 22.5) % 360;
    } else {
      this.phase = ((this.phase ?? this.state.x / (this.latLong ? 1 : 2)) + seconds / 16) % 1;
      this.state.x = this.latLong ? this.phase : 1 - Math.abs(1 - 2 * this.phase);
    }
    this.lightChanged = true;
  }

  showLight() {
    const most = this.light.values.reduce((a, b) => Math.max(a, b), 0);
    const gain = this.state.kind === 'map' && most > 0 ? 2 ** this.state.stops : 1;
    overlay.drawLight(this.lightContext, this.light, gain, this.picked);
  }

  showState() {
    const {state, field} = this, show = (id, text) => { Viewer.element(id).textContent = text; };
    show('status', `${this.relighter.describe()}, ${field.weights.length.toLocaleString('en')} weights; ` +
        `light ${this.timing.light.toFixed(1)} ms, image ${this.timing.draw.toFixed(1)} ms`);
    show('size-value', `${Math.round(state.size * 100)} %`);
    show('exposure-value', `${state.stops > 0 ? '+' : ''}${state.stops.toFixed(1)}`);
    show('rotation-value', `${Math.round(state.degrees)}°`);
    Viewer.element('size').value = state.size;
    Viewer.element('exposure').value = state.stops;
    Viewer.element('rotation').value = state.degrees;
    Viewer.element('play').setAttribute('aria-pressed', state.playing);
    show('play', state.playing ? 'Pause' : 'Play');
    document.querySelector(`input[name=kind][value=${state.kind}]`).checked = true;
    document.querySelector('input[value=map]').disabled = !this.map;
    const isMap = state.kind === 'map';
    for (const [id, on] of [['size', !isMap], ['colour', !isMap], ['rotation', isMap && this.turns()]])
      Viewer.element(id).closest('.row').classList.toggle('off', !on);
    show('light-caption', !isMap ? 'Drag the light.' : this.turns() ? 'Drag to turn the map.' : 'The loaded map.');
    this.showPicked();
  }

  showPicked() {
    const picked = this.picked, show = (id, text) => { Viewer.element(id).textContent = text; };
    if (!picked) {
      show('picked', Viewer.pictureHelp);
      show('kernels', '');
      return;
    }
    const total = picked.list.reduce((sum, {energy}) => sum + energy, 0);
    show('picked', `Pixel ${picked.x}, ${picked.y}: ${picked.list.length} kernels, over the light map in orange.`);
    show('kernels', picked.list.slice(0, 4).map(({kernel, energy}) =>
        `${kernel.hat ? 'hat' : 'box'} ${kernel.x0}–${kernel.x1} × ${kernel.y0}–${kernel.y1}: ${(100 * energy / total).toFixed(1)} %`).join(' · '));
  }

  /// The pixel at one of the canvas.
  pick(canvasX, canvasY) {
    const {field} = this, list = overlay.kernelsOfPixel(field, canvasX, canvasY);
    this.picked = {x: canvasX, y: canvasY, list, gathered: overlay.gathered(field, list)};
    this.pickedChanged = true;
    this.changed(false);
  }

  release() {
    this.picked = null;
    this.pickedChanged = true;
    this.changed(false);
  }

  /// Whether the map can be turned: one of all directions.
  turns() {
    return this.latLong || this.panorama !== null;
  }

  async load(file) {
    try {
      this.show(await mapFile.read(file));
    } catch (error) {
      Viewer.fail(error);
    }
  }

  /// One of the maps that the page brings along.
  async loadIncluded(index) {
    try {
      this.show(await refield.loadMap(index));
    } catch (error) {
      Viewer.fail(error);
    }
  }

  /// A monitor whose place is known shows a map twice as wide as high as a window onto it.
  show(map) {
    const {width, height, window} = this.field.light;
    this.panorama = window && map.width === 2 * map.height && (map.width !== width || map.height !== height) ? map : null;
    this.map = this.panorama ?? light.resampled(map, width, height);
    this.mapExposure = null;
    Object.assign(this.state, {kind: 'map', degrees: 0});
    this.changed();
  }

  move(dx, dy) {
    const {state} = this, wrapped = (v) => v - Math.floor(v), clamped = (v) => Math.min(Math.max(v, 0), 1);
    if (state.kind === 'map') {
      if (this.turns()) state.degrees = wrapped(state.degrees / 360 + dx) * 360;
    } else {
      state.x = this.latLong ? wrapped(state.x + dx) : clamped(state.x + dx);
      state.y = clamped(state.y + dy);
    }
    this.changed();
  }

  static fail(error) {
    const status = Viewer.element('status');
    status.textContent = error.message;
    status.classList.add('error');
  }
}

let viewer = null;  // for scripts and the console
(async () => {
  try {
    const field = await refield.loadField((share) => {
      Viewer.element('status').textContent = `Loading ${Math.round(100 * share)} %`;
    });
    document.title = Viewer.element('title').textContent = field.title;
    viewer = new Viewer(field);
  } catch (error) {
    Viewer.fail(error);
  }
})();
