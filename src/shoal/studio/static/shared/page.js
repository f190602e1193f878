/* Making elements, saying things, dialogs. Text is only ever set as text. */

/** Make an element: `el("p.soft", { id: "x" }, "text", child, ...)`.
 *
 *  @param {string} what
 *  @param {Record<string, any>} attributes
 *  @param {...any} children
 *  @returns {any} an element of the kind that its tag names */
export function el(what, attributes = {}, ...children) {
  const [tag, ...classes] = what.split(".");
  const made = document.createElement(tag || "div");
  if (classes.length) made.className = classes.join(" ");
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made && !["list", "form", "type"].includes(name)) made[name] = value;
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(
    ...children.flat().filter((child) => child !== null && child !== undefined && child !== false),
  );
  return made;
}

const SVG = "http://www.w3.org/2000/svg";
/** Make an element of a drawing.
 *
 *  @param {string} tag
 *  @param {Record<string, any>} attributes
 *  @param {...any} children
 *  @returns {any} */
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.flat());
  return made;
}

/** Show other children. Without any, those that were there keep their room, unseen, so that nothing
 *  below or beside them moves. */
export function refill(element, ...children) {
  const filled = children.flat().some((child) => child !== "");
  element.style.visibility = filled ? "" : "hidden";
  if (filled) element.replaceChildren(...children.flat());
}

/** A label as it begins a line. */
export const capital = (label) => label.charAt(0).toUpperCase() + label.slice(1);

const causes = new WeakMap(); // of notes: what failed

/** Say something for a while; a problem stays until it is closed, or until its cause is gone. */
export function say(sentence, { problem = false, link = null, cause = null } = {}) {
  const note = el(
    problem ? "p.note.bad" : "p.note",
    {},
    el("span", {}, sentence),
    link ? el("a", { href: link }, "Show it") : [],
  );
  const close = () => note.remove();
  if (cause) causes.set(note, cause);
  note.append(
    el("button.quiet.icon", { type: "button", onclick: close, "aria-label": "Close" }, "×"),
  );
  const notes = document.getElementById("notes");
  for (const other of [...notes.children])
    if (other.firstChild.textContent === sentence) other.remove(); // said anew, not twice
  notes.append(note);
  while (notes.children.length > 3) notes.firstChild.remove();
  if (!problem) setTimeout(close, 6000);
}

/** What failed before has succeeded: nothing is said of it any more. */
export function settled(cause) {
  for (const note of [...document.getElementById("notes").children])
    if (causes.get(note) === cause) note.remove();
}

/** Say what went wrong; an error may name its cause. */
export const told = (error, cause = error.cause ?? null) =>
  say(error.message ?? String(error), { problem: true, cause });

/** Return a handler that says what goes wrong in it. */
export const guarded =
  (work) =>
  async (...given) => {
    try {
      const result = await work(...given);
      settled(work);
      return result;
    } catch (error) {
      told(error, error.cause ?? work);
      return undefined;
    }
  };

/** Let files be dropped on an element. */
export function acceptDrops(element, bring) {
  for (const kind of ["dragover", "dragenter"])
    element.addEventListener(kind, (event) => {
      event.preventDefault();
      element.classList.add("dropping");
    });
  for (const kind of ["dragleave", "drop"])
    element.addEventListener(kind, () => element.classList.remove("dropping"));
  element.addEventListener(
    "drop",
    guarded(async (event) => {
      event.preventDefault();
      const files = [...event.dataTransfer.files];
      if (files.length) await bring(files);
    }),
  );
}

/** A hidden input that lets the user pick files, one or with `multiple` several, and calls
 *  bring(files); its click() opens the dialog. */
export function filePicker(bring, attributes = {}) {
  const input = /** @type {HTMLInputElement} */ (
    el("input", {
      type: "file",
      hidden: true,
      ...attributes,
      onchange: guarded(async () => {
        const files = [...input.files];
        input.value = ""; // the same file can be picked again
        if (files.length) await bring(files);
      }),
    })
  );
  return input;
}

export function openSheet(title, ...children) {
  const sheet = /** @type {HTMLDialogElement} */ (document.getElementById("sheet"));
  sheet.replaceChildren(
    el(
      "div.sheetHead",
      {},
      el("h2", { id: "sheetTitle" }, title),
      el(
        "button.quiet.icon",
        { type: "button", "aria-label": "Close", onclick: () => sheet.close() },
        "×",
      ),
    ),
    ...children,
  );
  if (!sheet.open) sheet.showModal();
  return sheet;
}

/** The last line of a list of files that leaves out older ones of their kind. */
export const olderFiles = (left) =>
  left > 0
    ? [
        el(
          "option",
          { value: "", disabled: true },
          `${left.toLocaleString("en-GB")} older files: by name`,
        ),
      ]
    : [];

/** The id of a tab or of its panel; several places are on the page at once. */
export const tabId = (label, name) => `${label.toLowerCase().replace(/\W+/g, "-")}-tab-${name}`;
export const panelId = (label, name) => `${label.toLowerCase().replace(/\W+/g, "-")}-panel-${name}`;

/** Tabs over panels: one of several buttons is chosen. */
export function tabs(label, choices, choose, panel = null) {
  const buttons = choices.map(([name, words]) =>
    el(
      "button",
      {
        type: "button",
        role: "tab",
        id: tabId(label, name),
        "aria-selected": "false",
        "aria-controls": panel ?? panelId(label, name),
        onclick: () => pick(name),
      },
      words,
    ),
  );
  const list = el("div.tabs", { role: "tablist", "aria-label": label }, buttons);
  list.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = buttons.indexOf(document.activeElement),
      next = buttons[(at + step + buttons.length) % buttons.length];
    next.focus();
    next.click();
  });
  function pick(name) {
    buttons.forEach((button, i) => {
      const on = choices[i][0] === name;
      button.setAttribute("aria-selected", String(on));
      button.tabIndex = on ? 0 : -1;
    });
    choose(name);
  }
  return { list, pick };
}

/** Tabs with a panel for each: entries are [name, words, ...children]; returns the list, the panels
 *  and how to choose one.
 *
 *  @param {string} label
 *  @param {any[][]} entries
 *  @param {{ chosen?: (name: string) => void, scrolls?: boolean }} options */
export function tabbed(label, entries, { chosen = () => {}, scrolls = false } = {}) {
  const panels = entries.map(([name, , ...children]) =>
    el(
      `div.panel${scrolls ? ".scrolls" : ""}`,
      { id: panelId(label, name), role: "tabpanel", "aria-labelledby": tabId(label, name) },
      children,
    ),
  );
  const found = tabs(label, entries, (picked) => {
    panels.forEach((panel, i) => {
      panel.hidden = entries[i][0] !== picked;
    });
    chosen(picked);
  });
  return { ...found, panels };
}

/** A table that scrolls by itself; a row's first cell is its head. */
const LONG = 40; // characters: a longer text is a sentence, which breaks into lines
export function dataTable(label, heads, rows) {
  return el(
    "div.scroll",
    { tabIndex: 0, role: "region", "aria-label": label },
    el(
      "table",
      {},
      el(
        "thead",
        {},
        el(
          "tr",
          {},
          heads.map((words) => el(words ? "th" : "td", words ? { scope: "col" } : {}, words)),
        ),
      ),
      el(
        "tbody",
        {},
        rows.map(([first, ...cells]) =>
          el(
            "tr",
            {},
            el("th", { scope: "row" }, first),
            cells.map((cell) => el(String(cell).length > LONG ? "td.sentence" : "td", {}, cell)),
          ),
        ),
      ),
    ),
  );
}

/** A picture of a symbol: a path in a square of 24. */
export const symbol = (path) =>
  svg(
    "svg",
    { viewBox: "0 0 24 24", "aria-hidden": "true" },
    svg("path", { class: "stroke", d: path }),
  );

/** Digits of a number as Python writes them: a tie, such as 199.25 with four digits, goes to the
 *  even one, where JavaScript takes the larger. `exact` has more digits than a tie. */
function evenly(text, exact) {
  const [digits, more] = [text, exact].map((one) => one.split("e")[0].replace(/[^0-9]/g, ""));
  const tie = /^50*$/.test(more.slice(digits.length)),
    last = text.split("e")[0].length - 1;
  return tie && Number(digits.at(-1)) % 2
    ? `${text.slice(0, last)}${Number(digits.at(-1)) - 1}${text.slice(last + 1)}`
    : text;
}
export const precise = (value, digits) =>
  evenly(value.toPrecision(digits), value.toPrecision(digits + 30));
export const fixed = (value, decimals) =>
  evenly(value.toFixed(decimals), value.toFixed(decimals + 30));

/** A number with so many significant digits, however small it is: .0005 is not 0. */
export function number(value, digits = 4) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value),
    rounded = Number(precise(value, digits));
  if (value !== 0 && (size < 1e-4 || size >= 1e15))
    return rounded.toExponential().replace("e+", "e");
  return rounded.toLocaleString("en-GB", { maximumFractionDigits: 20 });
}

/** A share as percent. What is not nothing is not "0 %", and what is not all is not "100 %". */
export function percent(share) {
  const value = 100 * share,
    plain = fixed(value, 1);
  if (value <= 0 || value >= 100) return `${number(value)} %`;
  if (plain === "0.0") return `${number(value, 2)} %`;
  return `${plain === "100.0" ? number(100 - Number((100 - value).toPrecision(2)), 15) : plain} %`;
}

/** The shape of a map with the names of its sides, as the commands and the film player write it. */
export const shapeText = (shape) =>
  shape
    .map(
      (n, i) =>
        `${n.toLocaleString("en-GB")} ${["layer", "row", "column"].at(i - shape.length)}${n === 1 ? "" : "s"}`,
    )
    .join(" × ");

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "";
  if (seconds < 60) return `${Math.max(1, Math.round(seconds))} s left`;
  return seconds < 3600
    ? `${Math.round(seconds / 60)} min left`
    : `${(seconds / 3600).toFixed(1)} h left`;
}

/** What a job does: its note and how long it lasts still. */
export const progressText = (job) =>
  job.state === "queued"
    ? "waits for a free processor"
    : [job.note, duration(job.left)].filter(Boolean).join(", ");
