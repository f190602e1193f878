/* Forms made from the schema of a problem: no field is written here. */
import { capital, el, told } from "./page.js";

/** What follows a name and a colon, for names that mean nothing without it. */
const NEEDED = {
  manual: "its commands, such as llurr",
  offline: "its planner, such as best",
  model: "its file in the folder, such as learned.onnx",
};
export const NEED_OPTIONS = Object.keys(NEEDED);

/** What a number field holds; the browser gives nothing for what is no number, and nothing would be
 *  the default. */
const numberIn = (input) =>
  input.validity.badInput ? "no number" : input.value === "" ? undefined : Number(input.value);

/** Say so if a link has fields that no form has: nothing of them would be in the result. */
export function sayUnknown(schema, problem) {
  const unknown = Object.keys(problem).filter(
    (name) => name !== "kind" && !Object.hasOwn(schema.properties, name),
  );
  if (unknown.length)
    told(
      new Error(
        `The link has settings that the studio does not know, and leaves them out: ${unknown.join(", ")}.`,
      ),
    );
}

const LINE = 46; // characters of one line under a field
const ROOM = 90; // and of two: what a caption may have

/** The caption of a field: the first sentence of its description, up to a break that fits in two
 *  lines. What comes after a colon, a semicolon or a bracket explains; after a comma it goes on. */
export function captionOf(description) {
  if (description.length <= LINE) return description;
  const [sentence] = description.match(/^.*?(?<!\.)[.;](?=\s|$)/) ?? [description],
    whole = sentence.replace(/;$/, "");
  if (whole.length <= ROOM) return whole;
  const breaks = (mark) => [...whole.matchAll(mark)].map(({ index }) => index);
  const colons = breaks(/: /g),
    // 'With “prior”: ...' says when, and not what
    what = /^(For|With|Under|In place of)\b/.test(whole) ? colons.slice(1) : colons,
    named = [...what, ...breaks(/ \(|; /g)].sort((a, b) => a - b),
    lists = what[0] < 20; // 'Policy: auto, best, ...'
  const end = named.find((at) => at >= 20 && at <= ROOM),
    comma = breaks(/, /g).findLast((at) => at >= 30 && at < ROOM - (lists ? 12 : 0));
  if (end !== undefined && !(lists && whole[end + 1] === "(")) return whole.slice(0, end);
  return comma === undefined ? whole : whole.slice(0, comma) + (lists ? ", …" : "");
}

/** The row of a field: its label, its control, a caption, more help behind an i, and what
 *  is wrong with its value. `label` is what is said about it elsewhere, too. */
export function fieldRow(name, label, control, description, { unit = "", inline = false } = {}) {
  const { id, element } = control,
    input = element.id === id ? element : element.querySelector(`#${id}`);
  const caption = captionOf(description),
    long = caption !== description;
  const help = el("p.help.short", { id: `${id}-help` }, caption),
    more = el("p.help", { id: `${id}-more`, hidden: true }, description),
    fault = el("p.fault", { id: `${id}-fault`, hidden: true });
  const info = el(
    "button.info",
    {
      type: "button",
      "aria-label": "Explanation",
      "aria-describedby": `label-${id}`,
      "aria-expanded": "false",
      "aria-controls": more.id,
      onclick: () => {
        more.hidden = !more.hidden;
        help.hidden = !more.hidden || !fault.hidden;
        info.setAttribute("aria-expanded", String(!more.hidden));
      },
    },
    "i",
  );
  input.setAttribute("aria-describedby", help.id);
  const row = el(
    `div.field${inline ? ".inline" : ""}`,
    { "data-field": name },
    el(
      "div.label",
      {},
      el("label", { id: `label-${id}`, htmlFor: id }, label, unit ? el("span.unit", {}, unit) : []),
      long ? info : [],
    ),
    element,
    fault,
    help,
    more,
  );
  return {
    element: row,
    label,
    input,
    /** Say what is wrong with the value, in the place of the help; null: nothing. */
    fault(sentence) {
      fault.textContent = sentence ?? "";
      fault.hidden = !sentence;
      help.hidden = !!sentence || !more.hidden;
      input.setAttribute("aria-describedby", sentence ? fault.id : help.id);
      if (sentence) input.setAttribute("aria-invalid", "true");
      else input.removeAttribute("aria-invalid");
    },
  };
}

function goTo({ input }) {
  const section = input.closest("details");
  if (section) section.open = true;
  input.focus();
  input.scrollIntoView({ block: "center" });
}

/** What the server finds wrong stands at its field; `banner` says it over the stage, with a way
 *  there. `rowOf(name)` is the row of a field, if the page has one. */
export function faultsOf(banner, rowOf) {
  let row = null;
  complain.said = null;
  /** `fault` is an error or an answer of the server; null: nothing is wrong. */
  function complain(fault) {
    row?.fault(null);
    complain.said = fault?.error ?? null;
    const sentence = fault?.error ?? fault?.message ?? fault ?? "";
    row = (fault?.field && rowOf(fault.field)) || null;
    row?.fault(sentence);
    banner.hidden = !sentence;
    // a hint about what is drawn, and no fault of a field
    banner.classList.toggle("hint", typeof fault === "string");
    const there = row;
    banner.replaceChildren(
      ...(there
        ? [
            el(
              "button.there",
              { type: "button", onclick: () => goTo(there) },
              `${capital(there.label)}:`,
            ),
            " ",
          ]
        : []),
      sentence,
    );
  }
  return complain;
}

/** A seed as it is typed; those above 53 bits stay text, so that none of their digits are lost. */
export const seedIn = (input) =>
  input.validity.badInput
    ? "no number"
    : Number.isSafeInteger(Number(input.value))
      ? Number(input.value)
      : input.value;

/** The field of a place's seed beside its word; `id` is the field's. */
export const seedField = (id, onchange) => {
  const input = el("input.short", { type: "number", min: 0, value: 0, id, onchange });
  const row = {
    input,
    label: "seed",
    element: el("span.seed", {}, el("label", { htmlFor: id }, "Seed"), input),
    // the foot of the page has no room for a sentence: it stands over the stage
    fault: (sentence) =>
      sentence ? input.setAttribute("aria-invalid", "true") : input.removeAttribute("aria-invalid"),
  };
  return { input, element: row.element, row };
};

let made = 0;
const FOUND = "as it is found";

/** What an empty field does, as its placeholder: what the server chose for it, or `else_`. */
const placeholder = (input, else_) => (words) => {
  input.placeholder = words ? `auto: ${words}` : else_;
};

/** Where sliders are worth having: fields between two bounds; a place may name narrower ends for
 *  the hand. */
const isSlider = (field, ends) =>
  ends ||
  (field.minimum !== undefined &&
    field.maximum !== undefined &&
    field.maximum <= 1 &&
    kindOf(field) === "number");

function kindOf(field) {
  const type = Array.isArray(field.type) ? field.type[0] : field.type;
  return type ?? "text";
}

const nullable = (field) => Array.isArray(field.type);

/** Text to value, where a list of values is typed: points '1,2 3,4', numbers, words. */
export function parsed(text) {
  const plain = text.trim();
  if (plain === "") return undefined;
  if (/^[[{]/.test(plain)) {
    try {
      return JSON.parse(plain);
    } catch {
      return plain;
    }
  }
  if (/^-?[\d.eE+-]+(,-?[\d.eE+-]+)+([\s;]+-?[\d.eE+-]+(,-?[\d.eE+-]+)+)*$/.test(plain)) {
    return plain.split(/[\s;]+/).map((point) => point.split(",").map(Number));
  }
  return /^-?\d+(\.\d+)?(e-?\d+)?$/i.test(plain) ? Number(plain) : plain;
}

export function written(value) {
  if (value === null || value === undefined) return "";
  if (Array.isArray(value))
    return value.some(Array.isArray)
      ? value.map((point) => point.join(",")).join(" ")
      : value.join(",");
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}

/** A control for one field: an element, and functions that read and write its value (undefined: the
 *  default). */
function control(name, field, ends, changed, understood) {
  const id = `field-${name}-${++made}`,
    kind = kindOf(field),
    about = { id };
  if (field.names && !field.several) return named(field, about, changed);
  if (field.enum || (kind === "boolean" && nullable(field))) {
    const values = field.enum ?? [true, false];
    const words = field.enum ?? ["yes", "no"];
    const select = el(
      "select",
      { ...about, onchange: changed },
      nullable(field) ? el("option", { value: "" }, FOUND) : [],
      words.map((word, i) => el("option", { value: String(values[i]) }, word)),
    );
    return {
      id,
      element: select,
      read: () =>
        select.value === "" ? undefined : values.find((value) => String(value) === select.value),
      write: (value) => {
        select.value =
          value === null || value === undefined ? String(field.default ?? "") : String(value);
      },
      usual(words) {
        if (nullable(field)) select.options[0].textContent = words ? `auto: ${words}` : FOUND;
      },
    };
  }
  if (kind === "boolean") {
    const box = el("input.switch", { ...about, type: "checkbox", onchange: changed });
    return {
      id,
      element: box,
      inline: true,
      read: () => box.checked,
      write: (value) => {
        box.checked = value ?? field.default;
      },
    };
  }
  if (kind === "number" || kind === "integer")
    return isSlider(field, ends)
      ? slider(field, about, ends, changed)
      : numeric(field, about, kind, changed);
  const input = el("input", {
    ...about,
    type: "text",
    autocomplete: "off",
    spellcheck: false,
    placeholder: written(field.default) || (field.several ? "all" : "none"),
    onchange: changed,
  });
  // not by commas: a ring has some, and names of files may
  const words = () =>
    input.value
      .split(";")
      .map((word) => word.trim())
      .filter(Boolean);
  return {
    id,
    element: input,
    read: () =>
      input.value.trim() === ""
        ? undefined
        : field.repeated
          ? words()
          : understood(input.value.trim()),
    write: (value) => {
      input.value = field.repeated ? [value ?? []].flat().join("; ") : written(value);
    },
    usual: placeholder(input, input.placeholder),
  };
}

function numeric(field, about, kind, changed) {
  const input = el("input", {
    ...about,
    type: "number",
    inputmode: "decimal",
    min: field.minimum ?? field.exclusiveMinimum,
    max: field.maximum ?? field.exclusiveMaximum,
    step: kind === "integer" ? 1 : "any",
    placeholder: nullable(field) ? "none" : String(field.default ?? ""),
    oninput: changed,
  });
  return {
    id: about.id,
    element: input,
    read: () => numberIn(input),
    write: (value) => {
      input.value = value ?? (nullable(field) ? "" : (field.default ?? ""));
    },
    usual: placeholder(input, input.placeholder),
  };
}

function slider(field, about, ends, changed) {
  const [low, high] = ends ?? [field.minimum, field.maximum];
  const range = el("input", {
    type: "range",
    min: low,
    max: high,
    step: (high - low) / 100,
    "aria-label": field.title,
    tabIndex: -1,
  });
  const input = el("input.short", {
    ...about,
    type: "number",
    min: field.minimum ?? field.exclusiveMinimum,
    max: field.maximum,
    step: "any",
  });
  range.addEventListener("input", () => {
    input.value = Number(Number(range.value).toPrecision(4));
    changed();
  });
  input.addEventListener("input", () => {
    range.value = input.value;
    changed();
  });
  return {
    id: about.id,
    element: el("div.slide", {}, range, input),
    read: () => numberIn(input),
    write: (value) => {
      input.value = value ?? field.default ?? "";
      range.value = input.value;
    },
  };
}

/** A name out of several, with options after a colon. */
function named(field, about, changed) {
  const select = el(
    "select",
    {
      ...about,
      onchange: () => {
        options.value = "";
        showOptions();
        changed();
      },
    },
    field.names.map((name) => el("option", { value: name }, name)),
  );
  const showOptions = () => {
    options.hidden = select.value === "auto";
    options.placeholder = NEEDED[select.value] ?? "its options, if it has any";
  };
  const options = el("input", {
    type: "text",
    autocomplete: "off",
    spellcheck: false,
    "aria-label": `Options of the ${field.title}`,
    onchange: changed,
  });
  return {
    id: about.id,
    element: el("div.named", {}, select, options),
    read: () => (options.value.trim() ? `${select.value}:${options.value.trim()}` : select.value),
    write: (value) => {
      const text = String(value ?? field.default),
        [name, ...rest] = text.split(":");
      if (!field.names.includes(name)) select.append(el("option", { value: name }, name));
      select.value = name;
      options.value = rest.join(":");
      showOptions();
    },
    usual(words) {
      const auto = [...select.options].find((one) => one.value === "auto");
      if (auto) auto.textContent = words ? `auto: ${words}` : "auto";
    },
  };
}

/** A form of sections; `sections` lists names of fields for the eye only, and those that none names
 *  come last, under "More".
 *  `changed(values, name)` is told of every change; values hold what differs from the defaults.
 *  Texts stay as they are, since the
 *  server reads them as the command does, if `understood` does not make values of them. */
export function makeForm(
  schema,
  sections,
  { hidden = [], ends = {}, label = "Settings", changed, understood = (text) => text },
) {
  const controls = new Map(),
    fields = schema.properties;
  const namedFields = new Set([...hidden, ...sections.flatMap((section) => section.fields)]);
  const rest = Object.keys(fields).filter((name) => !namedFields.has(name));
  const all = rest.length ? [...sections, { title: "More", fields: rest }] : sections;
  const parts = all.map((section) =>
    el(
      "details.section",
      { open: !!section.open },
      el("summary", {}, section.title, el("span.soft", {}, section.hint ?? "")),
      section.before ?? [],
      section.fields.filter((name) => fields[name]).map((name) => row(name, fields[name])),
      section.after ?? [],
    ),
  );

  function row(name, field) {
    const one = control(name, field, ends[name], () => changed(values(), name), understood);
    controls.set(name, one);
    one.write(undefined);
    const { unit } = field,
      { element: row, ...told } = fieldRow(name, field.title, one, field.description, {
        unit,
        inline: one.inline,
      });
    Object.assign(one, told);
    return row;
  }

  function values() {
    const found = {};
    for (const [name, one] of controls) {
      const value = one.read(),
        usual = fields[name].default;
      if (value !== undefined && value !== usual && written(value) !== "") found[name] = value;
    }
    return found;
  }

  return {
    element: el(
      "form.form",
      { onsubmit: (event) => event.preventDefault(), "aria-label": label },
      parts,
    ),
    values,
    write(given) {
      for (const [name, one] of controls) one.write(given[name]);
    },
    row: (name) => controls.get(name),
    /** Show what fields at their defaults do: `chosen` has words for some of them. */
    usual(chosen = {}) {
      for (const [name, one] of controls) one.usual?.(chosen[name]);
    },
    show(names, on) {
      for (const name of names) {
        const found = parts
          .map((part) => part.querySelector(`[data-field="${name}"]`))
          .find(Boolean);
        if (found) found.hidden = !on;
      }
    },
  };
}
