/* Missions over time: how high each vehicle is, and which sortie it flies when. */
import { tickText, ticksOf } from "../../shared/charts.js";
import { el, number, svg } from "../../shared/page.js";
import { lasting } from "./simulate.js";

const MOST_ROWS = 24; // robots that have a line and a row
const ROW = 22, // pixels of a row of the time line
  HIGH = 170; // of the heights
const LEFT = 56,
  RIGHT = 14,
  TOP = 12,
  BOTTOM = 42;

/** The value of a line that is given by its corners; null outside of it. */
function valueAt(times, values, time) {
  if (time < times[0] || time > times.at(-1)) return null;
  const k = Math.max(
      1,
      times.findIndex((one) => one >= time),
    ),
    share = (time - times[k - 1]) / (times[k] - times[k - 1] || 1);
  return values[k - 1] + share * (values[k] - values[k - 1]);
}

const line = (xs, ys) =>
  xs.map((x, k) => `${k ? "L" : "M"}${x.toFixed(1)} ${ys[k].toFixed(1)}`).join("");

/** `profiles` are robot, sortie, times, heights and ground of each sortie; `near` is the nearest
 *  approach of two vehicles, if there is one. */
export function heightProfile(profiles, near) {
  const robots = [...new Set(profiles.map((one) => one.robot))],
    shown = profiles.filter((one) => robots.indexOf(one.robot) < MOST_ROWS),
    left = robots.length - MOST_ROWS;
  const narrow = matchMedia("(max-width: 40rem)").matches,
    width = narrow ? 360 : 820,
    flies = shown.some((one) => one.heights.some((height) => height !== 0)),
    high = flies ? HIGH : 0,
    rows = Math.min(robots.length, MOST_ROWS) * ROW,
    height = TOP + high + rows + BOTTOM;
  const end = Math.max(...shown.map((one) => one.times.at(-1))),
    heights = shown.flatMap((one) => [...one.heights, ...(one.ground ?? [])]),
    [low, top] = [Math.min(0, ...heights), Math.max(1, ...heights)];
  const x = (time) => LEFT + (time / end) * (width - LEFT - RIGHT),
    y = (value) => TOP + ((top - value) / (top - low)) * (high - 14),
    rowOf = (robot) => TOP + high + robots.indexOf(robot) * ROW;
  const [unit, word] = end >= 600 ? [60, "min"] : [1, "s"],
    times = ticksOf(0, end / unit, narrow ? 4 : 8),
    levels = flies ? ticksOf(low, top, 4) : [];
  const colour = (robot) => `r${(robot - 1) % 12}`;

  const cursor = svg("line", { class: "cursor", y1: TOP, y2: height - BOTTOM });
  const chart = svg(
    "svg",
    {
      viewBox: `0 0 ${width} ${height}`,
      role: "img",
      "aria-label": "Heights and sorties over time",
    },
    times.flatMap((tick) => [
      svg("line", {
        class: "rule",
        x1: x(unit * tick),
        x2: x(unit * tick),
        y1: TOP,
        y2: height - BOTTOM,
      }),
      svg(
        "text",
        { x: x(unit * tick), y: height - 25, "text-anchor": "middle" },
        tickText(tick, times),
      ),
    ]),
    svg(
      "text",
      { x: width - RIGHT, y: height - 6, "text-anchor": "end" },
      `${word} after the start of the search`,
    ),
    levels.flatMap((tick) => [
      svg("line", { class: "rule", x1: LEFT, x2: width - RIGHT, y1: y(tick), y2: y(tick) }),
      svg(
        "text",
        { x: LEFT - 8, y: y(tick) + 4, "text-anchor": "end" },
        `${tickText(tick, levels)} m`,
      ),
    ]),
    flies
      ? shown.flatMap((one) =>
          [
            one.ground
              ? svg("path", { class: "ground", d: line(one.times.map(x), one.ground.map(y)) })
              : [],
            svg("path", {
              class: `flown ${colour(one.robot)}`,
              d: line(one.times.map(x), one.heights.map(y)),
            }),
          ].flat(),
        )
      : [],
    shown.map((one) =>
      svg(
        "g",
        { class: colour(one.robot) },
        svg("rect", {
          class: "sortie",
          x: x(one.times[0]),
          y: rowOf(one.robot) + 3,
          width: Math.max(2, x(one.times.at(-1)) - x(one.times[0])),
          height: ROW - 6,
          rx: 3,
        }),
        svg(
          "text",
          { class: "number", x: x(one.times[0]) + 6, y: rowOf(one.robot) + ROW - 7 },
          String(one.sortie),
        ),
      ),
    ),
    robots
      .slice(0, MOST_ROWS)
      .map((robot) =>
        svg(
          "text",
          { x: LEFT - 8, y: rowOf(robot) + ROW - 7, "text-anchor": "end" },
          narrow ? String(robot) : `Robot ${robot}`,
        ),
      ),
    near
      ? svg(
          "path",
          { class: "nearest", d: `M${x(near.time_s)} ${TOP}V${height - BOTTOM}` },
          svg("title", {}, `Robots ${near.robots.join(" and ")} are nearest to each other`),
        )
      : [],
    cursor,
  );

  const time = el("input", {
    type: "range",
    min: 0,
    max: end,
    step: "any",
    value: 0,
    id: "missionTime",
    oninput: () => tell(Number(time.value)),
  });
  const read = el("p.readings", { role: "status" });
  function tell(moment) {
    time.value = moment;
    time.setAttribute("aria-valuetext", lasting(moment));
    cursor.setAttribute("x1", x(moment));
    cursor.setAttribute("x2", x(moment));
    const words = robots.slice(0, MOST_ROWS).map((robot) => {
      const now = shown.find(
        (one) => one.robot === robot && valueAt(one.times, one.heights, moment) !== null,
      );
      if (!now)
        return el(
          "span",
          { className: colour(robot) },
          el("b", {}, String(robot)),
          "on the ground",
        );
      const up = valueAt(now.times, now.heights, moment),
        ground = now.ground ? valueAt(now.times, now.ground, moment) : null;
      const over = ground === null ? "" : `, ${number(up - ground, 3)} m above ground`;
      return el(
        "span",
        { className: colour(robot) },
        el("b", {}, String(robot)),
        flies ? `sortie ${now.sortie}, ${number(up, 3)} m${over}` : `sortie ${now.sortie}`,
      );
    });
    read.replaceChildren(el("span.at", {}, lasting(moment)), ...words);
  }
  chart.addEventListener("pointermove", (event) => {
    const box = chart.getBoundingClientRect(),
      spot = ((event.clientX - box.left) / box.width) * width;
    tell(Math.max(0, Math.min(end, ((spot - LEFT) / (width - LEFT - RIGHT)) * end)));
  });
  tell(near ? near.time_s : end / 2);
  return el(
    "figure.profile",
    {},
    el("figcaption", {}, flies ? "Heights above home, and sorties" : "Sorties"),
    chart,
    el("div.slider", {}, el("label", { htmlFor: "missionTime" }, "Time"), time),
    read,
    left > 0
      ? el("p.soft", {}, `The first ${MOST_ROWS} of ${number(robots.length, 9)} robots.`)
      : [],
  );
}
