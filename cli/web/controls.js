// SPDX-License-Identifier: Apache-2.0
// What mouse, touch, keys and dropped files do.
'use strict';

const controls = (() => {
  function connect(viewer) {
    connectInputs(viewer);
    connectCanvases(viewer);
    addEventListener('dragover', (event) => event.preventDefault());
    addEventListener('drop', (event) => {
      event.preventDefault();
      if (event.dataTransfer.files.length > 0) viewer.load(event.dataTransfer.files[0]);
    });
    addEventListener('keydown', (event) => {
      const step = {ArrowLeft: [-0.01, 0], ArrowRight: [0.01, 0], ArrowUp: [0, -0.01], ArrowDown: [0, 0.01]}[event.key];
      if (step && !event.defaultPrevented && event.target.tagName !== 'INPUT') { event.preventDefault(); viewer.move(...step); }
      if (event.key === 'Escape') viewer.release();
    });
  }

  function connectInputs(viewer) {
    const on = (id, type, action) => Viewer.element(id).addEventListener(type, action);
    on('kinds', 'change', (event) => { viewer.state.kind = event.target.value; viewer.changed(); });
    on('size', 'input', (event) => { viewer.state.size = Number(event.target.value); viewer.changed(); });
    on('exposure', 'input', (event) => { viewer.state.stops = Number(event.target.value); viewer.changed(false); });
    on('rotation', 'input', (event) => { viewer.state.degrees = Number(event.target.value); viewer.changed(); });
    on('colour', 'input', (event) => {
      viewer.state.colour = [1, 3, 5].map((i) => mapFile.linearFromSrgb[parseInt(event.target.value.slice(i, i + 2), 16)]);
      viewer.changed();
    });
    on('map-file', 'change', (event) => { if (event.target.files.length > 0) viewer.load(event.target.files[0]); });
    const maps = Viewer.element('maps');
    viewer.field.maps.forEach(({name}, index) => maps.add(new Option(name, index)));
    maps.closest('.row').classList.toggle('off', viewer.field.maps.length === 0);
    on('maps', 'change', () => { if (maps.value !== '') viewer.loadIncluded(Number(maps.value)); });
    on('reset', 'click', () => viewer.reset());
    on('play', 'click', () => {
      viewer.state.playing = !viewer.state.playing;
      viewer.before = viewer.phase = undefined;
      viewer.changed();
    });
  }

  function connectCanvases(viewer) {
    const canvas = Viewer.element('light');
    let dragged = null;
    const place = (event) => {
      const area = canvas.getBoundingClientRect();
      return [(event.clientX - area.left) / area.width, (event.clientY - area.top) / area.height];
    };
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      dragged = place(event);
      // A light jumps to the pointer; a map turns from where it is.
      if (viewer.state.kind !== 'map') viewer.move(dragged[0] - viewer.state.x, dragged[1] - viewer.state.y);
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!dragged) return;
      const [x, y] = place(event), [oldX] = dragged;
      dragged = [x, y];
      if (viewer.state.kind === 'map') viewer.move(x - oldX, 0);
      else viewer.move(x - viewer.state.x, y - viewer.state.y);
    });
    for (const type of ['pointerup', 'pointercancel']) canvas.addEventListener(type, () => { dragged = null; });
    Viewer.element('scene').addEventListener('click', (event) => {
      viewer.pick(...pixelAt(event, viewer.field));
    });
  }

  /// The canvas may be letterboxed within its element (object-fit: contain).
  function pixelAt(event, field) {
    const area = event.target.getBoundingClientRect(), {width, height} = field;
    const scale = Math.min(area.width / width, area.height / height);
    const at = (position, start, length, pixels) =>
        Math.min(Math.max(Math.floor((position - start - (length - pixels * scale) / 2) / scale), 0), pixels - 1);
    return [at(event.clientX, area.left, area.width, width), at(event.clientY, area.top, area.height, height)];
  }

  return {connect};
})();
