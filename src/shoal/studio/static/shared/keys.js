/* The keys of the studio, in a sheet. */
import { el, openSheet } from "./page.js";

/** @type {[string, [string, string][]][]} */
const KEYS = [
  [
    "On all pages",
    [
      ["?", "this list"],
      ["1 to 6", "the pages, from Start to Papers"],
      ["Ctrl Z", "take back the last thing"],
      ["Ctrl Shift Z", "do it again"],
      ["Ctrl Enter", "run, play or simulate the settings"],
      ["Escape", "close a list or a sheet"],
    ],
  ],
  [
    "Maps, workspaces and plans",
    [
      ["+ and -", "zoom"],
      ["0", "show all of it"],
      ["Arrow keys", "move the view; with a brush, the cursor"],
      ["Space", "paint at the cursor"],
    ],
  ],
  [
    "Points, corners and outlines",
    [
      ["Tab", "the next one"],
      ["Arrow keys", "move it; with Shift, farther"],
      ["Delete", "remove it"],
      ["Enter", "close the outline that is drawn"],
      ["Escape", "drop the outline that is drawn"],
      ["Ctrl A", "choose all outlines of a region"],
      ["Ctrl C, Ctrl X, Ctrl V", "copy, cut and paste the chosen outlines"],
    ],
  ],
  [
    "Drive and films",
    [
      ["Arrow keys", "move the swarm in Drive; step through a film"],
      ["Space", "play a film, and hold it"],
    ],
  ],
];

export function showKeys() {
  openSheet(
    "Keys",
    el(
      "div.keys",
      {},
      KEYS.map(([title, rows]) =>
        el(
          "section",
          {},
          el("h3", {}, title),
          el(
            "dl",
            {},
            rows.map(([key, words]) =>
              el("div", {}, el("dt", {}, el("kbd", {}, key)), el("dd", {}, words)),
            ),
          ),
        ),
      ),
    ),
  );
}
