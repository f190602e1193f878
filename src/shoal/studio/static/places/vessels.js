/* Vessels: a picture, volume or generated map; particles; a policy. Run, drive, compare. */
import { ask, newest, state, upload } from "../shared/api.js";
import { faultsOf, makeForm, sayUnknown, seedField, seedIn, written } from "../shared/form.js";
import {
  acceptDrops,
  el,
  guarded,
  number,
  refill,
  say,
  shapeText,
  tabbed,
} from "../shared/page.js";
import { PlayerFrame } from "../shared/player.js";
import { showCopies, showCopiesOf } from "../shared/share.js";
import { Store, dated } from "../shared/store.js";
import { chooser } from "./vessels/chooser.js";
import { comparison } from "./vessels/compare.js";
import { driving } from "./vessels/drive.js";
import { Editor, FREE, isEmpty, pack, packedCells, unpack } from "./vessels/editor.js";
import { photographBelow } from "./vessels/layers.js";
import { paintedFile } from "./vessels/painted.js";
import { photographs } from "./vessels/photograph.js";
import { running } from "./vessels/run.js";
import { toolbar } from "./vessels/toolbar.js";

const SECTIONS = [
  {
    title: "Photograph",
    fields: ["vessels", "low", "high", "width", "bright", "thickest"],
    hint: "vessels, thresholds",
  },
  { title: "Particles", open: true, fields: ["particles", "placement", "start"] },
  {
    title: "Task and policy",
    open: true,
    fields: ["task", "subset", "policy", "rule", "budget", "time_per_move", "max_moves"],
  },
  { title: "Scans and prices", fields: ["scan_every", "scan_cost", "move_cost"] },
  { title: "Noise", fields: ["slip", "misplace", "miss", "confidence"] },
  {
    title: "How the file is read",
    fields: [
      "threshold",
      "invert",
      "scale",
      "level",
      "label",
      "channel",
      "frame",
      "largest_component",
      "cell_size",
    ],
  },
];
// where a hand looks for thresholds; the field takes all that it may
const ENDS = { low: [0.1, 3], high: [0.1, 4] };
const VESSEL_FIELDS = ["low", "high", "width", "bright", "thickest"];
const PLACED = ["start", "target", "region"]; // cells of one map
const PHOTOGRAPHS = /\.(png|jpe?g|bmp|tiff?)$/i;
const EXAMPLE = { map: "vessels:1000" };
const CANVAS = { map: "rectangle:45x80", shape: [45, 80] }; // what is painted on, empty
const PAINT = "Paint free cells: Paint makes them, Erase makes walls of them.";

export function vessels({ remember }) {
  const schema = state.start.schemas.swarm;
  const store = new Store(put),
    reading = ["vessels", ...schema.reading];
  /** @type {Record<string, any>} */
  let problem = { ...EXAMPLE };
  let seed = 0,
    map = null,
    begun = false;
  // cells that were painted over the map: { shape, free }, until they are written as a file
  let painted = null;
  const file = paintedFile();

  // ---- what is set ----

  const editor = new Editor((what) => {
    if (what === "inlet") enterAtInlet();
    else if (what === "map") {
      painted = { shape: map.shape, free: pack(map.free) };
      redo();
    } else load();
  }, over);
  const layers = photographBelow({
    changed: (below) => {
      editor.below = below;
      editor.paint();
      for (const shown of [runs, races, comparisons]) shown.setBelow();
      showLayers();
    },
    look: (changes) => store.look(changes),
  });
  editor.boxIn = layers.boxIn;
  const { element: tools, pick: pickTool } = toolbar(editor, store);
  const form = makeForm(schema, SECTIONS, { hidden: ["map"], ends: ENDS, changed });
  const source = el("b.source", {}),
    facts = el("p.facts", {}),
    where = el("p.soft.where", {}),
    words = el("div.underStage", {}, source, facts, where),
    warning = el("p.warning", { role: "status", hidden: true });
  const {
    input: seedInput,
    element: seedRow,
    row: seedFault,
  } = seedField("vesselsSeed", () => {
    seed = seedIn(seedInput);
    redo();
  });

  const complain = faultsOf(
    warning,
    (name) => ({ map: maps.row, seed: seedFault })[name] ?? form.row(name),
  );

  function fields() {
    return { kind: "swarm", map: problem.map, ...form.values() };
  }

  /** All that is set; the map and the episodes follow from it. */
  const whole = () => ({ problem: fields(), seed, cells: painted, inlet: [...editor.inlet] });

  function put({ problem: given, seed: start = 0, cells = null, inlet = [] }) {
    const same =
      problem.map === given.map && !problem.vessels === !given.vessels && !painted === !cells;
    seedInput.value = seed = start;
    problem = { ...given };
    form.write(problem);
    painted = cells;
    editor.inlet = new Set(inlet);
    showRelevant();
    if (!same || !begun) setView(problem.vessels && !painted ? "photo" : "cells");
    begun = true;
    showSource();
    redo();
  }

  /** Note what is set, one step to take back; then show the map as it is now. */
  function redo(gesture = null) {
    keep(gesture);
    load();
  }

  function keep(gesture = null) {
    store.act(whole(), gesture);
  }

  store.subscribe(() => {
    mirror();
    for (const results of [mapped, runs, races, comparisons]) results.refresh();
    if (!painted || !isEmpty(painted)) file.soon(painted, written(problem.map), mirror);
  });

  /** A link holds the whole problem: what is painted is named by its file. */
  function mirror() {
    const { problem: set, inlet } = store.state,
      name = painted && file.nameOf(painted, written(set.map));
    const linked = name ? drawnProblem(name) : set;
    remember({ problem: linked, seed, ...(inlet.length ? { inlet } : {}) });
  }

  /** The problem with the painted map in a file, which says nothing of how to read it. */
  function drawnProblem(name) {
    const kept = form.values();
    for (const field of reading) delete kept[field];
    // a picture does not say how large its cells are
    if (map?.spacing && kept.cell_size === undefined) [kept.cell_size] = map.spacing;
    return { kind: "swarm", map: name, ...kept };
  }

  function changed(values, name) {
    if (painted && reading.includes(name)) {
      leave();
      painted = null;
      editor.inlet.clear();
    }
    problem = { map: problem.map, ...form.values() };
    showRelevant();
    showSource();
    keep(name);
    const finds = problem.vessels && VESSEL_FIELDS.includes(name) && name !== "width";
    if (finds && view !== "photo") setView("photo");
    load();
  }

  /** What was painted makes room for something else. */
  const leave = () => painted && say("The painted cells are not lost: Ctrl Z brings them back.");

  function showRelevant() {
    form.show(VESSEL_FIELDS, !!problem.vessels);
    if (problem.vessels) form.element.querySelector("details").open = true;
    views.hidden = !problem.vessels;
    if (!problem.vessels) view = "cells";
  }

  /** Cells painted as an inlet are where particles start, the nearest to its middle first. */
  function enterAtInlet() {
    const [, columns] = map.shape,
      cells = [...editor.inlet],
      count = Math.min(form.values().particles ?? 100, cells.length);
    const place = (cell) => [Math.floor(cell / columns), cell % columns];
    const middle = cells.reduce(
      (sum, cell) => {
        const [r, c] = place(cell);
        return [sum[0] + r / cells.length, sum[1] + c / cells.length];
      },
      [0, 0],
    );
    const distance = (cell) => {
      const [r, c] = place(cell);
      return (r - middle[0]) ** 2 + (c - middle[1]) ** 2;
    };
    const chosen = cells
      .sort((a, b) => distance(a) - distance(b))
      .slice(0, count)
      .sort((a, b) => a - b);
    form.row("start").write(chosen.length ? chosen.map(place) : undefined);
    if (chosen.length) form.row("particles").write(chosen.length);
    problem = { map: problem.map, ...form.values() };
    redo();
  }

  // ---- the map ----

  /** What is under the pointer: a cell of the map, and where it is. */
  function over(cell) {
    const [rows, columns] = editor.size,
      inside = cell && cell.every((x, axis) => x >= 0 && x < [rows, columns][axis]);
    if (!inside) where.textContent = "";
    else if (editor.photograph)
      where.textContent = `pixel ${cell.map((x, axis) => Math.floor((x * photograph.sides[axis]) / [rows, columns][axis])).join(", ")}`;
    else {
      const metric = map.spacing
        ? `, ${cell.map((x, axis) => number((x + 0.5) * map.spacing.at(axis - 2), 4)).join(", ")} mm`
        : "";
      where.textContent = `row ${cell[0]}, column ${cell[1]}${metric}`;
    }
  }

  const load = newest(async () => {
    const of = store.text;
    facts.classList.add("loading");
    if (!map && !editor.photograph) refill(facts, "opening the map …");
    try {
      if (problem.vessels && view === "photo" && !painted) await overlay();
      else if (painted && isEmpty(painted)) showEmpty();
      else await showMap(await ask("map", { problem: fields(), seed, cells: painted }));
    } catch (error) {
      map = null; // not another map under these settings
      if (!editor.photograph) editor.setMap(null);
      volumeFrame.element.hidden = true;
      editor.element.hidden = false;
      refill(facts);
      complain(error);
    }
    facts.classList.remove("loading");
    mapped.is(of);
  });
  /** No board is without a free cell: what is painted on is shown before it is one. */
  function showEmpty() {
    const [rows, columns] = painted.shape;
    map = { shape: painted.shape, free: new Uint8Array(rows * columns), cells: 0, start: [] };
    complain(PAINT);
    layers.set(null);
    editor.element.hidden = tools.hidden = false;
    volumeFrame.element.hidden = true;
    editor.setMap(map);
    showFacts();
  }

  /** The cells on the stage, while those of other settings are on their way. */
  const mapped = dated(() => store.text, editor.element);

  async function showMap(answer) {
    if (editor.stroke) return; // loaded once more at its end
    const cells = answer.shape.reduce((all, side) => all * side, 1),
      volume = answer.shape.length === 3;
    if (painted && String(painted.shape) !== String(answer.shape))
      throw new Error(`The painted cells do not fit ${answer.name}, whose size has changed.`);
    map = { ...answer, free: unpack(painted?.free ?? answer.free, cells) };
    map.cells = map.free.reduce((sum, bit) => sum + bit, 0);
    complain(answer.problem);
    form.usual(answer.chosen);
    showSource();
    showFacts();
    if (!answer.box) layers.set(null);
    else layers.set({ image: (await photograph.read()).image, box: answer.box });
    editor.element.hidden = tools.hidden = volume;
    volumeFrame.element.hidden = !volume;
    if (!volume) editor.setMap(map);
    else {
      await volumeFrame.open({
        title: answer.name,
        map: answer.name,
        task: "coverage",
        policy: "",
        rule: "block",
        shape: answer.shape,
        spacing: answer.spacing,
        free: answer.free,
        start: packedCells(answer.start ?? []),
        targets: null,
        commands: "",
        scanned: null,
        status: "",
        seed: null,
        version: state.start.version,
      });
    }
  }

  /** Say where the map comes from. */
  function showSource() {
    const name = written(problem.map);
    source.textContent = painted ? `${name}, painted` : name;
    maps.show(name);
  }

  function showFacts() {
    const start = map.start?.length ?? 0;
    refill(
      facts,
      `${shapeText(map.shape)}, ${number(map.cells, 9)} free cells, ${number(start, 9)} particles${map.spacing ? `, ${map.spacing[0]} mm a cell` : ""}`,
    );
  }

  let view = "cells";
  /** The photograph below is a matter of the cells and of all players. */
  function showLayers() {
    const { tab = "map" } = store.view;
    layers.element.hidden = !layers.known || (tab === "map" && view !== "cells");
  }
  const photograph = photographs({
    editor,
    fields,
    complain,
    visible: () => view === "photo",
    placed: (found) => layers.set(found),
    shown: () => mapped.is(null),
    said: (...words) => {
      refill(facts, ...words);
    },
  });
  async function overlay() {
    try {
      await photograph.show();
    } catch (error) {
      if (editor.photograph) editor.setPhotograph(editor.photograph, null); // not other vessels
      refill(facts);
      complain(error);
    }
  }

  const viewButtons = [
    ["photo", "Photograph"],
    ["cells", "Cells"],
  ].map(([name, words]) =>
    el(
      "button",
      {
        type: "button",
        "aria-pressed": "false",
        onclick: () => {
          setView(name);
          load();
        },
      },
      words,
    ),
  );
  const views = el(
    "div.segmented",
    { role: "group", "aria-label": "What to show", hidden: true },
    viewButtons,
  );
  function setView(name) {
    view = name;
    viewButtons.forEach((button, i) =>
      button.setAttribute("aria-pressed", String((i === 0) === (name === "photo"))),
    );
    tools.hidden = name === "photo";
    words.classList.toggle("photograph", name === "photo");
    showLayers();
    editor.element.hidden = false;
    volumeFrame.element.hidden = true;
  }

  // ---- where the map comes from ----

  /** An empty canvas, and the brush in the hand. */
  async function blank() {
    const cells = new Uint8Array(CANVAS.shape[0] * CANVAS.shape[1]);
    await take(CANVAS.map, { shape: CANVAS.shape, free: pack(cells) });
    pickTool(FREE);
    editor.element.scrollIntoView({ block: "nearest" }); // on a phone, it is above the settings
  }

  /** Take another map. What says how a file is read, and where on the map something is, goes. */
  async function take(name, cells = null) {
    leave();
    const photo = PHOTOGRAPHS.test(name) && !name.includes("-painted");
    const kept = form.values();
    for (const field of [...reading, ...PLACED]) delete kept[field];
    painted = cells;
    editor.inlet.clear();
    form.write({ ...kept, vessels: photo });
    problem = { map: name, ...form.values() };
    showRelevant();
    setView(photo ? "photo" : "cells");
    showSource();
    stages.pick("map");
    keep();
    await load();
  }

  const bring = async (brought) => take(await upload(brought));
  const maps = chooser({ choose: take, bring, blank });
  const volumeFrame = new PlayerFrame("swarm", { title: "The map", bare: "driven" });

  // ---- what is done with it ----

  /** Write what was painted as a file, and return the problem. */
  async function ready() {
    if (!painted) return fields();
    const before = store.text;
    const given = drawnProblem(await file.use(painted, written(problem.map)));
    if (before !== store.text) return given; // painted on while it was written
    const { kind, ...rest } = given;
    painted = null;
    problem = rest;
    form.write(problem);
    showSource();
    showRelevant();
    store.amend(whole());
    mapped.is(store.text); // the same cells
    return fields();
  }

  const context = {
    names: schema.properties.policy.names,
    problem: ready,
    seed: () => seed,
    current: () => store.text,
    look: (changes) => store.look(changes),
    view: () => store.view,
    below: () => layers.below(),
  };
  const runs = running({
    store,
    problem: ready,
    open: () => stages.pick("run"),
    below: () => layers.below(),
  });
  const races = driving(context),
    comparisons = comparison(context);
  // one zoom for the cells, the photograph and all players
  const looks = { map: editor, run: runs, race: races, compare: comparisons };
  let shownTab = "map";
  const stages = tabbed(
    "Vessels",
    [
      [
        "map",
        "Map",
        el("div.stageHead", {}, views, tools),
        editor.element,
        volumeFrame.element,
        words,
      ],
      ["run", "Episode", ...runs.children],
      ["race", "Drive", races.element],
      ["compare", "Compare", comparisons.element],
    ],
    {
      chosen: (name) => {
        const view = looks[shownTab].look();
        shownTab = name;
        if (name === "map") editor.resize();
        if (view !== undefined) looks[name].lookAt(view);
        store.look({ tab: name });
        showLayers();
      },
    },
  );
  const [, runPanel, racePanel, comparePanel] = stages.panels;
  comparePanel.classList.add("scrolls");

  const element = el(
    "div.place",
    {},
    el(
      "section.stage-side",
      { "aria-label": "Stage" },
      el("div.stageTop", {}, stages.list, layers.element),
      warning,
      stages.panels,
    ),
    el("section.panel-side", { "aria-label": "Settings" }, maps.element, form.element),
    el(
      "footer.bottom",
      {},
      seedRow,
      runs.word,
      runs.bar,
      runs.stop,
      el("button.second.copies", { type: "button", onclick: guarded(copies) }, "As Python …"),
      runs.go,
    ),
  );

  /** What the stage shows, as Python: an episode whose settings were not changed since, or else the
   *  settings. */
  async function copies() {
    if (!runPanel.hidden && runs.current) await showCopiesOf(runs.current);
    else await showCopies(await ready(), seed);
  }

  acceptDrops(element, ([file]) => bring(file));
  document.addEventListener("shoal-theme", () => editor.paint());

  return {
    element,
    title: "Vessels",
    store,
    /** As it was before a reload. */
    async revive(saved) {
      begun = true;
      const { tab = "map", file: shown, at } = saved.view;
      layers.revive(saved.view.below);
      setView(
        JSON.parse(saved.text).problem.vessels && !JSON.parse(saved.text).cells ? "photo" : "cells",
      );
      store.revive(saved);
      races.revive();
      comparisons.revive();
      stages.pick(tab);
      if (shown) await runs.show(shown, at);
    },
    async open(given) {
      if (begun && !given?.problem?.map) return;
      if (begun) leave();
      if (!begun && !given?.problem?.map) {
        begun = true;
        await take(problem.map);
        return;
      }
      sayUnknown(schema, given.problem);
      stages.pick("map");
      put({ problem: given.problem, seed: given.seed ?? 0, inlet: given.inlet ?? [] });
      if (given.stage === "race") stages.pick("race");
    },
    run: () => (racePanel.hidden ? runs.play() : races.start()),
  };
}
