/* The robots of a plan, one line each: how long, how far, which sorties. */
import { el, number, refill } from "../../shared/page.js";
import { lasting } from "./simulate.js";

const MOST_ROBOTS = 200; // in the list

const joined = (words, by) => words.filter(Boolean).join(by);
const distance = (metres) =>
  metres === null
    ? ""
    : metres >= 1000
      ? `${number(metres / 1000, 3)} km`
      : `${number(metres, 3)} m`;

function wayOf({ stops, seconds, length }) {
  return stops ? joined([lasting(seconds), distance(length)], " · ") : "in reserve";
}

/** The second line: turns, and sorties, as soon as they are known. */
function flightsOf({ stops, turns }, flights) {
  const words = stops && turns !== null ? `${turns} turns` : "";
  if (!flights.length) return words;
  const [first] = flights;
  return joined(
    [
      words,
      flights.length > 1 ? `${flights.length} sorties` : "",
      `at ${number(first.altitude_m)} m`,
      first.start_s ? `after ${lasting(first.start_s)}` : "",
    ],
    ", ",
  );
}

/** `choose(k)` is called for the robot that stands out from now on; -1: none. */
export function fleetList(choose) {
  const element = el("ul.fleet", { "aria-label": "Robots" });
  return {
    element,
    show(robots, flights, chosen) {
      const rows = robots.slice(0, MOST_ROBOTS).map((robot, k) =>
        el(
          "li",
          {},
          el(
            "button",
            {
              type: "button",
              class: `r${k % 12}`,
              "aria-pressed": String(chosen === k),
              onclick: () => choose(chosen === k ? -1 : k),
            },
            el("b.no", {}, String(k + 1)),
            el("span", {}, wayOf(robot)),
            el(
              "span.soft",
              {},
              flightsOf(
                robot,
                flights.filter((one) => one.robot === k + 1),
              ),
            ),
          ),
        ),
      );
      const others = robots.length - MOST_ROBOTS;
      if (others > 0) rows.push(el("li.soft", {}, `and ${number(others, 9)} more robots`));
      refill(element, rows);
    },
  };
}
