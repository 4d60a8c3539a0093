// SPDX-License-Identifier: Apache-2.0
// What the pages of `refield compare` and `refield acquire calibrate` are made of: text, numbers, tables, charts.
// The program writes what it measured as JSON into #data; the pages' own scripts, below, draw it.
'use strict';

/// HTML, as opposed to text, which is escaped wherever it becomes a part of HTML.
class Markup extends String {}

const escaped = (text) => String(text).replace(/[&<>"']/g, (letter) => `&#${letter.charCodeAt(0)};`);

function written(part) {
  if (Array.isArray(part)) return part.map(written).join('');
  return part instanceof Markup ? String(part) : escaped(part ?? '');
}

const html = (text, ...parts) => new Markup(text.reduce((all, next, i) => all + written(parts[i - 1]) + next));

// Numbers as text. A number that is not finite is null in JSON and a dash on the page.

const isNumber = (value) => Number.isFinite(value);
const fixed = (value, decimals) => isNumber(value) ? value.toFixed(decimals) : '–';
const decade = (value) => Math.floor(Math.log10(Math.abs(value)) + 1e-9);

/// With a number of significant digits, never in exponent form: "0.0123", "340".
function significant(value, digits) {
  if (!isNumber(value)) return '–';
  if (value === 0) return '0';
  const rounded = Number(value.toPrecision(digits));
  return fixed(rounded, Math.max(0, digits - 1 - decade(rounded)));
}

const percent = (fraction) => isNumber(fraction) ? significant(100 * fraction, 3) + '\u00a0%' : '–';
const counted = (count, noun) => `${count} ${noun}${count === 1 ? '' : 's'}`;
/// Four digits without idle zeros: "25", "0.5".
const short = (value) => String(Number(significant(value, 4)));

function bytesText(bytes) {
  const units = ['bytes', 'kB', 'MB', 'GB', 'TB'];
  let unit = 0;
  for (; bytes >= 999.5 && unit + 1 < units.length; ++unit) bytes /= 1000;
  return `${unit === 0 ? fixed(bytes, 0) : significant(bytes, 3)} ${units[unit]}`;
}

function durationText(seconds) {
  if (!isNumber(seconds)) return '–';
  if (seconds < 0.9995) return significant(1000 * seconds, 2) + ' ms';
  if (seconds < 59.95) return significant(seconds, seconds < 9.95 ? 2 : 3) + ' s';
  const whole = Math.round(seconds), minutes = Math.floor((whole + 30) / 60);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${whole % 60} s`;
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

// Parts of a page.

const section = (heading, ...content) => html`<section><h2>${heading}</h2>${content}</section>`;
const tile = (figure, meaning) => html`<div class="tile"><b>${figure}</b><span>${meaning}</span></div>`;
const split = (...columns) => html`<div class="split">${columns}</div>`;
const key = (colour, name) => html`<span class="key c${colour % 6}"><i></i>${name}</span>`;
const picture = ({width, height, png}, alt, css = 'photo') =>
  html`<img class="${css}" width="${width}" height="${height}" alt="${alt}" src="${png}">`;

/// Columns whose name begins with # hold numbers.
function table(columns, rows) {
  const css = columns.map((name) => name.startsWith('#') ? html` class="num"` : '');
  const line = (tag, cells) => html`<tr>${cells.map((cell, i) => html`<${tag}${css[i]}>${cell}</${tag}>`)}</tr>`;
  return html`<div class="wide"><table><thead>${line('th', columns.map((name) => name.replace(/^#/, '')))}</thead>
    <tbody>${rows.map((cells) => line('td', cells))}</tbody></table></div>`;
}

const facts = (rows, css = 'facts') => html`<table class="${css}">${rows.map(([name, value]) => html`<tr><th>${name}</th><td>${value}</td></tr>`)}</table>`;

// Charts: inline SVG that takes its colours from the page. A series has a name, the number of a colour and points
// [[x, y]] (lines) or values [groups] (bars); what is not finite is left out. Values are percentages unless the
// chart is `plain`.

const area = {left: 58, right: 14, top: 30, bottom: 46, height: 270, width: 520};

const linear = (low, high, from, to) => (value) => high === low ? (from + to) / 2 : from + (value - low) / (high - low) * (to - from);

/// Round numbers, 1, 2 or 5 times a power of ten apart, inside [low, high]: about `count` of them, at least two.
function roundTicks(low, high, count) {
  if (!(high > low)) return [low];
  const rough = (high - low) / count, unit = 10 ** Math.floor(Math.log10(rough)), slack = 1e-9;
  let step = unit * ([1, 2, 5].find((multiple) => multiple * unit >= rough * (1 - slack)) ?? 10);
  const first = () => Math.ceil(low / step - slack), last = () => Math.floor(high / step + slack);
  while (last() - first() < 1) step /= 2;
  return Array.from({length: last() - first() + 1}, (_, i) => (first() + i) * step);
}

/// The smallest round number (1, 2, 2.5 or 5 times a power of ten) that is not below `value` > 0.
function roundUp(value) {
  const unit = 10 ** Math.floor(Math.log10(value));
  return unit * ([1, 2, 2.5, 5].find((multiple) => multiple * unit >= value * (1 - 1e-9)) ?? 10);
}

const svgText = (x, y, css, content) => html`<text class="${css}" x="${fixed(x, 1)}" y="${fixed(y, 1)}">${content}</text>`;

/// What all charts share: title, labels, horizontal grid with its numbers. `y` places values of [low, high].
function chartSvg(chart, low, high, y, content) {
  const ticks = roundTicks(low, high, 5), unit = chart.plain ? 1 : 100;
  const decimals = ticks.length > 1 ? Math.max(0, -decade((ticks[1] - ticks[0]) * unit)) : 0;
  const right = area.width - area.right, middle = (area.top + area.height - area.bottom) / 2;
  return html`<svg class="chart" role="img" viewBox="0 0 ${area.width} ${area.height}" aria-label="${chart.title}">
    ${svgText(area.left, 14, 'chart-title', chart.title)}
    ${ticks.map((tick) => html`<line class="grid" x1="${area.left}" x2="${right}" y1="${y(tick)}" y2="${y(tick)}"/>
      ${svgText(area.left - 6, y(tick) + 4, 'tick-y', fixed(tick * unit, decimals) + (chart.plain ? '' : ' %'))}`)}
    ${svgText((area.left + right) / 2, area.height - 6, 'axis-label', chart.x ?? '')}
    <text class="axis-label" transform="translate(12 ${middle}) rotate(-90)">${chart.y}</text>${content}</svg>`;
}

const valueText = (chart, value) => chart.plain ? significant(value, 3) : percent(value);
const headroom = (highest) => highest > 0 ? highest * 1.08 : 1;

/// With the legend of its series; those that repeat another's data (`unnamed`) are not in it.
function chartBox(svg, series) {
  const entry = ({colour, dashed, name}) => html`<span class="key c${colour % 6}${dashed ? ' dashed' : ''}"><i></i>${name}</span>`;
  return html`<div class="chart-box">${svg}<p class="legend">${series.filter(({unnamed}) => !unnamed).map(entry)}</p></div>`;
}

/// Series are lines with points unless they have `marks`, "line" or "points".
function lineChart(chart) {
  const series = chart.series.map((one) => ({...one, points: one.points.filter((point) => point.every(isNumber))}));
  const xs = series.flatMap(({points}) => points.map(([x]) => x)), ys = series.flatMap(({points}) => points.map(([, y]) => y));
  const xLow = Math.min(...xs), xHigh = Math.max(...xs), low = chart.low ?? 0, highest = Math.max(0, ...ys);
  const high = highest === 0 && low < 0 ? 0 : headroom(highest);
  const x = linear(xLow, xHigh, area.left + 12, area.width - area.right - 12);
  const y = linear(low, high, area.height - area.bottom, area.top);
  const tick = (value) => html`<line class="tick" x1="${x(value)}" x2="${x(value)}" y1="${y(low)}" y2="${y(low) + 4}"/>
    ${svgText(x(value), y(low) + 17, 'tick-x', short(value))}`;
  const mark = (name, [px, py]) => html`<circle cx="${fixed(x(px), 1)}" cy="${fixed(y(py), 1)}" r="3.5">
    <title>${name}, ${short(px)}: ${valueText(chart, py)}</title></circle>`;
  const drawn = ({name, colour, dashed, marks, points}) => html`<g class="series c${colour % 6}${dashed ? ' dashed' : ''}">
    <path d="${marks === 'points' || points.length === 0 ? '' : 'M' + points.map(([px, py]) => `${fixed(x(px), 1)} ${fixed(y(py), 1)}`).join('L')}"/>
    ${marks === 'line' ? '' : points.map((point) => mark(name, point))}</g>`;
  const ticks = chart.ticks ?? roundTicks(xLow, xHigh, 6);
  return chartBox(chartSvg(chart, low, high, y, [ticks.map(tick), series.map(drawn)]), series);
}

/// Bars side by side, a group for each of chart.groups, y axis from zero; `labelled` writes each value above its bar.
function barChart(chart) {
  const high = headroom(Math.max(0, ...chart.series.flatMap(({values}) => values.filter(isNumber))));
  const y = linear(0, high, area.height - area.bottom, area.top);
  const groupWidth = (area.width - area.left - area.right) / chart.groups.length;
  const barWidth = Math.min(46, 0.84 * groupWidth / chart.series.length);
  const every = Math.max(1, Math.ceil(22 / groupWidth));  // names that would run into each other are thinned out
  const bar = ({name, colour, values}, s, group, g, centre) => {
    const value = values[g], x = centre + (s - chart.series.length / 2) * barWidth;
    if (!isNumber(value)) return '';
    const above = significant(value * (chart.plain ? 1 : 100), 2);
    return html`<rect class="bar c${colour % 6}" x="${fixed(x, 1)}" y="${fixed(y(value), 1)}" width="${fixed(barWidth * 0.94, 1)}"
      height="${fixed(y(0) - y(value), 1)}"><title>${name}, ${group}: ${valueText(chart, value)}</title></rect>
      ${chart.labelled ? svgText(x + barWidth * 0.47, y(value) - 4, 'bar-value', above) : ''}`;
  };
  const bars = chart.groups.map((group, g) => {
    const centre = area.left + (g + 0.5) * groupWidth;
    return [g % every === 0 ? svgText(centre, y(0) + 17, 'tick-x', group) : '',
            chart.series.map((series, s) => bar(series, s, group, g, centre))];
  });
  return chartBox(chartSvg(chart, 0, high, y, bars), chart.series);
}

/// Shows the values of a chart at the pointer, or at the position that the arrow keys choose.
function connectChart(svg) {
  const groups = new Map();  // position on the x axis -> its marks
  for (const mark of svg.querySelectorAll('circle, .bar')) {
    const title = mark.querySelector('title'), parts = /^(.*), ([^,]*): (.*)$/.exec(title.textContent);
    if (!parts) continue;
    const [, name, place, value] = parts, box = mark.getBBox();
    if (!groups.has(place)) groups.set(place, {place, marks: []});
    groups.get(place).marks.push({name, value, x: box.x + box.width / 2, colour: getComputedStyle(mark).fill});
    mark.setAttribute('aria-label', title.textContent);
    title.remove();
  }
  const places = [...groups.values()];
  if (!places.length) return;
  for (const p of places) p.x = p.marks.reduce((sum, mark) => sum + mark.x, 0) / p.marks.length;
  places.sort((a, b) => a.x - b.x);
  const ground = [...svg.querySelectorAll('.grid')].map(line => +line.getAttribute('y1'));
  const hairline = document.createElementNS(svg.namespaceURI, 'line'), tip = document.createElement('div');
  hairline.setAttribute('class', 'hairline');
  hairline.setAttribute('y1', Math.min(...ground));
  hairline.setAttribute('y2', Math.max(...ground));
  tip.className = 'tip';
  tip.setAttribute('role', 'status');
  let chosen = -1;
  const hide = () => { chosen = -1; hairline.remove(); tip.remove(); };
  const show = index => {
    if (index === chosen) return;
    chosen = index;
    const {x, place, marks} = places[index], width = svg.viewBox.baseVal.width;
    hairline.setAttribute('x1', x);
    hairline.setAttribute('x2', x);
    svg.prepend(hairline);
    const heading = document.createElement('b'), axis = svg.querySelector('.axis-label').textContent;
    heading.textContent = axis ? axis + ': ' + place : place;
    tip.replaceChildren(heading, ...marks.map(mark => {
      const row = document.createElement('div');
      row.style.setProperty('--colour', mark.colour);
      row.textContent = mark.name + ': ' + mark.value;
      return row;
    }));
    const [near, far] = x < width / 2 ? ['left', 'right'] : ['right', 'left'];
    tip.style[near] = `calc(${100 * (near === 'left' ? x : width - x) / width}% + 10px)`;
    tip.style[far] = 'auto';
    svg.parentNode.append(tip);
  };
  const nearest = event => {
    const x = new DOMPoint(event.clientX, 0).matrixTransform(svg.getScreenCTM().inverse()).x;
    show(places.reduce((best, p, i) => Math.abs(p.x - x) < Math.abs(places[best].x - x) ? i : best, 0));
  };
  svg.tabIndex = 0;
  svg.addEventListener('pointermove', nearest);
  svg.addEventListener('pointerdown', nearest);
  svg.addEventListener('pointerleave', hide);
  svg.addEventListener('blur', hide);
  svg.addEventListener('keydown', event => {
    const step = {ArrowLeft: -1, ArrowRight: 1}[event.key];
    if (!step) return;
    event.preventDefault();
    show(Math.min(places.length - 1, Math.max(0, chosen + step)));
  });
}

const pages = {};  // by kind: what draws the page's data

/// Draws the page once all scripts have been read.
addEventListener('DOMContentLoaded', () => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const {title, content} = pages[data.page](data);
  document.title = title;
  document.getElementById('command').textContent = data.command;
  document.getElementById('content').innerHTML = content;
  document.querySelectorAll('svg.chart').forEach(connectChart);
});
