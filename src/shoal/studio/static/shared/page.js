/* Making elements, saying things, dialogs. Text is only ever set as text. */

/** Make an element: `el("p.soft", { id: "x" }, "text", child, ...)`. */
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
  made.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return made;
}

const SVG = "http://www.w3.org/2000/svg";
export function svg(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.flat());
  return made;
}

/** Say something for a while; a problem stays until it is closed. */
export function say(sentence, { problem = false } = {}) {
  const note = el(problem ? "p.note.bad" : "p.note", {}, el("span", {}, sentence));
  const close = () => note.remove();
  note.append(el("button.quiet.icon", { type: "button", onclick: close, "aria-label": "Close" }, "×"));
  document.getElementById("notes").append(note);
  while (document.getElementById("notes").children.length > 3) document.getElementById("notes").firstChild.remove();
  if (!problem) setTimeout(close, 6000);
}

export const told = (error) => say(error.message ?? String(error), { problem: true });

/** Return a handler that says what goes wrong in it. */
export const guarded = (work) => async (...given) => {
  try {
    return await work(...given);
  } catch (error) {
    told(error);
    return undefined;
  }
};

export function openSheet(title, ...children) {
  const sheet = document.getElementById("sheet");
  sheet.replaceChildren(
    el("div.sheetHead", {}, el("h2", { id: "sheetTitle" }, title),
      el("button.quiet.icon", { type: "button", "aria-label": "Close", onclick: () => sheet.close() }, "×")),
    ...children,
  );
  if (!sheet.open) sheet.showModal();
  return sheet;
}

/** Tabs over panels: one of several buttons is chosen. */
export function tabs(label, choices, choose, panel = null) {
  const buttons = choices.map(([name, words]) => el("button", {
    type: "button", role: "tab", id: `tab-${name}`, "aria-selected": "false", "aria-controls": panel ?? `panel-${name}`, onclick: () => pick(name),
  }, words));
  const list = el("div.tabs", { role: "tablist", "aria-label": label }, buttons);
  list.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = buttons.indexOf(document.activeElement), next = buttons[(at + step + buttons.length) % buttons.length];
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

/** Tabs with a panel for each: entries are [name, words, ...children]; returns the list, the panels and how to choose one. */
export function tabbed(label, entries, { chosen = () => {}, scrolls = false } = {}) {
  const panels = entries.map(([name, , ...children]) => el(`div.panel${scrolls ? ".scrolls" : ""}`, { id: `panel-${name}`, role: "tabpanel", "aria-labelledby": `tab-${name}` }, children));
  const found = tabs(label, entries, (picked) => {
    panels.forEach((panel, i) => { panel.hidden = entries[i][0] !== picked; });
    chosen(picked);
  });
  return { ...found, panels };
}

/** A table that scrolls by itself; a row's first cell is its head. */
export function dataTable(label, heads, rows) {
  return el("div.scroll", { tabIndex: 0, role: "region", "aria-label": label }, el("table", {},
    el("thead", {}, el("tr", {}, heads.map((words) => el(words ? "th" : "td", words ? { scope: "col" } : {}, words)))),
    el("tbody", {}, rows.map(([first, ...cells]) => el("tr", {}, el("th", { scope: "row" }, first), cells.map((cell) => el("td", {}, cell)))))));
}

/** A picture of a symbol: a path in a square of 24. */
export const symbol = (path) => svg("svg", { viewBox: "0 0 24 24", "aria-hidden": "true" }, svg("path", { class: "stroke", d: path }));

export const number = (value, digits = 4) => (value === null || value === undefined ? "–" : Number(value.toPrecision(digits)).toLocaleString("en-GB"));

/** The shape of a map with the names of its sides, as the commands and the film player write it. */
export const shapeText = (shape) =>
  shape.map((n, i) => `${n.toLocaleString("en-GB")} ${["layer", "row", "column"].at(i - shape.length)}${n === 1 ? "" : "s"}`).join(" × ");

export function duration(seconds) {
  if (seconds === null || seconds === undefined) return "";
  if (seconds < 60) return `${Math.max(1, Math.round(seconds))} s left`;
  return seconds < 3600 ? `${Math.round(seconds / 60)} min left` : `${(seconds / 3600).toFixed(1)} h left`;
}
