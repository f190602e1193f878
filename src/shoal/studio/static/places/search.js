/* Search: a region dropped, named or drawn; robots and vehicles; the plan as the form changes,
   simulations, missions. */
import { ask, loadFiles, newest, onlyParts, state, upload, uploadTogether } from "../shared/api.js";
import { faultsOf, makeForm, sayUnknown, seedField, seedIn } from "../shared/form.js";
import { Store, dated } from "../shared/store.js";
import { acceptDrops, el, guarded, number, refill, say, svg, tabbed } from "../shared/page.js";
import { showCopies } from "../shared/share.js";
import { MetricCanvas, handle } from "./search/canvas.js";
import { chooser } from "./search/chooser.js";
import { Drawing } from "./search/drawing.js";
import { earthAt } from "./search/earth.js";
import { fleetList } from "./search/fleet.js";
import { launchPoints } from "./search/launch.js";
import { missionsPanel } from "./search/missions.js";
import { KINDS } from "./search/outlines.js";
import { lasting, simulation } from "./search/simulate.js";
import { Underlay } from "./search/underlay.js";
import { vehicleForm } from "./search/vehicle.js";
import { watchPanel } from "./search/watch.js";
import { Ways } from "./search/ways.js";

const SECTIONS = [
  { title: "Robots", open: true, fields: ["robots", "footprint", "launch", "land", "starts"] },
  {
    title: "Rows",
    open: true,
    fields: ["angle", "along", "cross_track", "margin", "tour", "allocation", "multiplicity"],
  },
  {
    title: "Messages and faults",
    fields: ["loss", "network", "packet", "faults", "crashes", "rates"],
  },
  {
    title: "Things to find",
    fields: [
      "prior",
      "elsewhere",
      "at_most",
      "order",
      "searched",
      "targets",
      "detection",
      "false_alarm",
      "obstacles",
    ],
  },
  {
    title: "How the file is read",
    fields: ["no_go", "layer", "inner", "hidden", "closed_lines", "transit"],
  },
];
const BEGIN = {
  problem: {
    robots: 4,
    footprint: "20",
    vehicle: { preset: "multirotor" },
    launch: "8.4971,47.3987",
  },
  drawing: {
    frame: [8.5, 47.4],
    parts: [
      [
        [-210, -140],
        [120, -165],
        [250, -40],
        [205, 130],
        [20, 175],
        [-190, 95],
      ],
    ],
    zones: [
      [
        [10, -35],
        [85, -30],
        [80, 40],
        [25, 50],
      ],
    ],
  },
};
const REGIONS = /\.(geojson|json|kml|kmz|gpkg|shp|zip|csv)$/i;
const mark = (words, ...shapes) =>
  el("span", {}, svg("svg", { viewBox: "-8 -8 16 16" }, shapes), words);
const KEYS = {
  launch: () => mark("launch point", svg("path", { class: "home", d: "M0 -6L6 5H-6Z" })),
  start: () => mark("start", svg("rect", { class: "spot", x: -4, y: -4, width: 8, height: 8 })),
  near: () => mark("nearest approach", svg("circle", { class: "near", r: 6 })),
  margin: () => mark("margin", svg("path", { class: "margin", d: "M-8 0H8" })),
};
const closed = (polygons) =>
  polygons
    .flat()
    .map((points) => `M${points.map((point) => point.join(" ")).join("L")}Z`)
    .join("");

export function search({ remember }) {
  const schema = state.start.schemas.search;
  const store = new Store(put);
  let region = null,
    seed = 0,
    plan = null,
    chosen = -1,
    fleet = null,
    begun = false,
    written = null;

  // ---- what is set ----

  const form = makeForm(schema, SECTIONS, {
    hidden: ["region", "vehicle"],
    changed: (_, name) => {
      if (name === "robots") launch.spread();
      redo(name);
    },
  });
  const vehicle = vehicleForm((name) => redo(`vehicle ${name}`));
  const canvas = new MetricCanvas(
    "The region. Arrow keys move the canvas, plus and minus zoom. Tab goes to corners and launch points.",
    { tap, over },
  );
  const drawing = new Drawing(canvas, {
    changed: drawn,
    begins: (kind) => kind === "parts" && untouched() && clear(),
    launched: (point) => launch.add(point),
    store,
  });
  const underlay = new Underlay(canvas, {
    frame: () => frame(),
    setFrame: (given) => {
      const may = !region;
      if (may) drawing.told.frame = given;
      return may;
    },
    changed: ({ placed = false, gesture = null } = {}) => {
      if (placed) redo();
      else keep(gesture);
    },
  });
  const land = svg("g", { class: "region" }),
    ways = new Ways(() => show());
  canvas.world.append(land, drawing.layer, ways.ways);
  const warning = el("p.warning", { role: "status", hidden: true }),
    source = el("b.source", {}),
    facts = el("p.facts", {}),
    key = el("p.marks", { "aria-hidden": true }),
    where = el("p.soft.where", {});
  const list = fleetList((k) => {
    chosen = k;
    show();
  });
  const {
    input: seedInput,
    element: seedRow,
    row: seedFault,
  } = seedField("searchSeed", () => {
    seed = seedIn(seedInput);
    redo();
  });
  /** The row of a field: of the region, the vehicle, the missions or the search. */
  const rowOf = (name) => {
    const [inside, field] = name.split(".");
    const rows = { region: choice.row, seed: seedFault, vehicle: vehicle.file };
    if (field) return { vehicle: vehicle.form, missions: missions.form }[inside].row(field);
    return rows[name] ?? form.row(name);
  };
  const complain = faultsOf(warning, rowOf);

  const frame = () => drawing.told.frame ?? plan?.frame ?? null;
  let known; // the region whose place on Earth the canvas has; undefined: of none yet
  /** Whether the canvas is where the region is: before, degrees and metres are not told apart. */
  const isPlaced = () =>
    drawing.told.frame
      ? String(canvas.earth?.frame) === String(drawing.told.frame)
      : known === (drawing.told.parts.length ? null : region);
  /** @returns {Record<string, any>} */
  const fields = () => ({
    kind: "search",
    ...(region ? { region } : {}),
    ...form.values(),
    vehicle: vehicle.value(),
  });
  /** All that is set; what is planned, simulated and written follows from it. */
  const whole = () => ({
    problem: fields(),
    drawing: drawing.state,
    under: underlay.told.file ? underlay.told : null,
    missions: missions.value(),
    seed,
  });
  /** All that the plan follows from, which is simulated and written. */
  /** What there must be before anything can be planned; null: nothing. */
  const lacking = () =>
    region || drawing.told.parts.length ? null : "Draw a region first, in Plan, or drop a file.";
  const question = () => ({
    problem: fields(),
    drawing: drawing.asked,
    missions: missions.value(),
    seed,
  });
  const own = () =>
    drawing.draft ||
    (!drawing.empty &&
      KINDS.some(
        (kind) => JSON.stringify(drawing.told[kind]) !== JSON.stringify(BEGIN.drawing[kind] ?? []),
      ));

  /** Whether the drawing is the one that the page begins with. */
  const untouched = () => !region && !drawing.empty && !own();

  /** An empty canvas, without the launch points that the page begins with. */
  function clear() {
    drawing.load({ frame: frame() });
    if (form.values().launch === BEGIN.problem.launch) form.row("launch").write(undefined);
    plan = fleet = null;
    planned.is(null);
    show();
  }

  /** Note what is set: one step to take back, and the address. */
  function keep(gesture = null) {
    store.act(whole(), gesture);
  }

  store.subscribe(() => {
    remember(store.state);
    simulate.refresh();
    missions.refresh();
    planned.refresh();
  });

  /** The plan on the canvas is of the region, zones and settings that are drawn and set, or wears a
   *  veil. */
  const planned = dated(
    () => JSON.stringify(question()),
    canvas.element,
    (fresh) => {
      list.element.classList.toggle("aged", !fresh);
    },
  );

  function put({
    problem,
    drawing: told = null,
    under = null,
    missions: options = {},
    seed: start = 0,
  }) {
    seed = start;
    seedInput.value = seed;
    region = typeof problem.region === "string" ? problem.region : null;
    form.write(problem);
    vehicle.write(problem.vehicle);
    missions.write(options);
    launch.forget();
    drawing.load(told);
    canvas.show(drawing.points); // before its plan is there
    if (JSON.stringify(under) !== JSON.stringify(underlay.told.file ? underlay.told : null))
      guarded(() => underlay.load(under))();
    choice.show();
    redo();
  }

  /** The file of the region: the one that it was taken from, or that its drawing was written to. */
  const fileNow = () => {
    if (!drawing.told.parts.length) return region;
    return written?.text === JSON.stringify(drawing.told) ? written.file : null;
  };

  /** The problem with what was drawn written as a file, once. */
  async function ready() {
    const given = fields(),
      { told } = drawing;
    if (drawing.empty) return given;
    const text = JSON.stringify(told);
    let file =
      written?.text === text && state.files.some((one) => one.name === written.file)
        ? written.file
        : null;
    if (!file) {
      ({ file } = await ask("draw", { problem: given, drawing: JSON.parse(text) }));
      written = { text, file };
      await loadFiles();
      show();
    }
    return JSON.parse(text).parts.length
      ? { ...given, region: file }
      : { ...given, no_go: [...[given.no_go ?? []].flat(), file] };
  }

  function set(values, gesture = null) {
    for (const [name, value] of Object.entries(values)) form.row(name).write(value);
    keep(gesture);
  }

  const launch = launchPoints({
    form,
    robots: schema.properties.robots.default,
    earth: () => (frame() ? canvas.earth : null),
    quietly: () => show(),
    done: () => redo(),
  });

  // ---- the plan ----

  function redo(gesture = null) {
    keep(gesture);
    drawMarks(drawing.show()); // at once; the plan follows
    simulate.vary();
    load();
  }

  const load = newest(async () => {
    facts.classList.add("loading");
    if (!plan) refill(facts, "planning …");
    const of = JSON.stringify(question()),
      asked = { ...JSON.parse(of), frame: drawing.told.frame };
    try {
      if (drawing.told.frame) {
        canvas.earth = await earthAt(drawing.told.frame);
        drawMarks(drawing.show()); // the plan takes longer
      } else if (drawing.told.parts.length) canvas.earth = null;
      if (!region && !drawing.told.parts.length) {
        plan = fleet = null;
        known = null;
        canvas.earth ??= null;
        complain(
          drawing.tool === "look"
            ? "Draw a region, drop a file, or enter the name of a region."
            : null,
        );
      } else {
        const found = await ask("plan", asked);
        canvas.earth = found.frame ? await earthAt(found.frame) : null;
        known = asked.drawing?.parts.length ? null : (asked.problem.region ?? null);
        plan = found;
        fleet = found.missions;
        complain(found.problem);
        form.usual(found.chosen);
      }
    } catch (error) {
      // no plan of other settings over these
      plan = { frame: plan?.frame ?? null, outline: [], no_go: [], free: [] };
      fleet = null;
      complain(error);
    }
    facts.classList.remove("loading");
    planned.is(of);
    canvas.show([
      ...(plan?.outline.flat(2) ?? []),
      ...drawing.points,
      ...(plan?.robots?.map((robot) => robot.place) ?? []),
    ]);
    show();
  });

  // ---- what is shown ----

  function show() {
    const robots = plan?.robots ?? [],
      own = drawing.told.parts.length;
    land.replaceChildren(
      ...(plan
        ? [
            svg("path", {
              class: "land",
              "fill-rule": "evenodd",
              d: own ? "" : closed(plan.outline),
            }),
            svg("path", { class: "zone", d: own ? "" : closed(plan.no_go) }),
            svg("path", { class: "margin", "fill-rule": "evenodd", d: closed(plan.free) }),
          ]
        : []),
    );
    ways.show(plan, chosen);
    drawMarks(drawing.show());
    list.show(robots, fleet?.starts ?? [], chosen);
    source.textContent = fileNow() ?? (own ? "drawn" : "");
    choice.mark();
    const words = plan?.cells
      ? [
          plan.area >= 1e4 ? `${number(plan.area / 1e4)} ha` : `${number(plan.area)} m²`,
          `${number(plan.cells, 9)} cells of ${number(plan.cell)} m`,
          `${plan.tour} at ${number(plan.angle, 3)}° from east, ${plan.allocation}`,
          `searched in ${lasting(plan.makespan)}${plan.vehicle ? "" : ", without a vehicle"}`,
          nearest(),
          plan.drawn ? "" : "the paths have too many corners to be drawn here",
        ]
          .filter(Boolean)
          .join(" · ")
      : "";
    refill(facts, words);
    drawing.numbers.fill();
  }

  function nearest() {
    if (!fleet)
      return plan.refused
        ? `no missions: ${plan.refused}`
        : plan.vehicle
          ? "without the margin, reserve and start times of missions"
          : "";
    const near = fleet.nearest_approach;
    if (!fleet.separation_m) return "no separation required";
    return near
      ? `nearest approach ${number(near.horizontal_m, 3)} m`
      : "vehicles keep apart in height";
  }

  function drawMarks(corners) {
    const points = isPlaced() ? launch.read() : [],
      starts = plan?.robots ?? [],
      near = fleet?.nearest_approach;
    const home = points.map(({ point }, k) =>
      handle(
        canvas,
        `launch${k}`,
        point,
        `Launch point ${k + 1}. Arrow keys move it, Delete removes it.`,
        [svg("path", { class: "home", d: "M0 -9L8 6H-8Z" })],
        { move: (to) => launch.move(k, to), done: () => redo(), remove: () => launch.remove(k) },
      ),
    );
    const places = points.length
      ? []
      : starts.map((robot, k) => ({
          point: robot.place,
          element: svg(
            "g",
            { class: `spot r${k % 12}` },
            svg("rect", { x: -4, y: -4, width: 8, height: 8 }),
          ),
        }));
    const heads =
      starts.length > 30
        ? []
        : starts
            .map((robot, k) => ({
              point: ways.head(robot),
              element: svg(
                "g",
                { class: `head r${k % 12}${chosen >= 0 && chosen !== k ? " dim" : ""}` },
                svg("circle", { r: 8 }),
                svg("text", { y: 3.6, "text-anchor": "middle" }, String(k + 1)),
              ),
            }))
            .filter((head) => head.point);
    const meeting = near
      ? [
          {
            point: near.place,
            element: svg(
              "g",
              { class: "near" },
              svg("circle", { r: 11 }),
              svg(
                "title",
                {},
                `Robots ${near.robots.join(" and ")} come within ${number(near.horizontal_m, 3)} m`,
              ),
            ),
          },
        ]
      : [];
    const marks = Object.entries({
      launch: points.length,
      start: places.length,
      near: meeting.length,
      margin: plan?.free?.length,
    });
    key.replaceChildren(...marks.flatMap(([name, there]) => (there ? KEYS[name]() : [])));
    canvas.setMarks([...meeting, ...places, ...corners, ...heads, ...home]);
    canvas.draw();
  }

  // ---- hands ----

  function tap(point) {
    if (underlay.tap(point)) return;
    drawing.tap(point);
  }

  function over(point) {
    drawing.over(point);
    where.textContent = !point
      ? ""
      : canvas.earth
        ? canvas.earth
            .degrees(point)
            .map((x) => x.toFixed(6))
            .join(", ")
        : `${point.map((x) => x.toFixed(Math.max(1, Math.ceil(Math.log10(canvas.scale))))).join(", ")} m`;
  }

  function drawn({ drawnOnly = false, corner = false, closed: whole_ = false } = {}) {
    if (whole_) store.fold((one) => !!one.drawing?.draft);
    if (corner) keep();
    planned.refresh();
    if (drawnOnly || corner) drawMarks(drawing.show());
    else redo();
  }

  // ---- where the region comes from ----

  /** What was drawn makes room for something else. */
  const leave = () => own() && say("The drawing is not lost: Ctrl Z brings it back.");

  function take(name) {
    leave();
    region = name || null;
    drawing.load(null);
    drawing.pick("look");
    form.row("launch").write(undefined);
    form.row("no_go").write(undefined);
    canvas.moved = false;
    choice.show();
    stages.pick("plan");
    redo();
  }

  /** Corners of what a file holds, to be moved: it becomes a drawing. */
  async function loosen() {
    if (!plan || drawing.told.parts.length) return;
    const before = store.text,
      told = await ask("outlines", {
        problem: fields(),
        drawing: drawing.asked,
        frame: plan.frame,
      });
    if (store.text !== before) return; // something else was done while it was asked for
    drawing.load({ ...told, draft: drawing.draft });
    known = region = null;
    for (const name of ["no_go", "inner"]) form.row(name).write(undefined); // drawn now
    choice.show();
    redo();
  }

  async function bring(files) {
    const main = files.find((file) => REGIONS.test(file.name));
    if (!main && !onlyParts(files)) {
      await underlay.load({ file: await upload(files[0]) });
      keep();
    } else take(await uploadTogether(files, REGIONS));
  }

  /** An empty canvas, where it was on Earth; one with a picture below stays as it is. */
  function begin() {
    leave();
    region = null;
    clear();
    choice.show();
    stages.pick("plan");
    drawing.pick("parts");
    if (!underlay.told.file) {
      canvas.bounds = null;
      canvas.fit();
    }
    canvas.element.scrollIntoView({ block: "nearest" }); // on a phone, it is above the settings
    redo();
  }
  const choice = chooser({
    choose: take,
    bring,
    blank: begin,
    loosen,
    region: () => region,
    file: fileNow,
  });

  // ---- the stages ----

  const simulate = simulation({
    ready,
    lacking,
    question,
    fields,
    set,
    open: () => stages.pick("simulate"),
    visible: () => !stages.panels[1].hidden,
    said: () => complain.said,
    store,
  });
  const missions = missionsPanel({
    ready,
    current: () => JSON.stringify(question()),
    lacking: () =>
      lacking() ??
      (!vehicle.value()
        ? "Choose a vehicle first: missions are planned for its speed and its turns."
        : missions.value()
          ? null
          : "Switch on “Plan for missions” first: the plan that is shown has none."),
    changed: (_, name) => redo(`missions ${name}`),
    store,
  });
  const watching = watchPanel();
  const stages = tabbed(
    "Search",
    [
      [
        "plan",
        "Plan",
        el("div.stageHead", {}, drawing.toolbar, ways.element),
        canvas.element,
        el("div.underStage", {}, source, key, facts, where),
        list.element,
      ],
      ["simulate", "Simulate", ...simulate.children],
      ["missions", "Missions", ...missions.children],
      ["watch", "Watch", ...watching.children],
    ],
    {
      chosen: (name) => {
        watching.shown(name === "watch");
        missions.form.element.hidden = name !== "missions";
        store.look({ tab: name });
        if (name === "simulate") guarded(() => simulate.enter())();
      },
    },
  );
  stages.panels[2].classList.add("scrolls");
  stages.panels[3].classList.add("scrolls");
  stages.pick("plan");

  const element = el(
    "div.place.search-place",
    {},
    el("section.stage-side", { "aria-label": "Stage" }, stages.list, warning, stages.panels),
    el(
      "section.panel-side",
      { "aria-label": "Settings" },
      choice.element,
      missions.form.element,
      form.element,
      vehicle.element,
      underlay.element,
    ),
    el(
      "footer.bottom",
      {},
      seedRow,
      simulate.word,
      simulate.bar,
      el(
        "button.second",
        {
          type: "button",
          onclick: guarded(async () => {
            if (lacking()) say(lacking());
            else showCopies(await ready(), seed, missions.value());
          }),
        },
        "As Python …",
      ),
      simulate.go,
    ),
  );
  acceptDrops(element, bring);

  return {
    element,
    title: "Search",
    store,
    /** As it was before a reload. */
    async revive(saved) {
      begun = true;
      const { tab = "plan" } = saved.view;
      canvas.moved = false;
      store.revive(saved);
      missions.revive();
      stages.pick(tab);
      await guarded(simulate.revive)();
    },
    open(given) {
      if (begun && !given?.problem && !given?.run) return;
      if (begun) leave();
      begun = true;
      if (given?.problem) sayUnknown(schema, given.problem);
      canvas.moved = false;
      put(given?.problem ? given : BEGIN);
      if (given?.written) missions.open(given.written);
      stages.pick(given?.written ? "missions" : "plan");
    },
    run: simulate.play,
  };
}
