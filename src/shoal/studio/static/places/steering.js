/* Steering: drag particles and goals; greedy's plan follows the hand, better plans come after; the Δ space beside it. */
import { ask, newest, on, run, state, upload } from "../shared/api.js";
import { makeForm, seedField, seedIn } from "../shared/form.js";
import { duration, el, guarded, number, svg, tabs, told } from "../shared/page.js";
import { PlayerFrame } from "../shared/player.js";
import { exports, failure, showCopies } from "../shared/share.js";

const SECTIONS = [
  { title: "Particles and goals", open: true, fields: ["start", "goal", "interchangeable", "particle_radius", "tolerance"] },
  { title: "Planner", open: true, fields: ["planner", "time", "max_moves"] },
  { title: "Friction and noise", fields: ["friction", "execution", "measurement", "gain"] },
];
const NAMES = ["square", "triangle", "pentagon", "hexagon", "heptagon", "octagon", "disk"];
const BEGIN = { workspace: "square", start: [[0.2, 0.3], [0.5, 0.35]], goal: [[0.8, 0.2], [0.3, 0.75]] };
const PLANS = ["greedy", "shortest", "fewest-moves"];
const SLOW_AFTER = 350; // milliseconds of rest after which the slower planners are asked
const round = (x) => Math.round(x * 1e4) / 1e4;

export function steering({ remember }) {
  const schema = state.start.schemas.steering;
  let problem = { ...BEGIN }, seed = 0, place = null, corners = null, running = null, chosen = "greedy", plans = {}, waiting = 0;

  const form = makeForm(schema, SECTIONS, { hidden: ["workspace"], changed: () => { problem = { workspace: problem.workspace, ...form.values() }; redo(); } });
  const warning = el("p.warning", { role: "status", hidden: true });
  const room = svg("svg", { class: "room", role: "group", "aria-label": "The workspace: particles are squares, goals are rings. Tab to one and move it with the arrow keys." });
  const space = svg("svg", { class: "room", role: "img", "aria-label": "The Δ configuration space" });
  const table = el("div.plans", { role: "radiogroup", "aria-label": "Plans" }), reachWord = el("p.reached", {});
  const { input: seedInput, element: seedRow } = seedField("steeringSeed", () => { seed = seedIn(seedInput); redo(); });

  const fields = () => ({ kind: "steering", ...problem });

  // ---- what is asked ----

  function redo() {
    remember({ problem, seed });
    plans = {};
    loadRoom();
  }

  const loadRoom = newest(async () => {
    try {
      place = await ask("workspace", { problem: fields(), seed });
      complain(null);
      if (place.dimensions !== 2) throw new Error("The studio draws workspaces in the plane only. For a workspace in space, use the command shoal steer.");
      drawRoom();
      follow();
    } catch (error) {
      complain(error.message);
    }
  });

  /** What follows the hand: greedy's plan, and what two moves reach. */
  const follow = newest(async () => {
    const began = performance.now(), asked = fields();
    try {
      plans = { greedy: await ask("steer", { problem: { ...asked, planner: "greedy" }, seed }) };
      performance.measure("shoal-greedy", { start: began });
      complain(null);
    } catch (error) {
      plans = {};
      complain(error.message);
    }
    drawRoom();
    drawPlans();
    clearTimeout(waiting);
    waiting = setTimeout(after, SLOW_AFTER);
  });

  function simple() {
    return place?.convex && place.start.length === 2;
  }

  const after = newest(async () => {
    const asked = fields(), same = () => JSON.stringify(asked) === JSON.stringify(fields());
    remember({ problem, seed });
    drawReach(await ask("reach", { problem: asked, seed, moves: 4 }).catch(() => ({ sets: [], rings: [] })));
    for (const planner of simple() ? PLANS.slice(1) : []) {
      if (!same()) return;
      const found = await ask("steer", { problem: { time: 3, ...asked, planner }, seed, slow: true }).catch((error) => ({ problem: error.message }));
      if (same()) plans[planner] = found;
      drawPlans();
      drawRoom();
    }
  });

  function complain(sentence) {
    warning.hidden = !sentence;
    warning.textContent = sentence ?? "";
  }

  // ---- the workspace ----

  /** Points of the plane to those of the picture: y goes up. */
  function frameOf(rings) {
    const all = rings.flat(), xs = all.map(([x]) => x), ys = all.map(([, y]) => y);
    const low = [Math.min(...xs), Math.min(...ys)], high = [Math.max(...xs), Math.max(...ys)], size = Math.max(high[0] - low[0], high[1] - low[1]) || 1;
    const unit = 100 / size;
    return { unit, at: ([x, y]) => [(x - low[0]) * unit, (high[1] - y) * unit], back: ([x, y]) => [low[0] + x / unit, high[1] - y / unit], width: (high[0] - low[0]) * unit, height: (high[1] - low[1]) * unit };
  }

  const path = (points, at, closed = true) => points.map((point, i) => `${i ? "L" : "M"}${at(point).map((x) => x.toFixed(3)).join(" ")}`).join("") + (closed ? "Z" : "");

  let frame = null;
  function drawRoom() {
    if (!place) return;
    const focused = document.activeElement?.dataset?.handle;
    frame = frameOf(corners ? [[[0, 0], [1, 1]]] : place.rings);
    room.setAttribute("viewBox", `-8 -8 ${frame.width + 16} ${frame.height + 16}`);
    const { at } = frame;
    if (corners) {
      room.replaceChildren(svg("rect", { class: "paper", x: 0, y: 0, width: frame.width, height: frame.height }),
        ...(corners.length > 1 ? [svg("path", { class: "draft", d: path(corners, at, false) })] : []),
        ...corners.map((corner) => svg("circle", { class: "corner", cx: at(corner)[0], cy: at(corner)[1], r: 1.6 })));
      return;
    }
    const plan = plans[chosen] ?? plans.greedy, radius = Math.max(2.6, (problem.particle_radius ?? 0) * frame.unit);
    room.replaceChildren(
      svg("path", { class: "floor", "fill-rule": "evenodd", d: place.rings.map((ring) => path(ring, at)).join("") }),
      ...(plan?.ways ?? []).map((way, i) => svg("path", { class: `way p${i % 5}`, d: way.length ? path(way, at, false) : "" })),
      ...place.goal.map((point, i) => handle("goal", i, point, svg("circle", { class: `goal p${i % 5}`, r: 3.1 }))),
      ...place.start.map((point, i) => handle("start", i, point, svg("circle", { class: `particle p${i % 5}`, r: radius }))));
    if (focused) room.querySelector(`[data-handle="${focused}"]`)?.focus();
  }

  /** A point that the hand moves, or the arrow keys. */
  function handle(what, i, point, shape) {
    const [x, y] = frame.at(point), words = `${what === "start" ? "Particle" : "Goal"} ${i + 1} at ${round(point[0])}, ${round(point[1])}`;
    const group = svg("g", { class: "handle", transform: `translate(${x} ${y})`, tabindex: 0, role: "button", "aria-label": words, "data-handle": `${what}${i}` },
      svg("circle", { class: "touch", r: 6 }), shape, svg("text", { class: "no", y: 1.3, "text-anchor": "middle" }, String(i + 1)));
    group.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      group.focus();
      drag(what, i, event);
    });
    group.addEventListener("keydown", (event) => {
      const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[event.key];
      if (!step) return;
      event.preventDefault();
      const by = (event.shiftKey ? 0.1 : 0.01) * place.size;
      move(what, i, [place[what][i][0] + by * step[0], place[what][i][1] + by * step[1]]);
    });
    return group;
  }

  function drag(what, i, event) {
    room.setPointerCapture(event.pointerId);
    const go = (moved) => move(what, i, pointOf(moved));
    const stop = () => {
      room.removeEventListener("pointermove", go);
      room.removeEventListener("pointerup", stop);
      room.removeEventListener("pointercancel", stop);
    };
    room.addEventListener("pointermove", go);
    room.addEventListener("pointerup", stop);
    room.addEventListener("pointercancel", stop);
  }

  function pointOf(event) {
    const spot = new DOMPoint(event.clientX, event.clientY).matrixTransform(room.getScreenCTM().inverse());
    return frame.back([spot.x, spot.y]);
  }

  function move(what, i, point) {
    // Random points become those that are shown as soon as one of them is moved.
    for (const name of ["start", "goal"]) problem[name] = place[name].map((one) => one.map(round));
    problem[what][i] = point.map(round);
    place[what][i] = problem[what][i];
    plans = {};
    form.write(problem);
    drawRoom();
    follow();
  }

  // ---- the Δ space ----

  function drawReach({ rings, sets, delta }) {
    spaceBox.hidden = !rings.length;
    if (!rings.length) return;
    const { at, width, height } = frameOf(rings), goal = place.goal[1].map((x, axis) => x - place.goal[0][axis]);
    space.setAttribute("viewBox", `-6 -6 ${width + 12} ${height + 12}`);
    const spot = (point, kind) => svg("circle", { class: kind, cx: at(point)[0], cy: at(point)[1], r: 2.4 });
    space.replaceChildren(svg("path", { class: "floor", d: path(rings[0], at) }),
      ...[...sets].reverse().map((set) => svg("path", { class: `reach m${set.moves}`, "fill-rule": "evenodd", d: set.rings.map((ring) => path(ring, at)).join("") })),
      spot(goal, "goal p1"), spot(delta, "particle p0"));
    reachWord.replaceChildren(...sets.map((set) => el(`span.key.m${set.moves}`, {}, `${set.moves} moves reach ${(100 * set.fraction).toFixed(1)} %`)));
  }

  // ---- plans ----

  function drawPlans() {
    const shown = simple() ? PLANS : ["greedy"];
    if (!plans[chosen]) chosen = plans.greedy ? chosen : "greedy";
    table.replaceChildren(...shown.map((name) => {
      const plan = plans[name];
      const note = !plan ? "planning …" : plan.problem ?? (plan.status === "solved" ? `${plan.moves} moves, length ${number(plan.length)}` : `${plan.status}: ${plan.reason}`);
      return el("button.plan", {
        type: "button", role: "radio", "aria-checked": String(name === chosen), disabled: !plan?.ways,
        onclick: () => { chosen = name; drawPlans(); drawRoom(); },
      }, el("b", {}, name), el("span", {}, note));
    }), ...(plans.greedy?.bound ? [el("p.soft", {}, `No plan is shorter than ${number(plans.greedy.bound)}.`)] : []));
  }

  // ---- where the workspace comes from ----

  async function choose(name, points = {}) {
    problem = { workspace: name, ...form.values(), start: "random", goal: "random", ...points };
    form.write(problem);
    typed.value = typeof name === "string" ? name : "";
    kinds.value = NAMES.includes(name) ? name : "";
    plans = {};
    stages.pick("plan");
    redo();
  }
  const kinds = el("select", { "aria-label": "Workspace", onchange: guarded(() => kinds.value && choose(kinds.value, kinds.value === "square" ? BEGIN : {})) },
    el("option", { value: "" }, "another one"), NAMES.map((name) => el("option", { value: name }, name)));
  const files = el("select", { "aria-label": "A workspace in the folder", onchange: guarded(() => files.value && choose(files.value)) });
  const typed = el("input", { type: "text", spellcheck: false, autocomplete: "off", id: "steeringWorkspace", onchange: guarded(() => typed.value && choose(typed.value.trim())) });
  const picked = el("input", { type: "file", accept: ".svg,.wkt,.geojson,.json", hidden: true, onchange: guarded(async () => picked.files[0] && choose(await upload(picked.files[0]))) });
  const sketch = el("button.second", { type: "button", "aria-pressed": "false", onclick: () => (corners ? endSketch() : beginSketch()) }, "Draw a workspace");
  function beginSketch() {
    corners = [];
    sketch.textContent = "Close the outline";
    sketch.setAttribute("aria-pressed", "true");
    stages.pick("plan");
    drawRoom();
  }
  function endSketch() {
    const found = corners;
    corners = null;
    sketch.textContent = "Draw a workspace";
    sketch.setAttribute("aria-pressed", "false");
    if (found.length < 3) {
      drawRoom();
      if (found.length) complain("An outline needs at least three corners.");
      return;
    }
    choose(`POLYGON ((${[...found, found[0]].map((corner) => corner.map(round).join(" ")).join(", ")}))`);
  }
  room.addEventListener("pointerdown", (event) => {
    if (!corners || event.button !== 0) return;
    const corner = pointOf(event).map((x) => Math.max(0, Math.min(1, x)));
    const near = (other) => other && Math.hypot(corner[0] - other[0], corner[1] - other[1]) < 0.015;
    if (near(corners.at(-1)) || (corners.length > 2 && near(corners[0]))) { // a double click, or the first corner again, closes it
      endSketch();
      return;
    }
    corners.push(corner);
    drawRoom();
  });
  function listFiles() {
    const found = state.files.filter((file) => ["workspace", "region"].includes(file.kind) && /\.(svg|wkt|geojson)$/i.test(file.name));
    files.replaceChildren(el("option", { value: "" }, found.length ? "a file of the folder" : "no drawing yet"), ...found.map((file) => el("option", { value: file.name }, file.name)));
  }
  const chooser = el("section.chooser", { "aria-label": "Workspace" },
    el("div.pair", {}, kinds, sketch), el("div.pair", {}, files, el("button.second", { type: "button", onclick: () => picked.click() }, "Bring a file"), picked),
    el("div.field", {}, el("label", { htmlFor: "steeringWorkspace" }, "By name"), typed, el("p.help", {}, schema.properties.workspace.description)));

  // ---- play ----

  const player = new PlayerFrame("steering", { title: "The player of the plan" });
  const result = el("div.result", {}), word = el("p.soft", { role: "status" });
  const go = el("button.main", { type: "button", onclick: guarded(play) }, "Play");

  async function play() {
    const given = fields();
    if (!given.planner && plans[chosen]) given.planner = chosen;
    result.replaceChildren();
    stages.pick("play");
    go.disabled = true;
    const job = await run("play", { problem: given, seed }, {
      job: (now) => { word.textContent = [now.note, duration(now.left)].filter(Boolean).join(", "); },
      done: guarded(async ({ file, sentence }) => {
        go.disabled = false;
        word.textContent = "";
        const { data } = await ask("page", { file });
        await player.open(data);
        empty.hidden = true;
        result.replaceChildren(el("p", {}, sentence), exports(file));
      }),
      failed: (now) => { go.disabled = false; word.textContent = ""; told(new Error(failure(now))); },
    }).catch((error) => { go.disabled = false; throw error; });
    running = job.id;
  }

  const empty = el("p.empty", {}, "Press Play to watch the plan here, contact by contact.");
  const spaceBox = el("figure.delta", {}, el("figcaption", {}, "Δ space: particle 2, seen from particle 1"), space, reachWord);
  const panels = {
    plan: el("div.panel", { id: "panel-plan", role: "tabpanel", "aria-labelledby": "tab-plan" }, el("div.twin", {}, el("figure.workspace", {}, el("figcaption", {}, "Workspace: drag particles and goals"), room), spaceBox), table),
    play: el("div.panel", { id: "panel-play", role: "tabpanel", "aria-labelledby": "tab-play" }, el("div.stageHead", {}, result), player.element, empty),
  };
  const stages = tabs("Steering", [["plan", "Plan"], ["play", "Play"]], (name) => { for (const [other, panel] of Object.entries(panels)) panel.hidden = other !== name; });
  stages.pick("plan");
  on("files", listFiles);
  listFiles();

  return {
    element: el("div.place", {},
      el("section.stage-side", { "aria-label": "Stage" }, stages.list, warning, Object.values(panels)),
      el("section.panel-side", { "aria-label": "Settings" }, chooser, form.element),
      el("footer.bottom", {}, seedRow, word,
        el("button.second", { type: "button", onclick: guarded(() => showCopies(planned(), seed)) }, "As Python …"), go)),
    title: "Steering",
    async open(given) {
      if (given?.problem?.workspace) {
        ({ problem, seed = 0 } = given);
        seedInput.value = seed;
      } else if (place) return;
      form.write(problem);
      typed.value = typeof problem.workspace === "string" ? problem.workspace : "";
      kinds.value = NAMES.includes(problem.workspace) ? problem.workspace : "";
      await loadRoom();
    },
  };

  /** The problem with the planner that is shown. */
  function planned() {
    const given = fields();
    return given.planner || !plans[chosen] ? given : { ...given, planner: chosen };
  }
}
