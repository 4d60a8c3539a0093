// SPDX-License-Identifier: Apache-2.0
// What mouse, touch, keys and dropped files do.
'use strict';

const controls = (() => {
  function connect(viewer) {
    connectInputs(viewer);
    connectCanvases(viewer);
    if (viewer.relighter.camera) connectCamera(viewer);
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
    on('background', 'change', (event) => { viewer.relighter.background = event.target.checked; viewer.changed(false); });
    Viewer.element('background').closest('.row').classList.toggle('off', !viewer.field.mesh);
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

  /// One pointer orbits, or pans with Shift or the right button; two pan and approach.
  function connectCamera(viewer) {
    const canvas = Viewer.element('scene'), pointers = new Map(), degreesPerPicture = 360, degreesPerKey = 5;
    canvas.setAttribute('aria-label', 'The mesh under the light; drag or press arrow keys to orbit, plus and minus to approach');
    canvas.classList.add('orbit');
    const middle = () => {
      const all = [...pointers.values()], sum = (key) => all.reduce((total, at) => total + at[key], 0) / all.length;
      return {x: sum('x'), y: sum('y'), spread: all.length < 2 ? 0 : Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y)};
    };
    const moved = (before, now, pans) => viewer.moveCamera((camera) => {
      const {width, height} = canvas.getBoundingClientRect(), pixels = Math.max(viewer.field.width / width, viewer.field.height / height);
      const right = now.x - before.x, down = now.y - before.y;
      if (pans) camera.pan(right * pixels, down * pixels);
      else camera.orbit(-right * degreesPerPicture / width, down * degreesPerPicture / width);
      if (before.spread > 0 && now.spread > 0) camera.approach(now.spread / before.spread);
    });
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!pointers.has(event.pointerId)) return;
      const before = middle();
      pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
      moved(before, middle(), pointers.size > 1 || event.shiftKey || (event.buttons & 2) !== 0);
    });
    for (const type of ['pointerup', 'pointercancel']) canvas.addEventListener(type, (event) => pointers.delete(event.pointerId));
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      const lines = event.deltaMode === 0 ? event.deltaY / 100 : event.deltaY / 3;
      viewer.moveCamera((camera) => camera.approach(1.1 ** -lines));
    }, {passive: false});
    canvas.addEventListener('keydown', (event) => {
      const turn = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
      const factor = {'+': 1.1, '=': 1.1, '-': 1 / 1.1}[event.key];
      if (!turn && !factor) return;
      event.preventDefault();
      viewer.moveCamera((camera) => {
        if (factor) camera.approach(factor);
        else camera.orbit(turn[0] * degreesPerKey, turn[1] * degreesPerKey);
      });
    });
    addEventListener('keydown', (event) => {
      if ((event.key === 'f' || event.key === 'F') && !event.ctrlKey && !event.metaKey && event.target.tagName !== 'INPUT')
        viewer.moveCamera((camera) => camera.reset());
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
