/* Charts of means with their intervals: rows for names, lines over a number. */
import { uPlot } from "../vendor/uplot.js";
import { el, number, svg } from "./page.js";

/** A step of 1, 2 or 5 times a power of ten, at least as large as asked. */
function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(Math.max(rough, 1e-300)));
  return [1, 2, 5, 10].find((step) => step * power >= rough) * power;
}

export function ticksOf(low, high, count) {
  const step = niceStep((high - low) / count),
    found = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high + step * 1e-9; tick += step)
    found.push(tick);
  return found;
}

/** A tick with as many digits as tell it from the next one. */
export function tickText(tick, ticks) {
  const step = Math.abs((ticks[1] ?? tick + 1) - (ticks[0] ?? tick)) || 1;
  return Math.abs(tick) < step / 1e6
    ? "0"
    : number(tick, Math.min(15, Math.max(4, Math.ceil(Math.log10(Math.abs(tick) / step)) + 1)));
}

/** Whether the page is one column: then a chart has fewer words beside it. */
const isNarrow = () => matchMedia("(max-width: 40rem)").matches;

const ends = (one) => [one.mean, one.low ?? one.mean, one.high ?? one.mean];

/** Ends of an axis that holds all values, with a little room. */
function span(values) {
  const low = Math.min(...values),
    high = Math.max(...values),
    room = (high - low || Math.abs(high) || 1) * 0.06;
  return [low - room, high + room];
}

/** Rows: each a label, a mean, its interval, and perhaps its trials; `best` rows stand out. The
 *  values of a row stand in it while the pointer is there. */
export function rowsChart(rows, words, axis) {
  const narrow = isNarrow(),
    width = narrow ? 360 : 640,
    row = 46,
    left = narrow ? 136 : 200,
    right = narrow ? 14 : 30,
    most = narrow ? 16 : 26,
    height = rows.length * row + 54;
  const [low, high] = span(rows.flatMap((one) => [...(one.values ?? []), ...ends(one)]));
  const x = (value) => left + ((value - low) / (high - low)) * (width - left - right);
  return svg(
    "svg",
    { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": words },
    ticksOf(low, high, narrow ? 3 : 5).flatMap((tick, _, ticks) => [
      svg("line", { class: "rule", x1: x(tick), x2: x(tick), y1: 4, y2: height - 44 }),
      svg(
        "text",
        { class: "tick", x: x(tick), y: height - 28, "text-anchor": "middle" },
        tickText(tick, ticks),
      ),
    ]),
    svg(
      "text",
      { class: "tick", x: (left + width - right) / 2, y: height - 8, "text-anchor": "middle" },
      axis,
    ),
    rows.map((one, i) => {
      const y = i * row + row / 2 + 4;
      return svg(
        "g",
        { class: one.best ? "row best" : "row" },
        svg("rect", { class: "reach", x: 0, y: i * row + 4, width, height: row }),
        svg(
          "text",
          { class: "name", x: left - 14, y: y + 4, "text-anchor": "end" },
          one.label.length > most ? `${one.label.slice(0, most - 1)}…` : one.label,
        ),
        (one.values ?? [])
          .slice(0, 300)
          .map((value) => svg("circle", { class: "trial", cx: x(value), cy: y, r: 3 })),
        one.low === null || one.low === undefined
          ? []
          : svg("line", { class: "interval", x1: x(one.low), x2: x(one.high), y1: y, y2: y }),
        svg("circle", { class: "mean", cx: x(one.mean), cy: y, r: 6 }),
        svg(
          "text",
          {
            class: "value",
            x: Math.min(x(one.mean), width - right - 70),
            y: y - 11,
            "text-anchor": "middle",
          },
          `${number(one.mean)}${spanText(one.low, one.high)}`,
        ),
      );
    }),
  );
}

const BARE = { show: false };
const plots = new Set(); // those on the page, which follow its colours
document.addEventListener("shoal-theme", () => {
  for (const plot of plots) {
    if (plot.root.isConnected) plot.redraw(false);
    else plots.delete(plot);
  }
});

/** The colour that a class has on this page: --own of the line's number, or a colour of the
 *  page. */
function colourOf(name, of = document.body) {
  return getComputedStyle(of).getPropertyValue(name).trim();
}

const spanText = (low, high) =>
  low === null || low === undefined ? "" : ` (${number(low)} to ${number(high)})`;

/** Lines: each a label and points {x, mean, low, high}; the horizontal axis is logarithmic if its
 *  numbers span a lot. The values at the pointer stand in the legend; a drag zooms in, a double
 *  click shows all. `zoom` is an object that outlasts the chart, which keeps what is shown.
 *  @param {any[]} lines @param {{ axis: string, measure: string, zoom?: { range?: number[] } }}
 *  about */
export function linesChart(lines, { axis, measure, zoom = {} }) {
  const points = lines.flatMap((line) => line.points);
  const numbers = [...new Set(points.map((one) => one.x))].sort((a, b) => a - b);
  const log = numbers[0] > 0 && numbers.at(-1) / numbers[0] >= 20;
  const [of, back] = log ? [Math.log, Math.exp] : [(value) => value, (value) => value];
  const places = numbers.map(of);
  const found = lines.map((line) => new Map(line.points.map((one) => [one.x, one])));
  const [west, east] = span(places);
  const words = axis.replaceAll("_", " "),
    title = measure.replaceAll("_", " ");
  const keys = lines.map((_, i) => el(`span.p${i % 5}`, { hidden: true }));
  const room = el("div.drawn", {});
  const element = el(
    "figure.curves",
    { "aria-label": `${title} against ${words}` },
    keys,
    room,
    el(
      "p.soft",
      {},
      "Points: means. Bars: their 95 % intervals. Point at one for its numbers, drag to zoom in, double-click for all.",
    ),
  );
  const ink = () => colourOf("--soft"),
    rule = () => colourOf("--line");
  const side = {
    stroke: ink,
    font: "12px system-ui",
    labelFont: "12px system-ui",
    ticks: BARE,
    grid: { stroke: rule, width: 1 },
  };

  /** Ends of the vertical axis: for what is shown, and the next points beside it. */
  function heights() {
    const [low, high] = zoom.range ?? [west, east];
    const before = places.findLast((at) => at < low) ?? west,
      after = places.find((at) => at > high) ?? east;
    return span(points.filter((one) => of(one.x) >= before && of(one.x) <= after).flatMap(ends));
  }

  /** Means as discs and intervals as bars, those of several lines side by side. */
  function drawPoints(plot) {
    const pen = plot.ctx,
      unit = devicePixelRatio;
    pen.save();
    pen.beginPath();
    pen.rect(plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height);
    pen.clip();
    pen.lineWidth = 2 * unit;
    lines.forEach((line, i) => {
      if (!plot.series[i + 1].show) return;
      pen.strokeStyle = pen.fillStyle = colourOf("--own", keys[i]);
      for (const one of line.points) {
        const left = plot.valToPos(of(one.x), "x", true) + 4 * unit * (i - (lines.length - 1) / 2);
        const [middle, low, high] = ends(one).map((value) => plot.valToPos(value, "y", true));
        pen.beginPath();
        pen.moveTo(left, low);
        pen.lineTo(left, high);
        pen.stroke();
        pen.beginPath();
        pen.arc(left, middle, 4 * unit, 0, 2 * Math.PI);
        pen.fill();
      }
    });
    pen.restore();
  }

  function make(width) {
    const height = isNarrow() ? 260 : 340;
    const plot = new uPlot(
      {
        width,
        height,
        cursor: { drag: { x: true, y: false }, points: BARE },
        legend: { markers: { width: 0, fill: (_, i) => colourOf("--own", keys[i - 1]) } },
        scales: {
          x: {
            time: false,
            range: (_, low, high) =>
              zoom.range ??
              (low < high ? [Math.min(low, west), Math.max(high, east)] : [west, east]),
          },
          y: { range: heights },
        },
        axes: [
          {
            ...side,
            label: words,
            labelSize: 22,
            size: 32,
            splits: (_, __, low, high) => ticksIn(low, high, width),
            values: (_, all) => all.map((at) => number(back(at), 9)),
          },
          {
            ...side,
            label: title,
            labelSize: 22,
            size: 62,
            values: (_, all) => all.map((at) => tickText(at, all)),
          },
        ],
        series: [
          { label: words, value: (_, at) => (at === null ? "–" : number(back(at), 9)) },
          ...lines.map((line, i) => ({
            label: lines.length > 1 ? line.label : title,
            stroke: () => colourOf("--own", keys[i]),
            width: 2,
            points: BARE,
            spanGaps: true,
            value: (_, mean, __, at) => {
              const one = at === null ? null : found[i].get(numbers[at]);
              return one ? `${number(one.mean)}${spanText(one.low, one.high)}` : "–";
            },
          })),
        ],
        hooks: {
          draw: [drawPoints],
          setSelect: [
            (made) => {
              if (made.select.width)
                show([
                  made.posToVal(made.select.left, "x"),
                  made.posToVal(made.select.left + made.select.width, "x"),
                ]);
            },
          ],
          ready: [
            ({ over }) => {
              over.addEventListener("dblclick", () => show(null));
              for (const [kind, on] of [
                ["mouseenter", true],
                ["mouseleave", false],
              ])
                over.addEventListener(kind, () => element.classList.toggle("pointed", on));
            },
          ],
        },
      },
      [places, ...found.map((one) => numbers.map((at) => one.get(at)?.mean ?? null))],
      room,
    );
    const show = (range) => {
      zoom.range = range;
      plot.setScale("x", { min: range?.[0] ?? west, max: range?.[1] ?? east });
    };
    plots.add(plot);
    return plot;
  }

  /** The numbers of the sweep as ticks, as many as have room; between two of them, round
   *  numbers. */
  function ticksIn(low, high, width) {
    const most = Math.max(2, Math.floor(width / 90));
    const inside = places.filter((at) => at >= low && at <= high);
    if (inside.length < 2 && !log) return ticksOf(low, high, most);
    const every = Math.ceil(inside.length / most);
    return inside.filter((_, i) => i % every === 0);
  }

  let plot = null;
  new ResizeObserver(
    ([
      {
        contentRect: { width },
      },
    ]) => {
      if (!width) return;
      if (!plot) plot = make(width);
      else if (plot.width !== width) plot.setSize({ width, height: plot.height });
    },
  ).observe(room);
  return element;
}
