// SPDX-License-Identifier: Apache-2.0
// The page of `refield acquire calibrate`: what was measured, what it means and what to do about it.

pages.calibration = (rig) => ({
  title: `Calibration of ${rig.camera}`,
  content: html`${[verdict(rig), superposition(rig), rig.streams ? [displayTiming(rig), banding(rig)] : '', camera(rig),
                   toneCurves(rig.tone_curves), rig.maps.map(uniformity)]}`,
});

const milliseconds = (seconds) => `${significant(1000 * seconds, 3)}\u00a0ms`;

function verdict(rig) {
  const unit = rig.exposure_unit_s;
  const tiles = [
    tile(milliseconds(rig.display_latency_s + rig.display_settling_s),
         `${rig.streams ? '' : 'assumed '}from a page flip until the light is stable`),
    rig.streams ? tile(counted(rig.control_latency_frames, 'frame'), 'until camera settings take effect') : '',
    rig.streams ? tile(unit > 0 ? milliseconds(unit) : 'any', 'step of exposure times without banding') : '',
    tile(significant(rig.electrons_per_dn, 3), 'electrons per DN, at gain 1'),
    tile(significant(rig.read_noise_electrons, 3), 'electrons of read noise'),
    tile(percent(Math.max(...rig.superposition.map(({error}) => Math.abs(error)))), 'largest error of superposition'),
  ];
  return html`<p class="kicker">Calibration</p><h1>${rig.camera} and ${rig.display}</h1><p>${rig.superposition_holds ?
    'Light is additive: sessions captured with this calibration are valid within the errors below.' :
    html`<strong>Light is not additive (see Superposition). Do not capture with these device settings: relighting would be
      wrong.</strong>`}</p><div class="tiles">${tiles}</div>${rig.warnings.length === 0 ? html`<p class="note">No warnings.</p>` :
    html`<h3>Warnings</h3><ul>${rig.warnings.map((warning) => html`<li>${warning}</li>`)}</ul>`}`;
}

function superposition({superposition_holds: holds, superposition: pairs, tolerance}) {
  const share = (value) => `${fixed(100 * value, 3)} %`;
  return section(`Superposition: ${holds ? 'holds' : 'broken'}`, html`<p>I(A) + I(B) − I(black) must equal I(A+B), since
    relighting assumes it. An error above ${percent(tolerance)} indicates a display that dims itself: turn off dynamic contrast,
    local dimming, power saving and automatic brightness; on OLED displays, reduce the brightness until the power limit is not
    reached.</p>`, table(['Patterns A and B', '#error', '#± noise', '#worst block'], pairs.map(({patterns, error, uncertainty, worst_block}) =>
    [patterns, share(error), share(uncertainty), share(worst_block)])));
}

function displayTiming({display_latency_s: latency, display_settling_s: settling, display_changes: display,
                        control_latency_frames: late, exposure_step: control}) {
  const end = latency + settling, shown = 3 * end;
  const frames = (changes) => changes.filter(([middle]) => middle <= shown).map(([middle, share]) => [1000 * middle, share]);
  const change = lineChart({
    title: 'Change of light after a page flip', x: 'time since the page flip, ms', y: 'fraction of the new light',
    series: [
      {name: 'up', colour: 0, marks: 'points', points: frames(display.rising)},
      {name: 'down', colour: 1, marks: 'points', points: frames(display.falling)},
      {name: 'fit for instants', colour: 5, dashed: true, marks: 'line',
       points: [[0, 0], [1000 * latency, 0], [1000 * end, 1], [1000 * shown, 1]]},
    ],
  });
  const step = lineChart({
    title: 'Brightness after a change of exposure', x: 'frames since the change', y: 'mean of lit samples, DN', plain: true,
    series: [{name: 'frames', colour: 0, points: control.level_dn.slice(0, 16).map((level, i) => [i, level])}],
  });
  return section('Timing of light and settings', split(
    html`<div>${change}<p>Each point is a frame during a change of the display: the fraction of the new light against the centre
      of its exposure. Light starts to change ${milliseconds(latency)} after the time stamp of the page flip and is
      stable ${milliseconds(end)} after it (up: ${milliseconds(display.rise_settling)} of change, down:
      ${milliseconds(display.fall_settling)}). The capture uses a frame for a pattern only if its exposure started later; no
      fixed delay is needed.</p></div>`,
    html`<div>${step}<p>The exposure was set to ${significant(control.expected_ratio, 2)} times the previous time at frame 0.
      ${counted(late, 'frame')} still had the old exposure; the capture discards as many frames after every change,
      whatever the driver reports.</p></div>`));
}

function banding({banding: {deviation, noise}, ripples, exposure_unit_s: unit, refresh_period_s: refresh_period}) {
  const largest = Math.max(0.005, ...deviation.map(([, relative]) => Math.abs(relative)));
  const chart = lineChart({
    title: 'Brightness per second of exposure', x: 'exposure, ms', y: 'relative to a smooth curve', low: -1.08 * largest,
    series: [{name: 'frames', colour: 0, marks: 'points', points: deviation.map(([exposure, relative]) => [1000 * exposure, relative])}],
  });
  const flicker = ripples.length === 0 ?
    `Brightness per second does not depend on the exposure time: no flicker between 20 Hz and 2 kHz was detected, so any
     exposure time is valid. The remaining deviation, ${percent(noise)} RMS from frame to frame, has no period: slow drift of
     the light, or noise.` :
    `The light flickers at ${significant(ripples[0].hz, 5)} Hz by ${percent(ripples[0].depth)}. Exposures that are not a whole
     number of periods vary in brightness; the capture rounds exposure times to multiples of ${milliseconds(unit)}.
     Flicker that remains at the highest brightness of the display comes from the room light: switch it off.`;
  const refresh = refresh_period > 0 ?
    `The display refreshes every ${milliseconds(refresh_period)} (${significant(1 / refresh_period, 4)} Hz).` : '';
  return section('Banding', split(chart, html`<p>${flicker} ${refresh}</p>`));
}

function camera(rig) {
  const {response, electrons_per_dn, read_noise_electrons, full_well_electrons} = rig;
  const curve = lineChart({
    title: 'Response', x: 'raw sample, DN', y: 'light, fraction of saturation',
    series: [{name: 'measured', colour: 0, marks: 'points', points: response.points},
             {name: 'table', colour: 1, marks: 'line', points: response.table}],
  });
  // The full well and the range give the slope at the gain that was used.
  const slope = response.range_dn / full_well_electrons, dark = (read_noise_electrons * slope) ** 2;
  const top = rig.noise.at(-1)?.[0] ?? 1;
  const transfer = lineChart({
    title: 'Photon transfer', x: 'signal above black, linear DN', y: 'variance, DN²', plain: true,
    series: [{name: 'measured', colour: 0, marks: 'points', points: rig.noise},
             {name: 'read noise² + signal / (electrons per DN)', colour: 1, marks: 'line', points: [[0, dark], [top, dark + slope * top]]}],
  });
  return section('The camera', split(
    html`<div>${curve}<p>Without light the camera returns ${significant(rig.black_level_dn, 4)} DN; samples from
      ${fixed(rig.saturation_dn, 0)} DN on may be clipped${rig.saturation_seen ? '' : ' (full scale: no sample was saturated)'}.
      Between them, samples are ${rig.linear ? 'proportional to light.' : 'nonlinear; the table in the calibration file linearises them.'}
      Points deviate by ${percent(rig.response_residual)} of the range. A curve with steps, or a deviation of more than 1 %, indicates
      automatic camera settings.</p></div>`,
    html`<div>${transfer}<p>Photon noise has a variance proportional to light: from the slope, one DN corresponds to
      ${significant(electrons_per_dn, 3)} electrons (at gain 1); from the intercept, the read noise is
      ${significant(read_noise_electrons, 3)} electrons. The sensor has ${significant(full_well_electrons, 3)}
      electrons at saturation: the lowest relative noise of a single sample is
      ${percent(1 / Math.sqrt(Math.max(1, full_well_electrons)))}. Points below the line at the bright end indicate denoising
      in the camera, points above it a flickering light.</p></div>`));
}

function toneCurves(channels) {
  const series = (points, marks, unnamed) => channels.map((channel, c) => ({name: channel.name, colour: [1, 2, 0][c], marks, unnamed,
                                                                          points: channel[points]}));
  const chart = lineChart({
    title: 'Tone curves', x: 'drive level', y: 'radiance relative to white',
    series: [...series('table', 'line', false), ...series('measured', 'points', true)],
  });
  return section('The display\'s tone curves', split(chart, html`<p>Radiance of each channel against drive level, above black,
    relative to white: points are measured, lines are written to the calibration file. Patterns are converted with the inverse
    curves, so that the display shows the requested radiance. A curve that is flat before level 255 indicates a contrast setting
    that is too high; one that is dark for many levels, a brightness setting that is too low.</p>`));
}

const uniformity = ({heading, map, lowest, text}) => section(heading, split(html`<figure>${picture(map, heading)}<figcaption>
  black 0, white 1; lowest ${percent(lowest)}</figcaption></figure>`, html`<p>${text}</p>`));
