/* Watch: who does what in a search that robots carry out, from what is on the air. */
import { ask } from "../../shared/api.js";
import { el, guarded, number, percent, svg } from "../../shared/page.js";

const EVERY = 1000; // milliseconds between two questions
const HEADS = ["robot", "status", "heard", "cell", "late", "searched", "messages"];
const ago = (seconds) => (seconds === null ? "–" : `${number(seconds, 3)} s`);

export function watchPanel() {
  const task = el("input", { type: "text", id: "watchTask", placeholder: "field/task.json" });
  const radio = el("input", {
    type: "text",
    id: "watchRadio",
    placeholder: "udp:192.168.1.9:9000,239.1.2.3:9000",
  });
  const go = el("button.main", { type: "button", onclick: guarded(turn) }, "Watch");
  const word = el("p", { role: "status" }),
    refused = el("p.soft", {}),
    table = el("table", { hidden: true });
  const picture = svg("svg", {
    class: "watched",
    role: "img",
    "aria-label": "Cells that are searched, and the robots",
    width: "100%",
    height: "320",
  });
  picture.style.display = "none";
  let on = false,
    visible = false,
    timer = 0,
    places = null,
    size = 1;

  const about = (more = {}) => ({ task: task.value.trim(), radio: radio.value.trim(), ...more });

  async function turn() {
    clearTimeout(timer);
    if (on) await ask("watch", about({ ends: true }));
    on = !on;
    places = null;
    task.disabled = radio.disabled = on;
    go.textContent = on ? "Stop watching" : "Watch";
    if (on) await look();
  }

  async function look() {
    clearTimeout(timer);
    if (!on || !visible) return;
    try {
      const told = await ask("watch", about({ places: places === null }));
      places ??= told.places;
      size = told.cell_m ?? size;
      show(told);
      timer = setTimeout(guarded(look), EVERY);
    } catch (error) {
      on = task.disabled = radio.disabled = false;
      go.textContent = "Watch";
      throw error;
    }
  }

  function show(told) {
    word.textContent = `${percent(told.covered_fraction)} of ${number(told.cells, 9)} cells searched${told.success === null ? "" : `, target found with ${percent(told.success)}`}${told.complete ? ": complete" : ""}${told.found.length ? `, found in cells ${told.found.join(", ")}` : ""}`;
    const reasons = Object.entries(told.refused);
    refused.textContent = reasons.length
      ? `Messages refused: ${reasons.map(([why, count]) => `${count} ${why}`).join(", ")}`
      : "";
    table.hidden = false;
    table.replaceChildren(
      el(
        "thead",
        {},
        el(
          "tr",
          {},
          HEADS.map((head) => el("th", { scope: "col" }, head)),
        ),
      ),
      el(
        "tbody",
        {},
        told.robots.map((one) =>
          el(
            "tr",
            {},
            [
              one.robot,
              one.status,
              ago(one.heard_s),
              one.cell ?? "–",
              ago(one.late_s),
              one.searched,
              one.messages,
            ].map((value) => el("td", {}, String(value))),
          ),
        ),
      ),
    );
    draw(told);
  }

  function draw(told) {
    const xs = places.map(([x]) => x),
      ys = places.map(([, y]) => y),
      half = size / 2;
    const left = Math.min(...xs) - half,
      top = Math.max(...ys) + half;
    picture.style.display = "";
    picture.setAttribute(
      "viewBox",
      `0 0 ${Math.max(...xs) + half - left} ${top - Math.min(...ys) + half}`,
    );
    const done = new Set(told.done);
    picture.replaceChildren(
      ...places.map(([x, y], cell) =>
        svg("rect", {
          x: x - half - left,
          y: top - y - half,
          width: size,
          height: size,
          fill: done.has(cell) ? "#7cc48d" : "#dfe3e8",
          stroke: "#fff",
          "stroke-width": size / 20,
        }),
      ),
      ...told.robots
        .filter((one) => one.cell !== null)
        .map((one) =>
          svg(
            "g",
            { opacity: ["silent", "gave up"].includes(one.status) ? 0.4 : 1 },
            svg("circle", { cx: one.x - left, cy: top - one.y, r: size / 3, fill: "#27496d" }),
            svg(
              "text",
              {
                x: one.x - left,
                y: top - one.y + size / 8,
                "text-anchor": "middle",
                "font-size": size / 2.5,
                fill: "#fff",
              },
              String(one.robot),
            ),
          ),
        ),
    );
  }

  const children = [
    el(
      "p",
      {},
      "Watch robots that search, in the field or in a rehearsal. The studio sends nothing: its address must be one of those to which the robots send, or their multicast group.",
    ),
    el("div.pair", {}, el("label", { htmlFor: "watchTask" }, "Task file in the folder"), task),
    el("div.pair", {}, el("label", { htmlFor: "watchRadio" }, "Radio"), radio, go),
    word,
    table,
    picture,
    refused,
  ];
  return {
    children,
    shown(now) {
      visible = now;
      guarded(look)();
    },
  };
}
