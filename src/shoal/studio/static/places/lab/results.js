/* The sweeps of the folder: how far each is, its means with intervals as they come in, paired
 * comparisons, exports. */
import { addJob, ask, cancelJob, ended, fileAddress, newest, on, state } from "../../shared/api.js";
import { linesChart, rowsChart } from "../../shared/charts.js";
import { written } from "../../shared/form.js";
import { dataTable, el, guarded, number, progressText, told } from "../../shared/page.js";
import { exportsOf, sayFailed, HOW_OF_SWEEP, placeOf, showForms } from "../../shared/share.js";

const FORMATS = [
  ["csv", "Table", "CSV"],
  ["png", "Figure", "PNG"],
  ["svg", "Figure", "SVG"],
];
const MOST_LINES = 10,
  MOST_VERDICTS = 4;
const EVERY = 1000; // milliseconds between two looks at a sweep that runs
const ELSEWHERE = 4000; // and at one that a command runs

const words = (values) =>
  Object.entries(values)
    .map(([name, value]) => `${name.replaceAll("_", " ")} ${value}`)
    .join(", ") || "all";
const short = (values) =>
  Object.entries(values)
    .map(([name, value]) =>
      typeof value === "string" ? value : `${name.replaceAll("_", " ")} ${value}`,
    )
    .join(", ") || "all";
const LONGEST = 80; // characters of one setting
/** What is the same at all points. */
const settings = (problem) =>
  Object.entries(problem)
    .map(([name, value]) => [name.replaceAll("_", " "), written(value)])
    .map(
      ([name, text]) =>
        `${name} ${text.length > LONGEST ? `${text.slice(0, LONGEST - 1)}…` : text}`,
    )
    .join(", ");
const BARS = "Points: means. Bars: their 95 % intervals.";
const UNITS = { makespan: "s", planned: "s", expected_find: "s" }; // of a search
const plain = (name) => name.replaceAll("_", " ");
/** A measure with its unit, and one value of an axis. */
const titled = (measure) =>
  UNITS[measure] ? `${plain(measure)} (${UNITS[measure]})` : plain(measure);
const valued = (axis, value) => (typeof value === "string" ? value : `${plain(axis)} ${value}`);
const interval = (low, high) =>
  low === null || low === undefined ? "–" : `${number(low)} to ${number(high)}`;

export function results({ shown, change }) {
  const list = el("ul.sweeps", { "aria-label": "Sweeps of the folder" }),
    detail = el(
      "section.sweep",
      { "aria-label": "The sweep" },
      el("p.soft", { role: "status" }, "Reading the sweeps of the folder …"),
    );
  const element = el("div.labTwo", {}, list, detail);
  let sweeps = [],
    read = false, // whether the sweeps of the folder are known
    chosen = null,
    wanted = null,
    drawn = "";
  let zoom = {}; // of the chart, while its numbers come in
  const key = (one) => `${one.store} ${one.name}`;
  const jobOf = (one) =>
    [...state.jobs.values()]
      .filter(
        (job) =>
          job.kind === "sweep" && job.spec.store === one.store && job.spec.sweep === one.name,
      )
      .sort((a, b) => b.id - a.id)[0];
  const atWork = (one) => {
    const job = jobOf(one);
    return job && !ended(job) ? job : null;
  };

  // ---- the list ----

  /** The sweeps that jobs of the studio run now. */
  const begun = () =>
    [...state.jobs.values()]
      .filter((job) => job.kind === "sweep" && !ended(job))
      .map(({ spec }) => ({
        store: spec.store,
        name: spec.sweep,
        done: 0,
        total: 0,
        begins: true,
      }));

  const load = newest(
    guarded(async () => {
      const asked = chosen,
        before = begun();
      const { sweeps: found } = await ask("sweeps", { slow: true });
      // an answer may be older than a sweep that has ended since
      const others = new Map([...before, ...begun()].map((one) => [key(one), one]));
      for (const one of found) others.delete(key(one));
      sweeps = [...others.values(), ...found];
      read = true;
      if (chosen === asked && !sweeps.some((one) => key(one) === chosen))
        chosen = sweeps.length ? key(sweeps[0]) : null;
      drawList();
      await look();
    }),
  );

  function stateOf(one) {
    const job = atWork(one);
    if (job) return progressText(job) || "begins";
    if (one.error) return "cannot be read";
    if (one.complete) return `${number(one.total, 9)} trials, complete`;
    return `${number(one.done, 9)} of ${number(one.total, 9)} trials, ${one.running ? "run by a command" : "paused"}`;
  }

  /** What the numbers of the sweep are of: while it runs, they come after its progress. */
  const basis = (one, found) =>
    atWork(one)
      ? `so far: ${number(found.done, 9)} of ${number(found.total, 9)} trials`
      : stateOf(one);

  function drawList() {
    list.replaceChildren(
      ...sweeps.map((one) =>
        el(
          "li",
          {},
          el(
            "button.sweepCard",
            {
              type: "button",
              "aria-current": key(one) === chosen ? "true" : null,
              onclick: () => choose(one.store, one.name),
            },
            el("b", {}, one.name ?? one.store),
            el("span", {}, stateOf(one)),
            el("progress", {
              max: 1,
              value: (atWork(one)?.done ?? one.done / (one.total || 1)) || 0,
              "aria-label": "Trials done",
            }),
          ),
        ),
      ),
    );
    if (sweeps.length || !read) return;
    detail.replaceChildren(
      el(
        "p.empty",
        {},
        el(
          "span",
          {},
          "No sweep in this folder yet.",
          el("br"),
          "“New sweep” runs many trials and compares settings, with confidence intervals.",
        ),
      ),
    );
    drawn = "";
  }

  function choose(store, name, measure = null) {
    if (chosen !== `${store} ${name}`)
      // never one sweep under the mark of another
      detail.replaceChildren(el("p.soft", { role: "status" }, `Opening ${name ?? store} …`));
    chosen = `${store} ${name}`;
    zoom = {};
    wanted = measure;
    drawn = "";
    drawList();
    return load();
  }

  // ---- one sweep ----

  const look = newest(
    guarded(async () => {
      const one = sweeps.find((other) => key(other) === chosen);
      if (!one) return;
      if (one.error || one.begins) {
        detail.replaceChildren(
          el("div.actions", {}, el("h2", {}, one.name ?? one.store), one.begins ? pause(one) : []),
          one.error
            ? el("p.warning", {}, one.error)
            : el(
                "p.soft",
                { role: "status" },
                "The sweep begins: the studio opens the maps and checks every point.",
              ),
        );
        drawn = "";
        return;
      }
      const found = await ask("sweep", {
        store: one.store,
        sweep: one.name,
        measure: wanted,
        slow: true,
      });
      if (key(one) !== chosen) return;
      Object.assign(one, found);
      shown({ store: one.store, sweep: one.name, measure: found.measure });
      draw(one, found);
      if (found.running && !atWork(one))
        setTimeout(() => element.checkVisibility() && !document.hidden && load(), ELSEWHERE);
    }),
  );

  function draw(one, found) {
    const text = JSON.stringify([found, atWork(one)?.id]);
    if (text === drawn) return; // so that nothing is taken from under a hand
    drawn = text;
    drawList();
    const measure = el(
      "select",
      {
        id: "measure",
        onchange: () => {
          wanted = measure.value;
          look();
        },
      },
      found.measures.map((name) =>
        el("option", { value: name, selected: name === found.measure }, titled(name)),
      ),
    );
    const focus = document.activeElement?.id === "measure";
    detail.replaceChildren(
      el(
        "div.actions",
        {},
        el("h2", {}, found.name),
        el("span.chip", {}, found.kind),
        found.complete ? el("span.chip.done", {}, "complete") : [],
        buttons(one, found),
      ),
      el(
        "p.soft",
        { role: "status" },
        [
          basis(one, found),
          found.failures ? `${found.failures} failed` : "",
          `${found.n_points} ${found.n_points === 1 ? "point" : "points"}`,
        ]
          .filter(Boolean)
          .join(", "),
      ),
      Object.keys(found.problem).length ? el("p.soft.settings", {}, settings(found.problem)) : [],
      found.failed.length ? el("p.warning", {}, found.failed.join("; ")) : [],
      el("p.verdict", { role: "status" }, verdict(found)),
      el(
        "div.actions",
        {},
        el("label", { htmlFor: "measure" }, "Measure"),
        measure,
        exportsOf(
          "table",
          (format) => ({
            store: one.store,
            sweep: one.name,
            ...(format === "csv" ? {} : { measure: found.measure }),
          }),
          FORMATS,
          el(
            "a.chip",
            {
              href: fileAddress(one.store),
              download: "",
              title: "All trials: the store of the sweep, an SQLite file",
              "aria-label": "All trials as SQLite",
            },
            "SQLite",
          ),
        ),
      ),
      el("div.chartArea", {}, chart(found)),
      found.comparisons.length ? comparisons(found) : [],
      points(found),
    );
    if (focus) measure.focus();
  }

  function pause(one) {
    const job = atWork(one);
    return job
      ? el(
          "button.second",
          { type: "button", onclick: guarded(() => cancelJob(job.id)) },
          one.begins ? "Cancel" : "Pause",
        )
      : [];
  }

  function buttons(one, found) {
    const job = atWork(one);
    const resume = guarded(async () => {
      await addJob("sweep", { toml: found.toml, store: one.store, sweep: one.name });
    });
    return [
      pause(one),
      !job && !found.complete && !found.running && found.kind !== "function"
        ? el("button.main", { type: "button", onclick: resume }, found.done ? "Resume" : "Run")
        : [],
      el("button.second", { type: "button", onclick: () => change(found.toml) }, "Extend …"),
      el(
        "button.second",
        {
          type: "button",
          onclick: guarded(async () => {
            const { copies, error } = await ask("new-sweep", { toml: found.toml });
            if (error) throw new Error(error);
            showForms(copies, { how: HOW_OF_SWEEP });
          }),
        },
        "As Python …",
      ),
    ].flat();
  }

  /** What the comparisons say, in a sentence or a few. */
  function verdict({ comparisons: all, measure, compared }) {
    const told_ = all.filter((one) => one.comparison?.difference?.low !== null && one.comparison);
    if (!compared || !all.length) return "";
    if (!told_.length) return "A confidence interval needs at least two trials of each value.";
    const what = plain(measure),
      unit = UNITS[measure] ? ` ${UNITS[measure]}` : "",
      are = what.endsWith("s") ? "are" : "is";
    const sentence = ({ axes, first: least, second: other, comparison: { difference: d } }) => {
      const [first, second] = [valued(compared, least), valued(compared, other)];
      const where = Object.keys(axes).length ? `For ${words(axes)}: ` : "";
      if (d.low === 0 && d.high === 0)
        return `${where}${second} and ${first} have equal ${what} in all ${d.count} pairs.`;
      if (d.low <= 0 && d.high >= 0)
        return `${where}${second} and ${first} do not differ clearly in ${what} (95 % interval of the difference ${interval(d.low, d.high)}, ${d.count} pairs).`;
      const low = Math.min(Math.abs(d.low), Math.abs(d.high)),
        high = Math.max(Math.abs(d.low), Math.abs(d.high));
      return `${where}${where ? "mean" : "Mean"} ${what} ${are} ${number(Math.abs(d.mean))}${unit} ${d.mean < 0 ? "lower" : "higher"} for ${second} than for ${first} (95 % interval ${interval(low, high)}, ${d.count} pairs).`;
    };
    if (told_.length <= 3) return told_.map(sentence).join(" ");
    const pairs = Map.groupBy(told_, (one) => `${one.second} ${one.first}`);
    const left = pairs.size - MOST_VERDICTS;
    return [...pairs.values()]
      .slice(0, MOST_VERDICTS)
      .map((group) => {
        const less = group.filter((one) => one.comparison.difference.high < 0).length,
          more = group.filter((one) => one.comparison.difference.low > 0).length;
        const names = [group[0].second, group[0].first].map((one) => valued(compared, one)),
          all = group.length;
        const pair = `${names.join(" against ")}: mean ${what}`;
        if (!less && !more) return `${pair} do not differ clearly at any of ${all} points.`;
        const parts = [
          [less, "lower"],
          [more, "higher"],
          [all - less - more, "not clearly different"],
        ].filter(([count]) => count);
        const where = parts.map(([count, word], i) =>
          count === all
            ? `${word} at all ${all} points`
            : `${word} at ${count}${i ? "" : ` of ${all} points`}`,
        );
        const last = where.pop();
        return `${pair} ${are} ${[where.join(", "), last].filter(Boolean).join(" and ")} (with 95 % confidence).`;
      })
      .concat(left > 0 ? `${left} more ${left === 1 ? "pair is" : "pairs are"} in the table.` : [])
      .join(" ");
  }

  function chart({ points: all, measure }) {
    const known = all.filter((one) => one.estimate);
    if (!known.length) return el("p.soft", {}, "No trial has this measure yet.");
    const axis = Object.keys(known[0].axes).find(
      (name) =>
        new Set(known.map((one) => one.axes[name])).size > 1 &&
        known.every((one) => typeof one.axes[name] === "number"),
    );
    if (!axis)
      return [
        rowsChart(
          known.map((one) => ({ ...one.estimate, label: short(one.axes) })),
          `${measure}: means and intervals`,
          titled(measure),
        ),
        el("p.soft", {}, BARS),
      ];
    const lines = new Map();
    for (const { axes, estimate } of known) {
      const { [axis]: x, ...others } = axes,
        label = short(others);
      lines.set(label, [...(lines.get(label) ?? []), { x, ...estimate }]);
    }
    const named = [...lines]
      .slice(0, MOST_LINES)
      .map(([label, found]) => ({ label, points: found.sort((a, b) => a.x - b.x) }));
    return [
      linesChart(named, { axis, measure: titled(measure), zoom }),
      lines.size > MOST_LINES
        ? el(
            "p.soft",
            {},
            `${MOST_LINES} of ${lines.size} lines are drawn: the table below has more.`,
          )
        : [],
    ].flat();
  }

  function comparisons({ comparisons: all, n_comparisons: count, measure, compared }) {
    return el(
      "section",
      {},
      el("h3", {}, `${titled(measure)} along ${plain(compared)}, on the same seeds`),
      dataTable(
        "Comparisons",
        [
          "Compared",
          "At",
          "Difference",
          "95 % interval",
          "Ratio",
          "p (Wilcoxon)",
          "Pairs",
          "At 95 %",
        ],
        all.map(({ axes, first, second, comparison: found }) => {
          const d = found?.difference;
          return [
            `${valued(compared, second)} minus ${first}`,
            words(axes) === "all" ? "–" : words(axes),
            ...(d
              ? [
                  number(d.mean),
                  interval(d.low, d.high),
                  number(found.ratio, 3),
                  number(found.p_value, 2),
                  `${d.count}${found.unfinished ? `, ${found.unfinished} unfinished` : ""}`,
                  d.low > 0 ? "higher" : d.high < 0 ? "lower" : "no clear difference",
                ]
              : ["–", "–", "–", "–", "–", "too few finished pairs"]),
          ];
        }),
      ),
      count > all.length
        ? el(
            "p.soft",
            {},
            `The first ${all.length} of ${count} comparisons: shoal sweep summary has all.`,
          )
        : [],
    );
  }

  function points({ points: all, measure, n_points: count, kind }) {
    return el(
      "section",
      {},
      el("h3", {}, `${titled(measure)} at each point`),
      dataTable(
        "Means",
        ["Point", "Mean", "95 % interval", "Trials", "Completed", ""],
        all.map((one) => [
          words(one.axes),
          one.estimate ? number(one.estimate.mean) : "–",
          interval(one.estimate?.low, one.estimate?.high),
          `${one.trials}${one.missing ? `, ${one.missing} missing` : ""}`,
          one.completed === null
            ? "–"
            : `${one.completed}${one.bound === null ? "" : `; mean restricted to ${number(one.bound)}`}`,
          one.watch
            ? el(
                "a",
                {
                  href: placeOf(kind, one.watch.problem, one.watch.seed, {
                    missions: null,
                    run: true,
                  }),
                  "aria-label": `Watch the first trial at ${words(one.axes)}`,
                },
                "Watch",
              )
            : "",
        ]),
      ),
      count > all.length
        ? el(
            "p.soft",
            {},
            `The first ${all.length} of ${count} points; the table that is exported has all.`,
          )
        : [],
    );
  }

  // ---- as it goes ----

  let due = null;
  on("job", (job) => {
    if (job.kind !== "sweep") return;
    if (
      job.state === "failed" &&
      `${job.spec.store} ${job.spec.sweep}` === chosen &&
      element.checkVisibility()
    )
      sayFailed(job);
    if (!element.checkVisibility()) return;
    if (job.result?.warning) told(new Error(job.result.warning));
    due ??= setTimeout(
      () => {
        due = null;
        if (element.checkVisibility()) load();
      },
      ended(job) || !sweeps.length ? 0 : EVERY,
    );
    drawList();
  });

  return { element, choose, open: load };
}
