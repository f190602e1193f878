/* Steering: drag particles and goals; greedy's plan follows the hand, better plans come after; the
   Δ space beside it. */
import { ask, leftOut, newest, on, run, state, upload } from "../shared/api.js";
import { faultsOf, fieldRow, makeForm, seedField, seedIn } from "../shared/form.js";
import { Store, dated, stepButtons } from "../shared/store.js";
import { CROSSES, CROSSES_CLOSED, crosses } from "../shared/geometry.js";
import { hands, spotOf } from "../shared/hands.js";
import {
  capital,
  el,
  filePicker,
  guarded,
  number,
  olderFiles,
  panelId,
  percent,
  progressText,
  refill,
  say,
  svg,
  tabId,
  tabs,
} from "../shared/page.js";
import { PlayerFrame } from "../shared/player.js";
import { exports, sayFailed, showCopies, showCopiesOf } from "../shared/share.js";

const SECTIONS = [
  {
    title: "Particles and goals",
    open: true,
    fields: ["start", "goal", "interchangeable", "particle_radius", "tolerance"],
  },
  { title: "Planner", open: true, fields: ["planner", "time", "max_moves"] },
  { title: "Friction and noise", fields: ["friction", "execution", "measurement", "gain"] },
];
const NAMES = ["square", "triangle", "pentagon", "hexagon", "heptagon", "octagon", "disk"];
const BEGIN = {
  workspace: "square",
  start: [
    [0.2, 0.3],
    [0.5, 0.35],
  ],
  goal: [
    [0.8, 0.2],
    [0.3, 0.75],
  ],
};
const SKETCH = "Click corners of an outline";
const PLANS = ["greedy", "shortest", "fewest-moves"];
const CLOSEST = 40; // the largest zoom
const SLOW_AFTER = 350; // milliseconds of rest after which the slower planners are asked

export function steering({ remember }) {
  const schema = state.start.schemas.steering;
  const store = new Store(put);
  let begun = false,
    shown = null; // the episode on the stage: its file and its sentence
  /** @type {Record<string, any>} */
  let problem = { ...BEGIN };
  let seed = 0,
    place = null,
    corners = null,
    plans = {},
    waiting = 0;

  const form = makeForm(schema, SECTIONS, {
    hidden: ["workspace"],
    changed: (_, name) => {
      problem = { workspace: problem.workspace, ...form.values() };
      redo(name);
    },
  });
  const warning = el("p.warning", { role: "status", hidden: true });
  const room = svg("svg", {
    class: "room",
    role: "group",
    "aria-label":
      "The workspace: particles are squares, goals are rings. Tab to one and move it with the arrow keys.",
  });
  const space = svg("svg", {
    class: "room",
    role: "img",
    "aria-label": "The Δ configuration space",
  });
  const heading = el("span", { role: "status" }),
    where = el("span.soft.where", {});
  const table = el("div.plans", { role: "radiogroup", "aria-label": "Plans" }),
    reachWord = el("p.reached", {});
  const {
    input: seedInput,
    element: seedRow,
    row: seedFault,
  } = seedField("steeringSeed", () => {
    seed = seedIn(seedInput);
    redo();
  });

  const complain = faultsOf(
    warning,
    (name) => ({ workspace: byName, seed: seedFault })[name] ?? form.row(name),
  );

  const fields = () => ({ kind: "steering", ...problem });
  /** A ten-thousandth of the workspace: what a hand can place. */
  const round = (x) => {
    const step = 10 ** Math.floor(Math.log10((corners ? 1 : place?.size) || 1) - 4);
    return Number((Math.round(x / step) * step).toPrecision(12));
  };

  /** All that is set; plans follow from it. An outline that is not closed yet is set, too. */
  const whole = () => ({ problem, seed, corners });

  function put({ problem: given, seed: start = 0, corners: outline = null }) {
    problem = given;
    seedInput.value = seed = start;
    form.write(problem);
    corners = outline;
    showChoice();
    redo();
  }

  function keep(gesture = null) {
    store.act(whole(), gesture);
  }

  store.subscribe(() => {
    remember({ problem, seed, ...(corners ? { corners } : {}) });
    played.refresh();
  });

  // ---- what is asked ----

  function redo(gesture = null) {
    keep(gesture);
    plans = {};
    drawPlans();
    drawRoom();
    if (!corners) room.dataset.aged = ""; // until the workspace of these settings is there
    loadRoom();
  }

  const loadRoom = newest(async () => {
    try {
      place = await ask("workspace", { problem: fields(), seed });
      if (!corners) complain(null); // what is said of an outline stays
      form.usual(place.chosen);
      if (place.dimensions !== 2)
        throw new Error(
          "The studio draws workspaces in the plane only. For a workspace in space, use the command shoal steer.",
        );
      drawRoom();
      follow();
    } catch (error) {
      place = null;
      plans = {};
      complain(error);
      drawPlans();
    }
    delete room.dataset.aged;
    showVeil();
  });

  /** Settings without a workspace, such as points that are half typed, leave the last picture there:
   *  under a veil, and out of reach. */
  function showVeil() {
    for (const [figure, other] of [
      [roomBox, !place && !corners],
      [spaceBox, !place || corners],
    ]) {
      figure.inert = !!other;
      if (other && room.hasChildNodes()) figure.dataset.aged = "not of these settings";
      else delete figure.dataset.aged;
    }
  }

  /** What follows the hand: greedy's plan, where the workspace is convex, and what two moves reach. */
  const follow = newest(async () => {
    if (!place) return;
    const began = performance.now(),
      asked = fields();
    try {
      plans = place.convex
        ? { greedy: await ask("steer", { problem: { ...asked, planner: "greedy" }, seed }) }
        : {};
      performance.measure("shoal-greedy", { start: began });
      if (!corners) complain(null);
    } catch (error) {
      // greedy follows the hand, whichever planner is set
      const other = error.field === "planner" && planner() !== "greedy";
      plans = other ? { greedy: { problem: error.error } } : {};
      complain(other ? null : error);
    }
    drawRoom();
    drawPlans();
    clearTimeout(waiting);
    waiting = setTimeout(after, SLOW_AFTER);
  });

  /** The planner of the form, or the one that its default stands for. */
  const planner = () => problem.planner ?? place?.chosen.planner ?? "greedy";
  /** The plan on the workspace: greedy's, until that of another planner is there. */
  const drawn = () => plans[planner()] ?? plans.greedy;
  const hasFailed = (plan) => !!plan && plan.status !== "solved";
  const simple = () => place?.convex && place.start.length === 2;

  /** The planners whose plans are shown, the form's among them; where there is no workspace, those
   *  of the last one, without plans. */
  let offers = PLANS;
  function offered() {
    const quick = simple() ? PLANS : place?.convex ? ["greedy"] : [];
    if (place) offers = [...new Set([...quick, planner()])];
    return offers;
  }

  /** What is asked for, and whether it is still what is set. */
  function asking() {
    const asked = structuredClone(fields()),
      text = () => JSON.stringify([fields(), seed]),
      before = text();
    return { asked, same: () => text() === before };
  }

  const after = newest(async () => {
    if (!place) return;
    const { asked, same } = asking(),
      reached = await ask("reach", { problem: asked, seed, moves: 4 }).catch(() => ({
        sets: [],
        rings: [],
      }));
    if (!same()) return;
    drawReach(reached);
    for (const name of offered().filter((one) => one !== "greedy")) {
      if (!same()) return;
      const found = await ask("steer", {
        problem: { time: 3, ...asked, planner: name },
        seed,
        slow: true,
      }).catch((error) => ({ problem: error.error }));
      if (same()) plans[name] = found;
      drawPlans();
      drawRoom();
    }
  });

  // ---- the workspace ----

  /** Points of the plane to those of the picture: y goes up. */
  function frameOf(rings) {
    const all = rings.flat(),
      xs = all.map(([x]) => x),
      ys = all.map(([, y]) => y);
    const low = [Math.min(...xs), Math.min(...ys)],
      high = [Math.max(...xs), Math.max(...ys)],
      size = Math.max(high[0] - low[0], high[1] - low[1]) || 1;
    const unit = 100 / size;
    return {
      unit,
      at: ([x, y]) => [(x - low[0]) * unit, (high[1] - y) * unit],
      back: ([x, y]) => [low[0] + x / unit, high[1] - y / unit],
      width: (high[0] - low[0]) * unit,
      height: (high[1] - low[1]) * unit,
    };
  }

  const path = (points, at, closed = true) =>
    points
      .map(
        (point, i) =>
          `${i ? "L" : "M"}${at(point)
            .map((x) => x.toFixed(3))
            .join(" ")}`,
      )
      .join("") + (closed ? "Z" : "");

  let frame = null;
  const eye = { zoom: 1, x: -8, y: -8 }; // what of the picture is seen: its upper left corner
  function lookThrough() {
    const sides = [frame.width + 16, frame.height + 16].map((side) => side / eye.zoom);
    room.setAttribute("viewBox", `${eye.x} ${eye.y} ${sides.join(" ")}`);
  }
  function showAll() {
    Object.assign(eye, { zoom: 1, x: -8, y: -8 });
    if (frame) lookThrough();
  }
  /** A place on the element, in pixels, to one in the picture. */
  function spotIn([right, down]) {
    const box = room.getBoundingClientRect();
    return new DOMPoint(right + box.left, down + box.top).matrixTransform(
      room.getScreenCTM().inverse(),
    );
  }
  hands(room, {
    zoom(factor, spot) {
      const zoom = Math.max(1, Math.min(CLOSEST, eye.zoom * factor)),
        by = eye.zoom / zoom,
        at = spotIn(spot);
      if (zoom === 1) return showAll();
      Object.assign(eye, { zoom, x: at.x - (at.x - eye.x) * by, y: at.y - (at.y - eye.y) * by });
      return lookThrough();
    },
    pan(right, down) {
      if (eye.zoom === 1) return;
      const { a } = room.getScreenCTM();
      Object.assign(eye, { x: eye.x - right / a, y: eye.y - down / a });
      lookThrough();
    },
    fit: showAll,
    tap: (spot) => corners && addCorner(spotIn(spot)),
    over(spot) {
      const point = spot && frame && spotIn(spot);
      where.textContent = point ? frame.back([point.x, point.y]).map(round).join(", ") : "";
    },
  });

  function drawRoom() {
    drawHeading();
    if (!place && !corners) return;
    const focused = document.activeElement?.getAttribute("data-handle");
    frame = frameOf(
      corners
        ? [
            [
              [0, 0],
              [1, 1],
            ],
          ]
        : place.rings,
    );
    lookThrough();
    const { at } = frame;
    if (corners) {
      room.replaceChildren(
        svg("rect", { class: "paper", x: 0, y: 0, width: frame.width, height: frame.height }),
        ...(corners.length > 1
          ? [svg("path", { class: "draft", d: path(corners, at, false) })]
          : []),
        ...corners.map((corner) =>
          svg("circle", { class: "corner", cx: at(corner)[0], cy: at(corner)[1], r: 1.6 }),
        ),
      );
      return;
    }
    const plan = drawn(),
      failed = hasFailed(plan) ? " failed" : "",
      radius = Math.max(2.6, (problem.particle_radius ?? 0) * frame.unit);
    room.replaceChildren(
      svg("path", {
        class: "floor",
        "fill-rule": "evenodd",
        d: place.rings.map((ring) => path(ring, at)).join(""),
      }),
      ...(plan?.ways ?? []).map((way, i) =>
        svg("path", { class: `way p${i % 5}${failed}`, d: way.length ? path(way, at, false) : "" }),
      ),
      ...place.goal.map((point, i) =>
        handle(
          "goal",
          i,
          point,
          svg("circle", { class: `goal p${i % 5}`, r: Math.max(3.1, radius + 0.5) }),
        ),
      ),
      ...place.start.map((point, i) =>
        handle("start", i, point, svg("circle", { class: `particle p${i % 5}`, r: radius })),
      ),
    );
    if (focused) room.querySelector(`[data-handle="${focused}"]`)?.focus({ preventScroll: true });
  }

  /** A point that the hand moves, or the arrow keys. */
  function handle(what, i, point, shape) {
    const [x, y] = frame.at(point),
      words = `${what === "start" ? "Particle" : "Goal"} ${i + 1} at ${round(point[0])}, ${round(point[1])}`;
    const group = svg(
      "g",
      {
        class: "handle",
        transform: `translate(${x} ${y})`,
        tabindex: 0,
        role: "button",
        "aria-label": words,
        "data-handle": `${what}${i}`,
      },
      svg("circle", { class: "touch", r: 6 }),
      shape,
      svg("text", { class: "no", y: 1.3, "text-anchor": "middle" }, String(i + 1)),
    );
    group.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      event.stopPropagation();
      group.focus({ preventScroll: true });
      drag(what, i, event);
    });
    group.addEventListener("keydown", (event) => {
      const step = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] }[
        event.key
      ];
      if (!step) return;
      event.preventDefault();
      const by = (event.shiftKey ? 0.1 : 0.01) * place.size;
      move(what, i, [place[what][i][0] + by * step[0], place[what][i][1] + by * step[1]]);
      keep();
    });
    return group;
  }

  function drag(what, i, event) {
    room.setPointerCapture(event.pointerId);
    const go = (moved) => move(what, i, pointOf(moved));
    const stop = () => {
      keep();
      room.removeEventListener("pointermove", go);
      room.removeEventListener("pointerup", stop);
      room.removeEventListener("pointercancel", stop);
    };
    room.addEventListener("pointermove", go);
    room.addEventListener("pointerup", stop);
    room.addEventListener("pointercancel", stop);
  }

  function pointOf(event) {
    const spot = spotIn(spotOf(room, event));
    return frame.back([spot.x, spot.y]);
  }

  function move(what, i, point) {
    // Random points become those that are shown as soon as one of them is moved.
    const shown = (points, now) =>
      Array.isArray(now) ? now.map((one) => [...one]) : points.map((one) => one.map(round));
    problem = {
      ...problem,
      start: shown(place.start, problem.start),
      goal: shown(place.goal, problem.goal),
    };
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
    const { at, width, height } = frameOf(rings),
      goal = place.goal[1].map((x, axis) => x - place.goal[0][axis]);
    space.setAttribute("viewBox", `-6 -6 ${width + 12} ${height + 12}`);
    const spot = (point, kind) =>
      svg("circle", { class: kind, cx: at(point)[0], cy: at(point)[1], r: 2.4 });
    space.replaceChildren(
      svg("path", { class: "floor", d: path(rings[0], at) }),
      ...[...sets]
        .reverse()
        .map((set) =>
          svg("path", {
            class: `reach m${set.moves}`,
            "fill-rule": "evenodd",
            d: set.rings.map((ring) => path(ring, at)).join(""),
          }),
        ),
      svg("path", { class: "rim", d: path(rings[0], at) }),
      spot(goal, "goal p1"),
      spot(delta, "particle p0"),
    );
    refill(
      reachWord,
      el("span.key.begins", {}, "at the start"),
      el("span.key.ends", {}, "at the goals"),
      ...sets.map((set) =>
        el(`span.key.m${set.moves}`, {}, `${set.moves} moves reach ${percent(set.fraction)}`),
      ),
    );
  }

  // ---- plans ----

  function drawPlans() {
    table.replaceChildren(
      ...offered().map((name) => {
        const plan = plans[name];
        const note = !plan
          ? complain.said
            ? "no plan"
            : "planning …"
          : (plan.problem ??
            (plan.status === "solved"
              ? `${plan.moves} moves, length ${number(plan.length)}`
              : `${plan.status}: ${plan.reason}`));
        return el(
          hasFailed(plan) ? "button.plan.failed" : "button.plan",
          {
            type: "button",
            role: "radio",
            "aria-checked": String(name === planner()),
            onclick: () => {
              form.row("planner").write(name);
              problem = { workspace: problem.workspace, ...form.values() };
              keep();
              drawPlans();
              drawRoom();
            },
          },
          el("b", {}, name),
          el("span", {}, note),
        );
      }),
      el("p.soft", {}, boundWords()),
    );
  }

  /** What is proven of all plans, beside what was found. */
  function boundWords() {
    if (!plans.greedy?.bound) return "";
    const lengths = Object.values(plans)
      .filter((plan) => plan.status === "solved")
      .map((plan) => plan.length);
    const { bound } = plans.greedy,
      found = Math.min(...lengths);
    if (found <= bound * (1 + 1e-9))
      return `Proven: no plan is shorter than the shortest one found here (${number(found)}).`;
    const here = lengths.length ? ` The shortest one found here is ${number(found)} long.` : "";
    return `Proven: every plan is at least ${number(bound)} long.${here}`;
  }

  // ---- where the workspace comes from ----

  /** A drawn workspace, or an outline that is not closed yet, makes room for something else. */
  const own = () => corners?.length || /^\s*(multi)?polygon\b/i.test(String(problem.workspace));
  const leave = () => own() && say("The drawing is not lost: Ctrl Z brings it back.");

  /** The fields that say where the workspace comes from, as they are. */
  function showChoice() {
    const name = problem.workspace;
    typed.value = typeof name === "string" ? name : "";
    kinds.value = NAMES.includes(name) ? name : "";
    files.value = state.files.some((file) => file.name === name) ? name : "";
    kinds.options[0].textContent = own()
      ? "drawn here"
      : files.value
        ? "from a file"
        : "another one";
    sketch.textContent = corners ? "Close the outline" : "Draw a workspace";
    sketch.setAttribute("aria-pressed", String(!!corners));
    drawHeading();
  }

  /** What the workspace shows; a plan that does not arrive is said to. */
  function drawHeading() {
    const failed = !corners && hasFailed(drawn()),
      name = plans[planner()] ? planner() : "greedy";
    const words = failed
      ? `${capital(name)}: no plan that arrives`
      : corners
        ? SKETCH
        : "Workspace: drag particles and goals";
    if (heading.textContent !== words) heading.textContent = words; // said once
    heading.classList.toggle("bad", failed);
  }

  function take(name, points = {}) {
    leave();
    use(name, points);
  }

  function use(name, points = {}) {
    corners = null;
    showAll();
    problem = { workspace: name, ...form.values(), start: "random", goal: "random", ...points };
    form.write(problem);
    showChoice();
    stages.pick("plan");
    redo();
  }

  const kinds = el(
    "select",
    {
      "aria-label": "Workspace",
      onchange: guarded(
        () => kinds.value && take(kinds.value, kinds.value === "square" ? BEGIN : {}),
      ),
    },
    el("option", { value: "" }, "another one"),
    NAMES.map((name) => el("option", { value: name }, name)),
  );
  const files = el("select", {
    "aria-label": "A workspace in the folder",
    onchange: guarded(() => files.value && take(files.value)),
  });
  const typed = el("input", {
    type: "text",
    spellcheck: false,
    autocomplete: "off",
    id: "steeringWorkspace",
    onchange: guarded(() => typed.value && take(typed.value.trim())),
  });
  const byName = fieldRow(
    "workspace",
    "by name",
    { id: "steeringWorkspace", element: typed },
    schema.properties.workspace.description,
  );
  const picker = filePicker(async ([file]) => take(await upload(file)), {
    accept: ".svg,.wkt,.geojson,.json",
  });
  const sketch = el(
    "button.second",
    {
      type: "button",
      "aria-pressed": "false",
      onclick: guarded(() => (corners ? endSketch() : beginSketch())),
    },
    "Draw a workspace",
  );
  function beginSketch() {
    leave();
    corners = [];
    delete room.dataset.aged; // a hand may draw before the last workspace is there
    complain(null);
    showVeil();
    showChoice();
    stages.pick("plan");
    keep();
    drawRoom();
    room.scrollIntoView({ block: "nearest" }); // on a phone, it is above the settings
  }
  /** Close the outline: to take it back is one step, however many corners it has. */
  function endSketch() {
    const found = corners;
    if (found.length > 2 && crosses(found, found[0], { closes: true })) {
      complain(CROSSES_CLOSED);
      return;
    }
    store.fold((one) => !!one.corners);
    corners = null;
    showChoice();
    showVeil();
    if (found.length < 3) {
      keep();
      drawRoom();
      if (found.length) complain("An outline needs at least three corners.");
      return;
    }
    use(
      `POLYGON ((${[...found, found[0]].map((corner) => corner.map((x) => Math.round(x * 1e4) / 1e4).join(" ")).join(", ")}))`,
    );
  }
  function addCorner(spot) {
    const corner = frame.back([spot.x, spot.y]).map((x) => Math.max(0, Math.min(1, x)));
    const near = (other) => other && Math.hypot(corner[0] - other[0], corner[1] - other[1]) < 0.015;
    if (near(corners.at(-1)) || (corners.length > 2 && near(corners[0]))) {
      // a double click, or the first corner again, closes it
      endSketch();
      return;
    }
    if (crosses(corners, corner)) {
      complain(CROSSES);
      return;
    }
    complain(null);
    corners = [...corners, corner];
    keep();
    drawRoom();
  }
  function listFiles() {
    const found = state.files.filter(
      (file) =>
        ["workspace", "region"].includes(file.kind) && /\.(svg|wkt|geojson)$/i.test(file.name),
    );
    files.replaceChildren(
      el("option", { value: "" }, found.length ? "a file of the folder" : "no drawing yet"),
      ...found.map((file) => el("option", { value: file.name }, file.name)),
      ...olderFiles(leftOut("workspace") + leftOut("region")),
    );
    files.value = found.some((file) => file.name === problem.workspace) ? problem.workspace : "";
  }
  const chooser = el(
    "section.chooser",
    { "aria-label": "Workspace" },
    el("div.pair", {}, kinds, sketch),
    el(
      "div.pair",
      {},
      files,
      el("button.second", { type: "button", onclick: () => picker.click() }, "Bring a file"),
      picker,
    ),
    byName.element,
  );

  // ---- play ----

  const player = new PlayerFrame("steering", { title: "The player of the plan" });
  const result = el("div.result", {}),
    word = el("p.soft", { role: "status" });
  const go = el("button.main", { type: "button", onclick: guarded(play) }, "Play");

  async function play() {
    const given = fields(),
      at = store.text;
    shown = null;
    result.replaceChildren();
    player.close();
    empty.hidden = false;
    stages.pick("play");
    go.disabled = true;
    await run(
      "play",
      { problem: given, seed: JSON.parse(at).seed },
      {
        job: (now) => {
          word.textContent = progressText(now);
        },
        done: guarded(async ({ file, sentence }) => {
          go.disabled = false;
          word.textContent = "";
          await showEpisode(file, sentence, at);
          player.play();
        }),
        failed: (now) => {
          go.disabled = false;
          word.textContent = "";
          sayFailed(now);
        },
      },
    ).catch((error) => {
      go.disabled = false;
      throw error;
    });
  }

  async function showEpisode(file, sentence, at) {
    const { data, sentence: own } = await ask("page", { file });
    await player.open(data);
    empty.hidden = true;
    shown = { file, sentence: sentence ?? own };
    store.look({ file, at });
    played.is(at);
  }

  const empty = el("p.empty", {}, "Press Play to watch the plan here, contact by contact.");
  const roomBox = el("figure.workspace", {}, el("figcaption", {}, heading, where), room);
  const spaceBox = el(
    "figure.delta",
    {},
    el("figcaption", {}, "Δ space: particle 2, seen from particle 1"),
    space,
    reachWord,
  );
  const panels = {
    plan: el(
      "div.panel",
      {
        id: panelId("Steering", "plan"),
        role: "tabpanel",
        "aria-labelledby": tabId("Steering", "plan"),
      },
      el("div.twin", {}, roomBox, spaceBox),
      table,
    ),
    play: el(
      "div.panel",
      {
        id: panelId("Steering", "play"),
        role: "tabpanel",
        "aria-labelledby": tabId("Steering", "play"),
      },
      el("div.stageHead", {}, result),
      player.element,
      empty,
    ),
  };
  /** Say so if the episode on the stage is of other settings than those that are set now. */
  const played = dated(
    () => store.text,
    player.element,
    (fresh) => {
      if (shown)
        result.replaceChildren(
          el("p", {}, shown.sentence),
          fresh
            ? ""
            : el(
                "p.soft",
                {},
                `${shown.file}: the settings have changed since. Play plays them as they are now.`,
              ),
          exports(shown.file, { fresh }),
        );
    },
  );
  const stages = tabs(
    "Steering",
    [
      ["plan", "Plan"],
      ["play", "Episode"],
    ],
    (name) => {
      for (const [other, panel] of Object.entries(panels)) panel.hidden = other !== name;
      store.look({ tab: name });
    },
  );
  stages.pick("plan");
  on("files", listFiles);
  listFiles();

  return {
    element: el(
      "div.place.steering-place",
      {},
      el(
        "section.stage-side",
        { "aria-label": "Stage" },
        el("div.stageTop", {}, stages.list, stepButtons(store)),
        warning,
        Object.values(panels),
      ),
      el("section.panel-side", { "aria-label": "Settings" }, chooser, form.element),
      el(
        "footer.bottom",
        {},
        seedRow,
        word,
        el(
          "button.second",
          {
            type: "button",
            onclick: guarded(() =>
              !panels.play.hidden && shown && played.fresh
                ? showCopiesOf(shown.file)
                : showCopies(fields(), seed),
            ),
          },
          "As Python …",
        ),
        go,
      ),
    ),
    title: "Steering",
    store,
    /** As it was before a reload. */
    async revive(saved) {
      begun = true;
      const { tab = "plan", file, at } = saved.view;
      store.revive(saved);
      stages.pick(tab);
      if (file) await guarded(showEpisode)(file, null, at);
    },
    open(given) {
      if (begun && !given?.problem) return;
      if (begun) leave();
      begun = true;
      if (given?.problem) stages.pick("plan");
      put(
        given?.problem
          ? { ...given, problem: { workspace: BEGIN.workspace, ...given.problem } }
          : { problem, seed },
      );
    },
    run: play,
  };
}
