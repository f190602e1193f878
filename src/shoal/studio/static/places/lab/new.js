/* A new sweep: a form made from what is declared of problems, and its file beside it; each
 * follows the other. */
import { ask, newest, run } from "../../shared/api.js";
import { Store, stepButtons } from "../../shared/store.js";
import { NEED_OPTIONS, makeForm, parsed, seedIn } from "../../shared/form.js";
import { el, guarded, number } from "../../shared/page.js";
import { sayFailed, HOW_OF_SWEEP, showForms } from "../../shared/share.js";

/** A sweep of each kind to begin with: a question that its result answers. */
const QUESTIONS = {
  swarm: {
    name: "policies",
    problem: { map: "vessels:300", particles: 20 },
    axes: { policy: ["best", "closest-frontier"] },
  },
  search: {
    name: "crashes",
    problem: { region: "square:200", robots: 5, footprint: 20 },
    axes: { crashes: [0, 1] },
  },
  steering: { name: "planners", problem: {}, axes: { planner: ["greedy", "shortest"] } },
  line: { name: "line", problem: { cells: 100 }, axes: { particles: [5, 10] } },
  schedule: { name: "schedules", problem: {}, axes: { schedule: ["i^i", "every-step"] } },
};
/** A name as it is typed; it becomes part of a file's name, which has no blanks. */
const nameIn = (text) => text.trim().replace(/\s+/g, "-");
const questionOf = (kind) => {
  const { name, problem, axes } = QUESTIONS[kind] ?? { name: kind, problem: {}, axes: {} };
  return structuredClone({ name, problem: { kind, ...problem }, axes, paired: Object.keys(axes) });
};
/** @type {Record<string, any>} */
const FIRST = { trials: 20, seed: 0, ...questionOf("swarm") };
const RANGE = /^(\S+)\s+to\s+(\S+)\s+(?:step\s+(\S+)|in\s+(\d+)\s+values?)(\s+log)?$/i;
const HELP =
  "Values separated by spaces, or a range such as “5 to 20 step 5” or “1 to 1000 in 4 values log”.";

/** Text to the values of an axis. */
function axisOf(text, field) {
  const plain = text.trim(),
    range = plain.match(RANGE);
  if (range) {
    const [from, to, step, count] = range
      .slice(1, 5)
      .map((one) => (one === undefined ? undefined : Number(one)));
    return {
      from,
      to,
      ...(step === undefined ? { count } : { step }),
      ...(range[5] ? { scale: "log" } : {}),
    };
  }
  if (plain.startsWith("[")) return parsed(plain);
  const truth = { yes: true, no: false, true: true, false: false };
  const values = plain
    .split(/number|integer/.test(String(field?.type)) ? /[\s,]+/ : /\s+/)
    .filter(Boolean);
  return values.map((word) =>
    String(field?.type).includes("boolean") && word in truth
      ? truth[word]
      : field?.names
        ? word
        : parsed(word),
  );
}

function axisText(values) {
  if (!Array.isArray(values))
    return values?.from === undefined
      ? ""
      : `${values.from} to ${values.to} ${values.step === undefined ? `in ${values.count} values` : `step ${values.step}`}${values.scale === "log" ? " log" : ""}`;
  const plain = values.every((value) => typeof value !== "object" && !/\s/.test(String(value)));
  return plain
    ? values.map((value) => (value === true ? "yes" : value === false ? "no" : value)).join(" ")
    : JSON.stringify(values);
}

export function drafting({ shown, started }) {
  const store = new Store((toml) => {
    text.value = toml;
    read();
  });
  let forms = null,
    form = null,
    rows = [],
    answer = null,
    own = FIRST.name, // the name that nobody typed
    given = structuredClone(FIRST);
  const id = (words) => `sweep${words}`;
  const name = el("input", {
    type: "text",
    id: id("Name"),
    spellcheck: false,
    oninput: changed,
    onchange: () => {
      name.value = nameIn(name.value);
    },
  });
  const trials = el("input", { type: "number", id: id("Trials"), min: 1, oninput: changed }),
    seed = el("input", { type: "number", id: id("Seed"), min: 0, oninput: changed });
  const kind = el("select", {
    id: id("Kind"),
    onchange: () => {
      const { name: usual, ...question } = questionOf(kind.value),
        { name: typed, ...set } = fields(),
        isOwn = typed !== "" && typed !== own;
      own = usual;
      fill({ ...set, ...question, name: isOwn ? typed : usual });
      changed();
    },
  });
  const axes = el("div.axes", {}),
    room = el("div", { oninput: changed }), // texts, too, while they are typed
    info = el("p.soft", { role: "status" }, "Reading the fields of sweeps …"),
    problem = el("p.warning", { role: "alert", hidden: true });
  const text = el("textarea.code", {
    id: id("Toml"),
    spellcheck: false,
    rows: 18,
    oninput: () => {
      clearTimeout(waiting);
      waiting = setTimeout(read, 300);
    },
  });
  const add = el(
    "button.second.small",
    {
      type: "button",
      onclick: () => {
        addAxis();
        nameByAxes();
        changed();
        rows.at(-1).choice.focus();
      },
    },
    "Another axis",
  );
  const go = el("button.main", { type: "button", onclick: guarded(start) }, "Run the sweep");
  let waiting = null;

  const labelled = (words, control, help) =>
    el(
      "div.field",
      {},
      el("label", { htmlFor: control.id }, words),
      control,
      help ? el("p.help", {}, help) : [],
    );

  // ---- axes ----

  function addAxis(axis = null, values = [], paired = null) {
    const properties = forms[kind.value].schema.properties,
      at = `axis${rows.length}-${Date.now() % 1e6}`;
    const choice = el(
      "select",
      { id: `${at}-field` },
      Object.entries(properties).map(([key, field]) => el("option", { value: key }, field.title)),
    );
    const input = el("input", {
      type: "text",
      id: `${at}-values`,
      spellcheck: false,
      autocomplete: "off",
      oninput: () => {
        showChips();
        changed();
      },
      "aria-describedby": `${at}-about ${at}-help`,
    });
    const same = el("input.switch", { type: "checkbox", id: `${at}-paired`, onchange: changed }),
      about = el("p.help", { id: `${at}-about` }),
      chips = el("div.picks", {});
    const row = { choice, input, same, read: () => axisOf(input.value, properties[choice.value]) };
    const free = Object.keys(properties).filter(
      (key) => !rows.some((other) => other.choice.value === key),
    );
    choice.value =
      axis ??
      ["policy", "planner", "allocation", "particles"].find((key) => free.includes(key)) ??
      free[0];
    input.value = axisText(values);
    // so that the difference has an interval of its own
    same.checked = paired ?? true;

    function showChips() {
      const field = properties[choice.value],
        words =
          field.names?.filter((word) => !NEED_OPTIONS.includes(word)) ??
          field.enum ??
          (String(field.type).includes("boolean") ? ["yes", "no"] : []);
      about.textContent = words.length ? "" : field.description;
      const there = () => input.value.trim().split(/\s+/).filter(Boolean);
      chips.replaceChildren(
        ...words.map((word) =>
          el(
            "label.pick",
            {},
            el("input", {
              type: "checkbox",
              checked: there().includes(word),
              onchange: (event) => {
                input.value = (
                  event.target.checked ? [...there(), word] : there().filter((one) => one !== word)
                ).join(" ");
                changed();
              },
            }),
            word,
          ),
        ),
      );
    }
    choice.addEventListener("change", () => {
      input.value = "";
      nameByAxes();
      showChips();
      hideVaried();
      changed();
    });
    row.element = el(
      "fieldset.axis",
      {},
      el("legend.unseen", {}, "Axis"),
      el(
        "div.pair",
        {},
        choice,
        el(
          "button.second.small",
          {
            type: "button",
            onclick: () => {
              rows = rows.filter((one) => one !== row);
              row.element.remove();
              if (rows.length) nameByAxes();
              hideVaried();
              changed();
            },
          },
          "Remove",
        ),
      ),
      el("label.unseen", { htmlFor: choice.id }, "What varies"),
      el("label.unseen", { htmlFor: input.id }, "Values"),
      input,
      chips,
      about,
      el("p.help", { id: `${at}-help` }, HELP),
      el(
        "div.field.inline",
        {},
        el("label", { htmlFor: same.id }, "The same seeds for each value"),
        same,
      ),
    );
    rows.push(row);
    axes.append(row.element);
    showChips();
    hideVaried();
  }

  /** A name that nobody typed says what varies. */
  function nameByAxes() {
    if (name.value !== own) return;
    name.value = own = rows.map((row) => row.choice.value.replaceAll("_", "-")).join("-and-");
  }

  /** A field that varies is not among those that stay. */
  function hideVaried() {
    const names = Object.keys(forms[kind.value].schema.properties);
    form.show(names, true);
    form.show(
      rows.map((row) => row.choice.value),
      false,
    );
  }

  // ---- form and file ----

  function fill(sweep) {
    const { problem: set = {}, axes: varied = {}, paired = [] } = sweep;
    name.value = sweep.name ?? "";
    trials.value = sweep.trials ?? 1;
    seed.value = sweep.seed ?? 0;
    kind.value = Object.hasOwn(forms, set.kind) ? set.kind : "swarm";
    const { schema } = forms[kind.value],
      all = Object.entries(schema.properties);
    const main = all
      .filter(([key, field]) => field.place || field.names || schema.required.includes(key))
      .map(([key]) => key);
    form = makeForm(schema, [{ title: "What stays the same", open: true, fields: main }], {
      changed,
      understood: parsed,
    });
    form.write(set);
    room.replaceChildren(form.element);
    rows = [];
    axes.replaceChildren();
    for (const [axis, values] of Object.entries(varied))
      if (schema.properties[axis]) addAxis(axis, values, paired.includes(axis));
    hideVaried();
  }

  function fields() {
    const found = {},
      paired = [];
    for (const row of rows) {
      found[row.choice.value] = row.read();
      if (row.same.checked) paired.push(row.choice.value);
    }
    const stays = Object.fromEntries(
      Object.entries(form.values()).filter(([key]) => !(key in found)),
    );
    return {
      name: nameIn(name.value),
      trials: Number(trials.value),
      seed: seedIn(seed),
      paired,
      problem: { kind: kind.value, ...stays },
      axes: found,
    };
  }

  function show(found, { keep = false } = {}) {
    if (found.other && !keep && name.value === own) {
      // another sweep of the folder has the name that nobody typed
      name.value = own = found.other;
      changed();
      return;
    }
    if (found.other)
      found.error = `${found.store} holds another sweep of this name: give this one another name.`;
    answer = found;
    if (!keep && found.toml !== undefined) text.value = found.toml;
    problem.hidden = !found.error;
    problem.textContent = found.error ?? "";
    go.disabled = !!found.error;
    info.textContent = found.error
      ? ""
      : `${number(found.points, 9)} ${found.points === 1 ? "point" : "points"}, ${number(found.trials, 9)} trials. ${found.taken ? `${found.store} is there: what is new is added to it.` : `Results go to ${found.store}.`}`;
    store.act(text.value, document.activeElement?.id || null);
    shown({ toml: text.value });
  }

  const check = newest(guarded(async () => show(await ask("new-sweep", { sweep: fields() }))));
  function changed() {
    if (form) check();
  }

  const read = newest(
    guarded(async () => {
      const found = await ask("new-sweep", { toml: text.value });
      if (found.sweep && !found.error) fill(found.sweep);
      show(found, { keep: true });
    }),
  );

  async function start() {
    clearTimeout(waiting);
    const found = await ask("new-sweep", { toml: text.value });
    show(found, { keep: true });
    if (found.error) return;
    const sweep = found.sweep.name;
    await run(
      "sweep",
      { toml: text.value, store: found.store, sweep },
      {
        failed: (job) => {
          if (job.state === "failed") sayFailed(job);
        },
      },
    );
    started(found.store, sweep);
  }

  const element = el(
    "div.labTwo.drafting",
    {},
    el(
      "section.setting",
      { "aria-label": "Form" },
      el(
        "div.quartet",
        {},
        labelled("Name", name),
        labelled("Kind of problem", kind),
        labelled("Trials per point", trials),
        labelled("Seed", seed),
      ),
      el("h2", {}, "What varies"),
      axes,
      add,
      room,
    ),
    el(
      "section.setting.file",
      { "aria-label": "File" },
      el(
        "div.stageTop",
        {},
        el("h2", {}, el("label", { htmlFor: text.id }, "The same as a file")),
        stepButtons(store),
      ),
      el(
        "p.help",
        {},
        "Change the sweep here or in the form. ",
        el("code", {}, "shoal sweep run"),
        " runs this file.",
      ),
      text,
      problem,
      info,
      el(
        "div.actions",
        {},
        go,
        el(
          "button.second",
          {
            type: "button",
            onclick: guarded(async () => {
              if (answer?.copies) showForms(answer.copies, { how: HOW_OF_SWEEP });
            }),
          },
          "As Python …",
        ),
      ),
    ),
  );

  async function ready() {
    if (forms) return;
    forms = await ask("lab-forms", {});
    kind.replaceChildren(...Object.keys(forms).map((one) => el("option", { value: one }, one)));
    const { toml, ...sweep } = given;
    fill(sweep);
    if (toml) await write(toml);
    else await check();
  }

  async function write(toml) {
    given.toml = toml;
    own = null;
    if (!forms) return;
    text.value = toml;
    await read();
  }

  return {
    element,
    store,
    write,
    open: guarded(ready),
    /** Begin with a problem of another place, or with a file. */
    begin({ toml, draft }) {
      given = draft ? { ...structuredClone(FIRST), ...draft } : { ...given, toml };
      if (forms && draft) {
        fill(given);
        changed();
      } else if (forms) write(toml);
    },
  };
}
