/* Charts of means with their intervals: rows for names, lines over a number. */
import { number, svg } from "./page.js";

/** A step of 1, 2 or 5 times a power of ten, at least as large as asked. */
function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(Math.max(rough, 1e-300)));
  return [1, 2, 5, 10].find((step) => step * power >= rough) * power;
}

export function ticksOf(low, high, count) {
  const step = niceStep((high - low) / count), found = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-9; tick += step) found.push(tick);
  return found;
}

/** A tick with as many digits as tell it from the next one. */
export function tickText(tick, ticks) {
  const step = Math.abs((ticks[1] ?? tick + 1) - (ticks[0] ?? tick)) || 1;
  return Math.abs(tick) < step / 1e6 ? "0" : number(tick, Math.min(15, Math.max(4, Math.ceil(Math.log10(Math.abs(tick) / step)) + 1)));
}

/** Whether the page is one column: then a chart has fewer words beside it. */
const isNarrow = () => matchMedia("(max-width: 40rem)").matches;

const ends = (one) => [one.mean, one.low ?? one.mean, one.high ?? one.mean];

/** Ends of an axis that holds all values, with a little room. */
function span(values) {
  const low = Math.min(...values), high = Math.max(...values), room = (high - low || Math.abs(high) || 1) * 0.06;
  return [low - room, high + room];
}

/** Rows: each a label, a mean, its interval, and perhaps its trials; `best` rows stand out. */
export function rowsChart(rows, words) {
  const narrow = isNarrow(), width = narrow ? 360 : 640, row = 46, left = narrow ? 120 : 190, right = narrow ? 14 : 30, most = narrow ? 16 : 26, height = rows.length * row + 34;
  const [low, high] = span(rows.flatMap((one) => [...(one.values ?? []), ...ends(one)]));
  const x = (value) => left + ((value - low) / (high - low)) * (width - left - right);
  return svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": words },
    ticksOf(low, high, narrow ? 3 : 5).flatMap((tick, _, ticks) => [
      svg("line", { class: "rule", x1: x(tick), x2: x(tick), y1: 4, y2: height - 24 }),
      svg("text", { class: "tick", x: x(tick), y: height - 8, "text-anchor": "middle" }, tickText(tick, ticks)),
    ]),
    rows.map((one, i) => {
      const y = i * row + row / 2 + 4;
      return svg("g", { class: one.best ? "best" : "" },
        svg("text", { class: "name", x: left - 14, y: y + 4, "text-anchor": "end" }, one.label.length > most ? `${one.label.slice(0, most - 1)}…` : one.label),
        (one.values ?? []).slice(0, 300).map((value) => svg("circle", { class: "trial", cx: x(value), cy: y, r: 3 })),
        one.low === null || one.low === undefined ? [] : svg("line", { class: "interval", x1: x(one.low), x2: x(one.high), y1: y, y2: y }),
        svg("circle", { class: "mean", cx: x(one.mean), cy: y, r: 6 }));
    }));
}

/** Lines: each a label and points {x, mean, low, high}; the horizontal axis is logarithmic if its numbers span a lot. */
export function linesChart(lines, { axis, measure }) {
  const narrow = isNarrow(), width = narrow ? 360 : 640, height = narrow ? 280 : 340, left = 62, right = 20, top = 12, bottom = 46;
  const points = lines.flatMap((line) => line.points), numbers = [...new Set(points.map((one) => one.x))].sort((a, b) => a - b);
  const log = numbers[0] > 0 && numbers.at(-1) / numbers[0] >= 20, of = log ? Math.log : (value) => value;
  const [west, east] = span(numbers.map(of)), [low, high] = span(points.flatMap(ends));
  const x = (value) => left + ((of(value) - west) / (east - west)) * (width - left - right);
  const y = (value) => top + ((high - value) / (high - low)) * (height - top - bottom);
  const every = Math.ceil(numbers.length / (narrow ? 5 : 9));
  return svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${measure} against ${axis}` },
    ticksOf(low, high, 5).flatMap((tick, _, ticks) => [
      svg("line", { class: "rule", x1: left, x2: width - right, y1: y(tick), y2: y(tick) }),
      svg("text", { class: "tick", x: left - 8, y: y(tick) + 4, "text-anchor": "end" }, tickText(tick, ticks)),
    ]),
    numbers.filter((_, i) => i % every === 0).map((tick) => svg("text", { class: "tick", x: x(tick), y: height - 26, "text-anchor": "middle" }, number(tick, 9))),
    svg("text", { class: "tick", x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, axis.replaceAll("_", " ")),
    lines.map((line, i) => svg("g", { class: `line p${i % 5}`, transform: `translate(${4 * (i - (lines.length - 1) / 2)} 0)` }, // side by side, not over each other
      svg("polyline", { class: "way", points: line.points.map((one) => `${x(one.x)},${y(one.mean)}`).join(" ") }),
      line.points.flatMap((one) => [
        one.low === null || one.low === undefined ? [] : svg("line", { class: "interval", x1: x(one.x), x2: x(one.x), y1: y(one.low), y2: y(one.high) }),
        svg("circle", { class: "mean", cx: x(one.x), cy: y(one.mean), r: 4 }),
      ].flat()))));
}
