/* Vessels: a picture, volume or generated map; particles; a policy. Run, drive, compare. */
import { ask, cancelJob, leftOut, newest, on, run, state, upload } from "../shared/api.js";
import { comparison } from "./vessels/compare.js";
import { driving } from "./vessels/drive.js";
import { Editor, pack, packedCells, unpack } from "./vessels/editor.js";
import { toolbar } from "./vessels/toolbar.js";
import { makeForm, sayUnknown, seedField, seedIn, written } from "../shared/form.js";
import { Store, dated } from "../shared/store.js";
import { confirmed, duration, el, guarded, number, olderFiles, panelId, percent, say, shapeText, tabId, tabs, told } from "../shared/page.js";
import { PlayerFrame } from "../shared/player.js";
import { exports, failure, showCopies, showCopiesOf } from "../shared/share.js";

const SECTIONS = [
  { title: "Photograph", fields: ["vessels", "low", "high", "width", "bright", "thickest"], hint: "vessels, thresholds" },
  { title: "Particles", open: true, fields: ["particles", "placement", "start"] },
  { title: "Task and policy", open: true, fields: ["task", "subset", "policy", "rule", "budget", "time_per_move", "max_moves"] },
  { title: "Scans and prices", fields: ["scan_every", "scan_cost", "move_cost"] },
  { title: "Noise", fields: ["slip", "misplace", "miss", "confidence"] },
  { title: "How the file is read", fields: ["threshold", "invert", "scale", "level", "label", "channel", "frame", "largest_component", "cell_size"] },
];
const ENDS = { low: [0.1, 3], high: [0.1, 4] }; // where a hand looks for thresholds; the field takes all that it may
const VESSEL_FIELDS = ["low", "high", "width", "bright", "thickest"];
const PRESS = "Press Run to watch the swarm here, move by move.";
const PHOTOGRAPHS = /\.(png|jpe?g|bmp|tiff?)$/i;
const MOST_LISTED = 200; // episodes to choose from at once; the Lab has all
const REST = 700; // milliseconds after a stroke until what is painted is in the folder
const EXAMPLE = { map: "vessels:1000" };

export function vessels({ remember }) {
  const schema = state.start.schemas.swarm;
  const store = new Store(put), reading = ["vessels", ...schema.reading];
  let problem = { ...EXAMPLE }, seed = 0, map = null, running = null, begun = false;
  let painted = null; // cells that were painted over the map: { shape, free }, until they are written as a file
  let draft = null; // the file in the folder that follows what is painted over a map: { of, file, text }
  let shown = null; // the episode on the stage: its file and its sentence

  // ---- what is set ----

  const editor = new Editor((what) => {
    if (what === "inlet") enterAtInlet();
    else if (what === "map") {
      painted = { shape: map.shape, free: pack(map.free) };
      redo();
    } else load();
  });
  const tools = toolbar(editor, store);
  const form = makeForm(schema, SECTIONS, { hidden: ["map"], ends: ENDS, changed });
  const source = el("b.source", {}), facts = el("p.facts", {}), warning = el("p.warning", { role: "status", hidden: true });
  const { input: seedInput, element: seedRow } = seedField("vesselsSeed", () => { seed = seedIn(seedInput); redo(); });

  function fields() {
    return { kind: "swarm", map: problem.map, ...form.values() };
  }

  /** All that is set; the map and the episodes follow from it. */
  const whole = () => ({ problem: fields(), seed, cells: painted, inlet: [...editor.inlet] });

  function put({ problem: given, seed: start = 0, cells = null, inlet = [] }) {
    const same = problem.map === given.map && !problem.vessels === !given.vessels && !painted === !cells;
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
    played.refresh();
    mapped.refresh();
    races.refresh();
    comparisons.refresh();
    clearTimeout(saving);
    if (painted && draft?.text !== JSON.stringify(painted)) saving = setTimeout(guarded(saveDraft), REST);
  });

  /** A link holds the whole problem: what is painted is named by its file. */
  function mirror() {
    const { problem: set, inlet } = store.state, file = painted && draft?.text === JSON.stringify(painted) ? draft.file : null;
    remember({ problem: file ? drawnProblem(file) : set, seed, ...(inlet.length ? { inlet } : {}) });
  }

  /** The problem with the painted map in a file, which says nothing of how to read it. */
  function drawnProblem(file) {
    const kept = form.values();
    for (const name of reading) delete kept[name];
    if (map?.spacing && kept.cell_size === undefined) [kept.cell_size] = map.spacing; // a picture does not say how large its cells are
    return { kind: "swarm", map: file, ...kept };
  }

  /** Painted cells are in the folder soon after the stroke: one file follows them until it is used. */
  let saving = 0;
  const writing = newest(saveNow);
  const saveDraft = () => writing();
  async function write(text) {
    const of = written(problem.map);
    if (draft?.text === text && draft.of === of) return;
    const { file } = await ask("sketch", { ...JSON.parse(text), name: of, over: draft?.of === of ? draft.file : null });
    draft = { of, file, text };
  }
  async function saveNow() {
    if (!painted) return;
    await write(JSON.stringify(painted));
    mirror();
  }

  async function changed(values, name) {
    if (painted && reading.includes(name)) {
      if (!(await mayGo("Another way of reading the map"))) {
        form.write(problem);
        return;
      }
      painted = null;
      editor.inlet.clear();
    }
    problem = { map: problem.map, ...form.values() };
    showRelevant();
    showSource();
    keep(name);
    if (problem.vessels && VESSEL_FIELDS.includes(name) && name !== "width") overlay();
    else load();
  }

  /** Whether what was painted may make room for something else. */
  const mayGo = async (what) => !painted || confirmed("Replace what you painted?", `${what} takes the place of the cells that you painted. Ctrl Z brings them back.`, "Replace it");

  function showRelevant() {
    form.show(VESSEL_FIELDS, !!problem.vessels);
    if (problem.vessels) form.element.querySelector("details").open = true;
    views.hidden = !problem.vessels;
    if (!problem.vessels) view = "cells";
  }

  /** Cells painted as an inlet are where particles start, the nearest to its middle first. */
  function enterAtInlet() {
    const [, columns] = map.shape, cells = [...editor.inlet], count = Math.min(form.values().particles ?? 100, cells.length);
    const place = (cell) => [Math.floor(cell / columns), cell % columns];
    const middle = cells.reduce((sum, cell) => { const [r, c] = place(cell); return [sum[0] + r / cells.length, sum[1] + c / cells.length]; }, [0, 0]);
    const distance = (cell) => { const [r, c] = place(cell); return (r - middle[0]) ** 2 + (c - middle[1]) ** 2; };
    const chosen = cells.sort((a, b) => distance(a) - distance(b)).slice(0, count).sort((a, b) => a - b);
    form.row("start").write(chosen.length ? chosen.map(place) : undefined);
    if (chosen.length) form.row("particles").write(chosen.length);
    problem = { map: problem.map, ...form.values() };
    redo();
  }

  // ---- the map ----

  const load = newest(async () => {
    const of = store.text;
    facts.classList.add("loading");
    try {
      if (problem.vessels && view === "photo" && !painted) await overlay();
      else await showMap(await ask("map", { problem: fields(), seed, cells: painted }));
    } catch (error) {
      map = null; // not another map under these settings
      if (!editor.photograph) editor.setMap(null);
      volumeFrame.element.hidden = true;
      editor.element.hidden = false;
      facts.textContent = "";
      complain(error.message);
    }
    facts.classList.remove("loading");
    mapped.is(of);
  });
  /** The cells on the stage, while those of other settings are on their way. */
  const mapped = dated(() => store.text, editor.element);

  async function showMap(answer) {
    if (editor.stroke) return; // loaded once more at its end
    const cells = answer.shape.reduce((all, side) => all * side, 1), volume = answer.shape.length === 3;
    if (painted && String(painted.shape) !== String(answer.shape)) throw new Error(`The painted cells do not fit ${answer.name}, whose size has changed.`);
    map = { ...answer, free: unpack(painted?.free ?? answer.free, cells) };
    map.cells = map.free.reduce((sum, bit) => sum + bit, 0);
    complain(answer.problem);
    showSource();
    showFacts();
    editor.element.hidden = tools.hidden = volume;
    volumeFrame.element.hidden = !volume;
    if (!volume) editor.setMap(map);
    else {
      await volumeFrame.open({
        title: answer.name, map: answer.name, task: "coverage", policy: "", rule: "block", shape: answer.shape, spacing: answer.spacing, free: answer.free,
        start: packedCells(answer.start ?? []), targets: null, commands: "", scanned: null, status: "", seed: null, version: state.start.version,
      });
    }
  }

  /** Say where the map comes from. */
  function showSource() {
    const name = written(problem.map);
    source.textContent = painted ? `${name}, painted` : name;
    choices.value = state.files.some((file) => file.name === name) ? name : "";
    generated.value = choices.value ? "" : name;
  }

  function showFacts() {
    const start = map.start?.length ?? 0;
    facts.textContent = `${shapeText(map.shape)}, ${number(map.cells, 9)} free cells, ${number(start, 9)} particles${map.spacing ? `, ${map.spacing[0]} mm a cell` : ""}`;
  }

  function complain(sentence) {
    warning.hidden = !sentence;
    warning.textContent = sentence ?? "";
  }

  /** The photograph with what the sliders find on it: soon, and then once more as a run will find it. */
  let view = "cells", exact = 0, photograph = null;
  const overlay = newest(async () => {
    if (view !== "photo") setView("photo");
    try {
      if (photograph?.file !== problem.map) photograph = { file: problem.map, image: await imageOf((await ask("photograph", { file: problem.map })).picture, "jpeg") };
      if (editor.photograph !== photograph.image) {
        editor.setPhotograph(photograph.image, null);
        facts.textContent = "looking for vessels …";
      }
      await drawVessels(false);
      clearTimeout(exact);
      exact = setTimeout(guarded(() => drawVessels(true)), 700);
    } catch (error) {
      complain(error.message);
    }
  });

  async function drawVessels(surely) {
    const began = performance.now(), asked = fields();
    const found = await ask("vessels", { problem: asked, exact: surely });
    if (asked.map !== problem.map || view !== "photo") return;
    editor.setPhotograph(photograph.image, await imageOf(found.mask, "png"));
    performance.measure("shoal-overlay", { start: began });
    if (surely) complain(found.warning);
    facts.textContent = `${percent(found.share)} of the pixels are vessel${surely ? `, confidence ${number(found.confidence, 2)} of 1` : ""}`;
  }

  async function imageOf(text, kind) {
    const image = new Image();
    image.src = `data:image/${kind};base64,${text}`;
    await image.decode();
    return image;
  }

  const viewButtons = [["photo", "Photograph"], ["cells", "Cells"]].map(([name, words]) => el("button", { type: "button", "aria-pressed": "false", onclick: () => { setView(name); load(); } }, words));
  const views = el("div.segmented", { role: "group", "aria-label": "What to show", hidden: true }, viewButtons);
  function setView(name) {
    view = name;
    viewButtons.forEach((button, i) => button.setAttribute("aria-pressed", String((i === 0) === (name === "photo"))));
    tools.hidden = name === "photo";
    editor.element.hidden = false;
    volumeFrame.element.hidden = true;
  }

  // ---- where the map comes from ----

  async function choose(name) {
    if (await mayGo(name)) await take(name);
    else showSource();
  }

  async function take(name) {
    const photo = PHOTOGRAPHS.test(name) && !name.includes("-painted");
    painted = null;
    editor.inlet.clear();
    form.write({ vessels: photo });
    problem = { map: name, ...form.values() };
    showRelevant();
    setView(photo ? "photo" : "cells");
    showSource();
    stages.pick("map");
    keep();
    await load();
  }

  const choices = el("select", { id: "vesselsFile", onchange: guarded(() => choices.value && choose(choices.value)) });
  function listFiles() {
    const maps = state.files.filter((file) => file.kind === "map" && !/^papers\/|-figure(-\d+)?\.png$/.test(file.name)), kept = choices.value;
    choices.replaceChildren(el("option", { value: "" }, maps.length ? "from the folder" : "no file yet"), ...maps.map((file) => el("option", { value: file.name }, file.name)), ...olderFiles(leftOut("map")));
    choices.value = kept;
    shownEpisodes();
  }
  const picked = el("input", { type: "file", hidden: true, onchange: guarded(async () => { const [file] = picked.files; picked.value = ""; if (file) await bring(file); }) });
  const bring = async (file) => { if (await mayGo(file.name)) await take(await upload(file)); };
  const kinds = el("select", {
    "aria-label": "Kind of generated map",
    onchange: guarded(async () => { const kind = kinds.value; kinds.value = ""; if (kind) await choose(kind); }),
  }, el("option", { value: "" }, "draw a map"), state.start.maps.map((one) => el("option", { value: one.example, title: one.summary }, `${one.name} – ${one.summary}`)));
  const generated = el("input", { type: "text", spellcheck: false, autocomplete: "off", "aria-label": "Name of a generated map, such as vessels:1000:7", value: EXAMPLE.map, onchange: guarded(() => generated.value && choose(generated.value.trim())) });
  const drop = el("button.drop", { type: "button", onclick: () => picked.click() }, el("b", {}, "Drop a picture or volume here"), el("span.soft", {}, "PNG, JPEG, TIFF, NIfTI, .npy, .map, text"));
  const chooser = el("section.chooser", { "aria-label": "Map" }, drop, picked,
    el("div.pair", {}, el("label.unseen", { htmlFor: "vesselsFile" }, "A file in the folder"), choices, kinds), el("div.pair", {}, el("span.soft", {}, "Generated"), generated));

  // ---- run ----

  const frame = new PlayerFrame("swarm", { title: "The player of the episode" });
  const volumeFrame = new PlayerFrame("swarm", { title: "The map", bare: "driven" });
  const runWord = el("p.soft", { role: "status" }), runBar = el("progress", { max: 1, value: 0, hidden: true, "aria-label": "Played" });
  const result = el("div.result", {});
  const go = el("button.main", { type: "button", onclick: guarded(() => play()) }, "Run");
  const stop = el("button.second", { type: "button", hidden: true, onclick: guarded(() => running && cancelJob(running)) }, "Stop");

  /** Write what was painted as a file, and return the problem. */
  async function ready() {
    if (!painted) return fields();
    clearTimeout(saving);
    const before = store.text, text = JSON.stringify(painted);
    await write(text);
    const given = drawnProblem(draft.file);
    draft = null; // from now on this file stays as it is
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

  async function play() {
    const asked = performance.now(), given = await ready(), at = store.text, turn = (turns += 1);
    const here = () => turn === turns; // another episode may be on the stage by now
    stages.pick("run");
    result.replaceChildren();
    shown = null;
    played.is(at);
    let inside = null, opening = null, waiting = [];
    const take = (piece) => {
      if (piece.commands !== undefined) inside.shoalPlayer?.grow(piece.commands, piece.scans);
      if (piece.end !== undefined) inside.shoalPlayer?.end(piece.end, piece.unreachable);
    };
    const job = await run("play", { problem: given, seed: JSON.parse(at).seed }, {
      piece(piece) {
        if (piece.begin) {
          if (!here()) return;
          opening = frame.open({ ...piece.begin, live: true, playing: true }).then((opened) => {
            inside = opened;
            performance.measure("shoal-first-frame", { start: asked });
            waiting.forEach(take);
            waiting = [];
          });
        } else if (inside) take(piece);
        else waiting.push(piece);
      },
      job: (now) => {
        runBar.value = now.done ?? 0;
        runWord.textContent = now.state === "queued" ? "waits for a free processor" : [now.note, duration(now.left)].filter(Boolean).join(", ");
      },
      done: guarded(async (found) => {
        finish();
        await opening;
        if (!here()) return say(`The run is saved as ${found.file}`);
        if (!opening) await frame.open((await ask("page", { file: found.file })).data);
        return showResult(found.file, found.sentence, at);
      }),
      failed: (now) => {
        finish();
        if (here() && now.state !== "cancelled") played.is(null);
        if (now.state !== "cancelled") told(new Error(failure(now)));
        else inside?.shoalPlayer?.end("interrupted");
      },
    });
    running = job.id;
    go.disabled = go.hidden = true;
    stop.hidden = runBar.hidden = false;
    empty.textContent = "The studio opens the map and chooses the first moves …";
  }

  function finish() {
    running = null;
    go.disabled = go.hidden = false;
    empty.textContent = PRESS;
    stop.hidden = runBar.hidden = true;
    runWord.textContent = "";
  }

  let turns = 0; // of what is on the stage
  function showResult(file, sentence, at) {
    shown = { file, sentence };
    store.look({ file, at });
    played.is(at);
  }

  /** Say so if the episode on the stage is of other settings than those that are set now. */
  const played = dated(() => store.text, frame.element, (fresh) => {
    if (!shown) result.replaceChildren(...(fresh ? [] : [el("p.soft", {}, "The settings have changed since this run began.")]));
    else result.replaceChildren(el("p", {}, shown.sentence), fresh ? "" : el("p.soft", {}, `${shown.file}: the settings have changed since. Run plays them as they are now.`), exports(shown.file, { fresh }));
  });

  /** Show an episode of the folder, made or opened with the settings `at`. */
  async function showEpisode(file, at) {
    const turn = (turns += 1), { data, sentence } = await ask("page", { file });
    if (turn !== turns) return;
    await frame.open(data);
    showResult(file, sentence, at);
  }

  const ALL = "all of them";
  const episodes = el("select", {
    "aria-label": "Episodes of the folder",
    onchange: guarded(async () => {
      const file = episodes.value;
      episodes.value = "";
      if (file === ALL) location.hash = `#lab?${encodeURIComponent(JSON.stringify({ tab: "episodes" }))}`;
      else if (file) await showEpisode(file, store.text);
    }),
  });
  function shownEpisodes() {
    const found = state.files.filter((file) => file.name.endsWith(".npz"));
    const listed = found.slice(0, MOST_LISTED), others = leftOut("episode") + found.length - listed.length;
    episodes.replaceChildren(el("option", { value: "" }, found.length ? "open an earlier episode" : "no episode yet"), ...listed.map((file) => el("option", { value: file.name }, file.name)),
      ...(others > 0 ? [el("option", { value: ALL }, `${number(others, 9)} older ones: in the Lab …`)] : []));
  }

  // ---- the stages ----

  const context = { names: schema.properties.policy.names, problem: ready, seed: () => seed, current: () => store.text, look: (changes) => store.look(changes), view: () => store.view };
  const races = driving(context), comparisons = comparison(context);
  const empty = el("p.empty", {}, PRESS);
  const panels = {
    map: el("div.panel", { id: panelId("Vessels", "map"), role: "tabpanel", "aria-labelledby": tabId("Vessels", "map") }, el("div.stageHead", {}, views, tools), editor.element, volumeFrame.element, el("div.underStage", {}, source, facts)),
    run: el("div.panel", { id: panelId("Vessels", "run"), role: "tabpanel", "aria-labelledby": tabId("Vessels", "run") }, el("div.stageHead", {}, result, episodes), frame.element, empty),
    race: el("div.panel", { id: panelId("Vessels", "race"), role: "tabpanel", "aria-labelledby": tabId("Vessels", "race") }, races.element),
    compare: el("div.panel.scrolls", { id: panelId("Vessels", "compare"), role: "tabpanel", "aria-labelledby": tabId("Vessels", "compare") }, comparisons.element),
  };
  const stages = tabs("Vessels", [["map", "Map"], ["run", "Run"], ["race", "Drive"], ["compare", "Compare"]], (name) => {
    for (const [other, panel] of Object.entries(panels)) panel.hidden = other !== name;
    if (name === "map") editor.resize();
    store.look({ tab: name });
  });
  frame.element.addEventListener("load", () => { empty.hidden = !!frame.shown; }, true);

  const element = el("div.place", {},
    el("section.stage-side", { "aria-label": "Stage" }, stages.list, warning, Object.values(panels)),
    el("section.panel-side", { "aria-label": "Settings" }, chooser, form.element),
    el("footer.bottom", {}, seedRow, runWord, runBar, stop,
      el("button.second", { type: "button", onclick: guarded(copies) }, "As Python …"), go));

  /** What the stage shows, as Python: an episode whose settings were not changed since, or else the settings. */
  async function copies() {
    if (!panels.run.hidden && shown && played.fresh) await showCopiesOf(shown.file);
    else await showCopies(await ready(), seed);
  }

  for (const kind of ["dragover", "dragenter"]) element.addEventListener(kind, (event) => { event.preventDefault(); element.classList.add("dropping"); });
  for (const kind of ["dragleave", "drop"]) element.addEventListener(kind, () => element.classList.remove("dropping"));
  element.addEventListener("drop", guarded(async (event) => {
    event.preventDefault();
    if (event.dataTransfer.files[0]) await bring(event.dataTransfer.files[0]);
  }));
  document.addEventListener("shoal-theme", () => editor.paint());
  on("files", listFiles);
  listFiles();

  return {
    element,
    title: "Vessels",
    store,
    /** As it was before a reload. */
    async revive(saved) {
      begun = true;
      const { tab = "map", file, at } = saved.view;
      setView(JSON.parse(saved.text).problem.vessels && !JSON.parse(saved.text).cells ? "photo" : "cells");
      store.revive(saved);
      races.revive();
      comparisons.revive();
      stages.pick(tab);
      if (file) await guarded(showEpisode)(file, at);
    },
    async open(given) {
      if (begun && !given?.problem?.map) return;
      if (begun && painted) say("The painted cells are not lost: Ctrl Z brings them back.");
      if (!begun && !given?.problem?.map) {
        begun = true;
        await choose(problem.map);
        return;
      }
      sayUnknown(schema, given.problem);
      stages.pick("map");
      put({ problem: given.problem, seed: given.seed ?? 0, inlet: given.inlet ?? [] });
    },
  };
}
