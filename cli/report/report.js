// SPDX-License-Identifier: Apache-2.0
// The page of `refield compare`, in reading order. Of several references of errors, the last one is the best.

pages.report = (data) => ({
  title: 'Reflectance field report',
  content: html`${[opening(data), summary(data), check(data.check), newLight(data), moreImages(data.fields), kernels(data),
                   statistics(data), timing(data)].map((part) => part ?? '')}`,
});

const label = (field) => key(field.number, field.label);
const last = (object) => Object.values(object).at(-1);
const kindName = (kind) => kind || 'all';
/// [[field, kind, error]] of all fields and kinds.
const errorsByKind = ({fields, kinds}) => fields.flatMap((field) => kinds
  .map((kind) => [field, kindName(kind), last(field.errors)?.[kindName(kind)]]).filter(([, , error]) => error));

/// Title, one prediction beside its photograph, the figures that matter most.
function opening({name, first, fields, kinds}) {
  const field = fields[0], errors = last(field.errors) ?? {};
  const tiles = [['natural', 'natural light'], ['bar', 'bars']].filter(([kind]) => errors[kind])
    .map(([kind, words]) => tile(percent(errors[kind].relative_rmse), `relative RMSE, held-out ${words}`));
  const other = errors[kindName(kinds[0])];  // pairs of images state no kind of light
  if (tiles.length === 0 && other) {
    tiles.push(tile(percent(other.relative_rmse), `relative RMSE, ${counted(other.images, 'held-out image')}`));
    if (other.spread) tiles.push(tile(percent(other.spread.median), 'relative RMSE of the median image'));
  }
  const figure = (image, title, text) =>
    html`<figure>${picture(image, title)}<figcaption><b>${title}</b> ${text}</figcaption></figure>`;
  return html`<header><p class="kicker">Reflectance field report</p><h1>${name}</h1>${first ? html`<div class="hero">
    ${figure(first.light, 'Light', 'on the display, never used in estimation')}
    ${figure(first.photograph, 'Photograph', 'of the scene under this light')}
    ${figure(first.prediction, 'Prediction', `by ${field.label}, same exposure`)}</div>` : ''}
    <div class="tiles">${tiles}${tile(fixed(field.statistics.mean_kernels, 1), 'kernels per pixel')}
    ${tile(significant(field.bytes_per_pixel, 3), 'bytes per pixel on disk')}
    ${tile(durationText(field.relight_ms / 1000), 'to relight a frame')}</div>
    ${fields.length > 1 ? html`<p class="note">Picture and figures above: ${field.label}.</p>` : ''}</header>`;
}

/// Session, fields, held-out errors by kind of light.
function summary(data) {
  const head = [split(html`<div>${sessionFacts(data)}</div>`, errorChart(data)), fieldTable(data.fields)];
  if (Object.keys(data.fields[0].errors).length === 0) {
    return section('Summary', head, html`<p class="note">The session has no held-out images (role “test”), so the error of
      predictions cannot be measured.</p>`);
  }
  return section('Summary', head, html`<h3>Error on held-out light</h3>`, errorTable(data), html`<p class="note">Relative
    RMSE, √(Σ(predicted − reference)² ∕ Σ reference²), over all images of a kind, pixels and channels; below it, the median
    and the 90th percentile of the same measure per pixel, and the PSNR of the tone-mapped images in dB (99th percentile
    white). “Photographs” contain camera noise, which cannot be predicted${data.truth_note ?
      `; “exact images” are ${data.truth_note}.` : '.'}${data.kinds.includes('black') ?
      ' Under black light the reference is almost zero: this error measures noise, not the field.' : ''}</p>`,
  spreadTable(data), predictionTable(data));
}

function sessionFacts({session, truth_note}) {
  const frames = (kinds) => {
    const total = Object.values(kinds).reduce((sum, count) => sum + count, 0);
    return total === 0 ? 'none' : `${total} (${Object.entries(kinds).map(([kind, count]) => `${count} ${kindName(kind)}`).join(', ')})`;
  };
  const rows = [
    [session.is_folder ? 'Session' : 'Image pairs', session.folder],
    ['Camera', `${session.width} × ${session.height} pixels`],
    ['Light map', `${session.light_width} × ${session.light_height} texels, ${session.parameterisation}`],
    ['Training images', frames(session.train)],
    ['Held-out images', frames(session.test)],
    ['Ambient image', session.ambient ? 'taken, subtracted' : 'none'],
    ['Mask', session.mask ? 'yes: pixels outside are ignored' : 'none: all pixels are used'],
  ];
  return facts(truth_note ? [...rows, ['Exact reference', truth_note]] : rows);
}

const fieldTable = (fields) => table(
  ['Field', 'Mode', '#Kernels per pixel, maximum', '#Stored, mean', '#Distinct boxes', '#File', '#Bytes per pixel'],
  fields.map((field) => [
    label(field), field.options?.mode ?? 'not recorded', field.options ? field.options.kernels || 'automatic' : '–',
    fixed(field.statistics.mean_kernels, 1), field.statistics.distinct_boxes, bytesText(field.file_bytes),
    significant(field.bytes_per_pixel, 3),
  ]));

function errorChart({fields, kinds}) {
  const shown = kinds.filter((kind) => kind !== 'black').map(kindName);
  const [reference] = Object.keys(fields[0].errors).slice(-1);
  if (shown.length === 0 || !reference) return '';
  return barChart({
    title: `Held-out relative RMSE against ${reference}`, y: 'relative RMSE', labelled: true, groups: shown,
    series: fields.map((field) => ({
      name: field.label, colour: field.number, values: shown.map((kind) => field.errors[reference][kind]?.relative_rmse),
    })),
  });
}

function errorTable({fields, kinds}) {
  const cell = (error) => error ? html`<b>${percent(error.relative_rmse)}</b><br><small>${percent(error.median)} ·
    ${percent(error.percentile_90)}</small><br><small>${isNumber(error.tone_mapped_psnr_db) ?
    fixed(error.tone_mapped_psnr_db, 1) : '∞'} dB</small>` : '';
  const rows = fields.flatMap((field) => Object.entries(field.errors).map(([reference, errors]) =>
    [label(field), reference, ...kinds.map((kind) => cell(errors[kindName(kind)]))]));
  return [table(['Field', 'Against', ...kinds.map((kind) => '#' + kindName(kind))], rows),
          fields.filter(({warning}) => warning).map((field) => html`<p><b>${field.label}: ${field.warning}</b>.</p>`)];
}

/// How far single images of a kind of light lie apart, and which is the worst.
function spreadTable(data) {
  const rows = errorsByKind(data).filter(([, kind, {spread}]) => spread && kind !== 'black')
    .map(([field, kind, {images, spread}]) => [label(field), kind, images, percent(spread.median), percent(spread.mean),
                                               percent(spread.largest), html`<code>${spread.worst}</code>`]);
  const columns = ['Field', 'Light', '#Images', '#Median', '#Mean', '#Largest', 'Image'];
  return rows.length === 0 ? '' : [html`<h3>Errors per image</h3>`, table(columns, rows)];
}

/// How well the predicted errors hold under each kind of held-out light.
function predictionTable(data) {
  const rows = errorsByKind(data).filter(([, , {predicted_error}]) => isNumber(predicted_error?.median_ratio))
    .map(([field, kind, {predicted_error}]) => [label(field), kind, percent(predicted_error.median),
                                                fixed(predicted_error.median_ratio, 2),
                                                fixed(predicted_error.rank_correlation, 2)]);
  if (rows.length === 0) return '';
  return [html`<h3>Predicted error by kind of light</h3>`,
          table(['Field', 'Light', '#Predicted, median pixel', '#Predicted ∕ true', '#Rank correlation'], rows),
          html`<p class="note">Predicted pixel by pixel from the training images alone, and compared with the error under
            held-out light, on ${Object.keys(data.fields[0].errors).at(-1)}: median of the ratio, and Spearman's rank
            correlation over the pixels.</p>`];
}

/// What a check of the photographs finds: verdict, path of the camera, gains, colour mixing, residual of each photograph.
function check(found) {
  if (!found) return '';
  const rows = found.rows.map((row) => [
    row.property, html`<b>${row.state}</b>`, row.measured,
    row.residual_before > 0 ? `${percent(row.residual_before)} → ${percent(row.residual_after)}` : '', row.remedy ?? '',
  ]);
  return section(
    'Check of the capture',
    html`<p>Whether photographs and lights obey B = T L, as <code>refield info</code> checks it: each photograph is compared
      with what the others predict under its light. What is corrected is corrected whenever photographs are read; the session
      stays as it was photographed.</p>`,
    table(['Property', 'State', 'Measured', '#Residual without → with correction', 'Remedy'], rows),
    split(rigChart('Residual of each photograph', 'median over pixels', [
      ['as photographed', 1, found.residuals_before], ['corrected', 0, found.residuals_corrected],
    ]), rigChart('Path of the camera', 'shift of the picture in pixels', [
      ['to the right', 0, found.shift_px.map(([x]) => x)], ['down', 1, found.shift_px.map(([, y]) => y)],
    ], true)),
    split(rigChart('Brightness and room light', 'relative change', [
      ...['red', 'green', 'blue'].map((channel, c) => [`gain, ${channel}`, c, found.gain.map((gain) => gain[c] - 1)]),
      ['room light', 3, found.room],
    ]), found.mixing ? html`<div><h3>Colour mixing</h3>${mixingTable(found.mixing)}</div>` : ''));
}

const mixingTable = (mixing) => table(['', '#red light', '#green light', '#blue light'], mixing.map((row, c) =>
  [html`<b>${['red', 'green', 'blue'][c]} channel</b>`, ...row.map((share) => fixed(share, 3))]));

/// Values of the photographs, from 1; nothing where no series has any.
function rigChart(title, y, series, plain = false) {
  const shown = series.filter(([, , values]) => values.length > 0);
  if (shown.length === 0) return '';
  const lowest = Math.min(0, ...shown.flatMap(([, , values]) => values));
  return lineChart({
    title, y, plain, x: 'training photograph', low: lowest < 0 ? -roundUp(-lowest) : 0,
    series: shown.map(([name, colour, values]) => ({name, colour, marks: 'points', points: values.map((value, j) => [j + 1, value])})),
  });
}

/// Light, photograph, prediction and error for held-out lights (Matusik et al. 2004, figures 1 and 6).
function newLight({pictures, fields, reference_name, false_colours}) {
  if (pictures.length === 0) return '';
  const figure = (image, title, detail) => html`<figure>${picture(image, title)}<figcaption>${title}
    ${detail ? html`<b>${detail}</b>` : ''}</figcaption></figure>`;
  const row = (light) => html`<div class="row"><p class="row-title"><b>${light.kind || 'light'}</b> <code>${light.name}</code>
    <span>exposure ×${significant(light.exposure, 2)} · error
    ${colourBar(false_colours, `${significant(100 * light.error_high, 2)} % of white and above`)}</span></p>
    <div class="grid" style="--columns:${2 + 2 * light.fields.length}">
    ${figure(light.light, `Light, ×${significant(light.light_exposure, 2)}`)}${figure(light.photograph, 'Photograph')}
    ${light.fields.map(({predicted, error, relative_rmse}, f) =>
      [figure(predicted, `Predicted, ${fields[f].label}`), figure(error, 'Error', percent(relative_rmse))])}</div></div>`;
  return section('Under new light', html`<p>The scene under held-out light: natural images, and the more difficult white bars
    and squares on black. Frames are selected evenly from the held-out series. In each row, the photograph and all predictions
    have the same exposure; errors (root mean square of the three channels, against the ${reference_name}) have the same
    colour scale. “White” is the radiance that is displayed as white.</p>`, pictures.map(row));
}

/// The colours of errors from 0 to `high`.
const colourBar = (colours, high) => html`<span class="colour-bar"><span>0</span><i
  style="background:linear-gradient(to right,${colours.join()})"></i><span>${high}</span></span>`;

/// Error against the number of images (figure 7) as the fields measured it, and whether more would help.
function moreImages(fields) {
  const known = fields.filter(({learning}) => learning);
  if (known.length === 0) return '';
  return section('Error against the number of images', split(html`<div><p>On a sparse grid of pixels, the field was also
    estimated from 25 %, 50 % and 80 % of the training images, and each estimate was tested on the remaining images. The curve
    extrapolates these errors, down to the photograph noise as the lower limit.</p>
    ${known.map(({label, learning}) => html`<p><b>${label}</b>: ${learning.advice}.</p>`)}</div>`, lineChart({
    title: 'Median pixel error against number of images', x: 'number of images relative to the training images',
    y: 'relative RMSE on new images', ticks: [0.25, 0.5, 1, 2],
    series: known.flatMap(({label, number, learning}) => [
      {name: `${label}: measured`, colour: number, points: learning.measured},
      {name: `${label}: extrapolated`, colour: number, dashed: true, points: learning.extrapolated},
    ]),
  })));
}

/// Kernels of chosen pixels while they are subdivided (figure 8).
function kernels({kernels: study, fields}) {
  if (study.pixels.length === 0) return '';
  const letter = (i) => String.fromCharCode(65 + i % 26), exact = Boolean(study.pixels[0].exact);
  const panel = (density, alt) => density ? html`<td>${picture(density, alt, 'kernel')}</td>` : html`<td class="done">–</td>`;
  const row = (pixel, i) => html`<tr><th>${letter(i)}</th>
    ${pixel.after.map((density, s) => panel(density, `pixel ${letter(i)}, ${study.subdivisions[s]} subdivisions`))}
    ${panel(pixel.in_field, `pixel ${letter(i)}, in the field`)}${exact ? panel(pixel.exact, `pixel ${letter(i)}, exact`) : ''}</tr>`;
  return section('Kernels of selected pixels', split(markedPhotograph(study, letter), html`<div><p>The reflectance of a pixel
    is a sum of kernels: rectangles of the light map, each with a weight. The estimation starts with one rectangle and splits it
    where this reduces the error most. The panels show the weights over the light map for the marked pixels after a number of
    splits (before spatial correction), in the field “${fields[0].label}”${exact ? ', and in the exact light transport of the scene' : ''}.
    Grey levels show the weight: white is the highest weight of the panel, black is zero.</p>
    ${facts(study.pixels.map(({kind, x, y}, i) => [letter(i), html`${kind} <small>(${x}, ${y})</small>`]), 'facts letters')}</div>`),
  html`<div class="wide"><table class="kernels"><thead><tr><th></th>${study.subdivisions.map((count) => html`<th>${count}</th>`)}
    <th>field</th>${exact ? html`<th>exact</th>` : ''}</tr></thead><tbody>${study.pixels.map(row)}</tbody></table></div>
    <p class="note">Up to ${study.kernels} kernels, mode ${study.mode}. Pixel classes are determined from the spread of the
    kernel energy, not from the scene description.${study.pixels.some(({after}) => after.includes(null)) ?
      ' “–”: no further split reduced the error.' : ''}${study.is_shrunk ?
      ' Each point of a panel shows the highest weight of the texels that it covers.' : ''}</p>`);
}

/// The photograph with rings around the pixels, whose letters go to the side where there is room.
function markedPhotograph({photograph, width, height, pixels}, letter) {
  const unit = width / 100;
  const mark = (pixel, i) => {
    const x = pixel.x + 0.5, y = pixel.y + 0.5, side = x > 0.9 * width ? -1 : 1;
    const ring = (css) => html`<circle class="${css}" cx="${x}" cy="${y}" r="${fixed(1.6 * unit, 2)}"/>`;
    return html`<g class="mark" style="--unit:${fixed(unit, 3)}px">${ring('halo')}${ring('')}<text
      text-anchor="${side < 0 ? 'end' : 'start'}" x="${fixed(x + 2.6 * side * unit, 1)}" y="${fixed(y + 1.7 * unit, 1)}">${letter(i)}</text></g>`;
  };
  return html`<div><svg class="marked" viewBox="0 0 ${width} ${height}" role="img"
    aria-label="photograph with the chosen pixels marked"><image width="${width}" height="${height}"
    preserveAspectRatio="none" href="${photograph.png}"/>${pixels.map(mark)}</svg></div>`;
}

/// Matusik et al. 2004, table 1: shares of kernels that are not zero, with 99 % and with 95 % of the energy.
const paperScenes = [['Hardrock', 0.774, 0.71, 0.608], ['Molasses', 0.978, 0.936, 0.839], ['Santa', 0.962, 0.924, 0.838],
                     ['Teacups', 0.993, 0.973, 0.888]];

/// Kernels that matter (table 1), kernels per pixel, predicted errors, maps of each field at the same scales.
function statistics({fields, predicted_high, maps, false_colours}) {
  const share = (value) => `${fixed(100 * value, 1)} %`, quiet = (content) => html`<span class="quiet">${content}</span>`;
  const rows = [
    ...fields.map((field) => [label(field), ...[field.statistics.nonzero_share, field.statistics.share_of_99_percent,
                                                field.statistics.share_of_95_percent].map(share)]),
    ...paperScenes.map(([name, ...shares]) => [quiet(html`${name} <small>(2004)</small>`), ...shares.map(share).map(quiet)]),
  ];
  const map = (field, {title, picture: image}, high) => html`<figure>${picture(image, `${field.label}: ${title}`)}<figcaption>
    ${field.label}: ${title}<br>${colourBar(false_colours, high)}</figcaption></figure>`;
  return section('Kernel statistics', html`<p>The fraction of the allowed kernels with a nonzero weight, and the smallest
    fractions that contain 99\u00a0% and 95\u00a0% of the energy of the scene (weight × area). Reflective and refractive scenes
    need fewer kernels. For comparison: table 1 of Matusik, Loper and Pfister (2004).</p>`,
  split(table(['Scene', '#Non-zero', '#99 % of energy', '#95 % of energy'], rows), kernelHistogram(fields),
        errorHistogram(fields.filter(({predicted}) => predicted), predicted_high)),
  fields.map((field) => html`<div class="grid maps" style="--columns:${1 + field.error_maps.length}">
    ${map(field, {title: 'kernels per pixel', picture: field.kernel_map}, fixed(maps.kernels_high, 0))}
    ${field.error_maps.map((error) => map(field, error, `${significant(100 * maps.error_high, 2)} % and above`))}</div>`));
}

function kernelHistogram(fields) {
  const longest = Math.max(...fields.map(({histogram}) => histogram.length));
  if (longest === 0) return '';
  return barChart({
    title: 'Kernels a pixel', x: 'stored kernels per pixel', y: 'fraction of pixels',
    groups: Array.from({length: longest}, (_, i) => i + 1),
    series: fields.map(({label, number, histogram}) => ({name: label, colour: number, values: histogram})),
  });
}

/// Shares of pixels by predicted error, in equal steps up to `high`; the last one takes all above.
function errorHistogram(fields, high) {
  if (fields.length === 0) return '';
  const steps = fields[0].predicted.length;
  return barChart({
    title: 'Predicted error of pixels', x: 'relative RMSE predicted for new photographs, upper end, %', y: 'fraction of pixels',
    groups: Array.from({length: steps}, (_, i) => i + 1 === steps ? 'more' : significant(100 * high * (i + 1) / steps, 2)),
    series: fields.map(({label, number, predicted}) => ({name: label, colour: number, values: predicted})),
  });
}

/// Time and memory of each stage, from its log, and of relighting.
function timing({logs, fields}) {
  const made = (path) => html`<span class="made"><code>${path}</code></span>`, small = (text) => html`<small>${text}</small>`;
  const rows = [
    ...logs.map((log) => [log.stage, made(log.made), durationText(log.seconds), log.peak_memory_bytes ?
      bytesText(log.peak_memory_bytes) : '–', log.threads ?? '–', small(log.details)]),
    ...fields.filter(({relight_ms}) => relight_ms > 0).map(({path, relight_ms, entries}) => [
      'relight', made(path), `${durationText(relight_ms / 1000)} per frame`, bytesText(16 * entries), 'all',
      small(`measured for this page: ${fixed(1000 / relight_ms, 0)} frames per second; memory: the field`)]),
  ];
  if (rows.length === 0) return '';
  return section('Time and memory', table(['Stage', 'Made', '#Time', '#Peak memory', '#Threads', 'Details'], rows),
                 html`<p class="note">From the logs of the last run of each stage. For comparison: the 2004 paper reports two
                   hours for a field of 1024 × 768 pixels from 180 images, and 0.5 frames per second for relighting, on a PC of
                   that time.</p>`);
}
