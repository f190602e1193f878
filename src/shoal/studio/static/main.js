/* The studio: places, theme, jobs, links to a state. */
import { begin, cancelJob, ended, fileAddress, on, state } from "./shared/api.js";
import { showKeys } from "./shared/keys.js";
import { duration, el, guarded, say, told } from "./shared/page.js";
import { failure } from "./shared/share.js";
import { lab } from "./places/lab.js";
import { papers } from "./places/papers.js";
import { search } from "./places/search.js";
import { steering } from "./places/steering.js";
import { vessels } from "./places/vessels.js";
import { welcome } from "./places/welcome.js";

const PLACES = {
  start: ["Start", welcome],
  vessels: ["Vessels", vessels],
  steering: ["Steering", steering],
  search: ["Search", search],
  lab: ["Lab", lab],
  papers: ["Papers", papers],
};
const opened = new Map();
/** @returns {any} the element of this id */
const $ = (id) => document.getElementById(id);

// ---- theme ----

function wear(theme) {
  document.documentElement.dataset.theme = theme;
  $("themeButton").setAttribute("aria-pressed", String(theme === "dark"));
  document.dispatchEvent(new Event("shoal-theme"));
}
const dark = matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", (event) => wear(event.matches ? "dark" : "light"));
$("themeButton").addEventListener("click", () =>
  wear(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
);
wear(dark.matches ? "dark" : "light");

// ---- places, and links to their state ----

/** What each place shows, as its part of the address. */
const known = new Map();
const addressOf = (place, what) => `#${place}?${encodeURIComponent(JSON.stringify(what))}`;

/** What the places had before a reload: their parts of the address and their stores. */
const SESSION = "shoal-places";
function before() {
  const [{ type: how }] = /** @type {PerformanceNavigationTiming[]} */ (
    performance.getEntriesByType("navigation")
  );
  try {
    return how === "reload" ? (JSON.parse(sessionStorage.getItem(SESSION)) ?? {}) : {};
  } catch {
    return {};
  }
}
const session = before();
for (const [place, { address }] of Object.entries(session)) if (address) known.set(place, address);
addEventListener("pagehide", () => {
  const kept = { ...session };
  for (const [place, { store }] of opened)
    kept[place] = { address: known.get(place), store: store?.text ? store.saved() : null };
  try {
    sessionStorage.setItem(SESSION, JSON.stringify(kept));
  } catch {
    try {
      // a browser without room for the steps
      for (const one of Object.values(kept))
        if (one.store) Object.assign(one.store, { done: [], undone: [] });
      sessionStorage.setItem(SESSION, JSON.stringify(kept));
    } catch {
      /* nor for the states: the address has them */
    }
  }
});

/** The address says what is shown: the place, and after a question mark its state as JSON. */
function readAddress() {
  const [place, given] = location.hash.slice(1).split(/\?(.*)/s);
  let told_ = null;
  try {
    told_ = given ? JSON.parse(decodeURIComponent(given)) : null;
  } catch {
    /* a damaged link opens the place as it begins */
  }
  return [Object.hasOwn(PLACES, place) ? place : "start", told_];
}

let here = null;
/** The address mirrors what the place shows. */
const remember = (place) => (what) => {
  known.set(place, JSON.stringify(what));
  if (place === here) history.replaceState(null, "", addressOf(place, what));
};

/** A place that is left stays on the page, with its panels hidden: a frame that leaves the page
 *  would lose its player. */
function setAway(element, away) {
  element.hidden = away;
  for (const panel of element.querySelectorAll(away ? ".panel:not([hidden])" : ".panel.away")) {
    panel.hidden = away;
    panel.classList.toggle("away", away);
  }
}

const show = guarded(async () => {
  const [place, given] = readAddress();
  here = place;
  const saved = opened.has(place) ? null : session[place];
  if (!opened.has(place)) {
    opened.set(place, PLACES[place][1]({ remember: remember(place) }));
    $("place").append(opened.get(place).element);
  }
  const room = opened.get(place),
    kept = known.get(place),
    same = kept !== undefined && (given === null || JSON.stringify(given) === kept);
  for (const one of opened.values()) setAway(one.element, one !== room);
  document.title = `${room.title} – Shoal studio`;
  for (const link of $("places").children) {
    if (link.dataset.place === place) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  if (same) history.replaceState(null, "", addressOf(place, JSON.parse(kept)));
  if (same && saved?.store && room.revive) await room.revive(saved.store);
  else await room.open(same && !saved ? null : same ? JSON.parse(kept) : given);
  if (!same && given?.run) await room.run();
});

// ---- undo, in every place that has it ----

const unedited = new WeakMap(); // of fields that are being edited: their text before
document.addEventListener("beforeinput", ({ target }) => {
  if (target && "value" in target && !unedited.has(target)) unedited.set(target, target.value);
});
document.addEventListener("change", (event) => {
  unedited.delete(event.target);
  opened.get(here)?.store?.end();
});
/** Whether letters are being typed that nothing has taken up yet: the browser takes them back. */
const typing = (field) => unedited.has(field) && field.value !== unedited.get(field);
/** Say that a field has changed if the browser did not: Firefox compares the text with that at the
 *  focus, even if the page has set another one since. */
const takeUp = (field) => {
  if (typing(field)) field.dispatchEvent(new Event("change", { bubbles: true }));
  unedited.delete(field);
};
document.addEventListener("focusout", (event) => takeUp(event.target));
document.addEventListener("keydown", ({ key, target }) => {
  // after what the browser does at this key
  if (key === "Enter" && target instanceof HTMLInputElement) setTimeout(() => takeUp(target));
});

document.addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase(),
    past = opened.get(here)?.store;
  if (
    !past ||
    !(event.ctrlKey || event.metaKey) ||
    event.altKey ||
    !["z", "y"].includes(key) ||
    $("sheet").open ||
    typing(event.target)
  )
    return;
  event.preventDefault();
  if (key === "y" || event.shiftKey) past.redo();
  else past.undo();
  unedited.delete(document.activeElement);
});

// ---- keys ----

const writes = (field) => field.matches?.("input, select, textarea, [contenteditable]");

document.addEventListener("keydown", (event) => {
  if ($("sheet").open || event.altKey) return;
  if ((event.ctrlKey || event.metaKey) && event.key === "Enter") {
    event.preventDefault();
    commitField();
    opened.get(here)?.element.querySelector(".bottom .main:not([hidden], :disabled)")?.click();
    return;
  }
  if (event.ctrlKey || event.metaKey || writes(event.target)) return;
  const place = Object.keys(PLACES)[Number(event.key) - 1];
  if (event.key === "?") showKeys();
  else if (place) location.hash = place;
  else return;
  event.preventDefault();
});
$("keysButton").addEventListener("click", showKeys);

/** What is typed counts, although its field still has the focus. */
function commitField() {
  const field = /** @type {HTMLElement} */ (document.activeElement);
  if (!writes(field)) return;
  field.blur();
  field.focus();
}

// ---- jobs ----

/** Where the result of a job is looked at. */
const placeOf = ({ kind, spec }) =>
  ({ compare: "vessels", missions: "search", sweep: "lab", table: "lab", reproduce: "papers" })[
    kind
  ] ?? { swarm: "vessels", steering: "steering", search: "search" }[spec.problem?.kind];

const running = new Set(); // jobs that were seen before they ended
/** A job that ends while its page is not looked at says so. */
function notify(job) {
  if (!ended(job)) running.add(job.id);
  else if (running.delete(job.id) && job.state === "done") {
    const place = placeOf(job);
    if (place && (place !== here || document.hidden))
      say(`${WORDS[job.kind]} ${nameOf(job)} is done.`, { link: `#${place}` });
  }
}

const WORDS = {
  play: "Episode",
  compare: "Comparison",
  export: "Export",
  reproduce: "Figure of a paper",
  missions: "Missions",
  sweep: "Sweep",
  table: "Table",
};
const STATES = {
  queued: "waits",
  running: "runs",
  done: "done",
  failed: "failed",
  cancelled: "cancelled",
  interrupted: "interrupted",
};

const MOST_JOBS = 60; // in the list

function drawJobs() {
  const jobs = [...state.jobs.values()].sort(
      (a, b) => Number(ended(a)) - Number(ended(b)) || b.id - a.id,
    ),
    open = jobs.filter((job) => !ended(job)).length;
  // jobs are numbered, and none is ever removed
  const all = jobs.reduce((most, job) => Math.max(most, job.id), 0);
  $("busy").hidden = !open;
  $("jobsWord").textContent = open ? `${open} ${open === 1 ? "job" : "jobs"}` : "Jobs";
  if ($("jobs").hidden) return;
  $("jobs").replaceChildren(
    el("h2", {}, "Jobs"),
    ...(jobs.length
      ? [
          el("ul", {}, jobs.slice(0, MOST_JOBS).map(row)),
          all > MOST_JOBS
            ? el("p.soft", {}, `The newest ${MOST_JOBS} of ${all.toLocaleString("en-GB")} jobs.`)
            : "",
        ]
      : [el("p.soft", {}, "No job has run in this folder yet.")]),
  );
}

function nameOf({ spec }) {
  const { problem = {} } = spec;
  const what =
    problem.map ??
    problem.workspace ??
    problem.region ??
    spec.episode ??
    spec.name ??
    spec.sweep ??
    "";
  return typeof what === "string" ? what : "";
}

function row(job) {
  const facts = [STATES[job.state], job.note, duration(job.left)].filter(Boolean).join(", ");
  return el(
    `li.job.${job.state}`,
    {},
    el("div", {}, el("b", {}, WORDS[job.kind] ?? job.kind), " ", el("span", {}, nameOf(job))),
    el("p.soft", {}, job.state === "failed" ? failure(job) : facts),
    job.state === "running"
      ? el("progress", { max: 1, value: job.done ?? 0, "aria-label": "Done" })
      : [],
    job.result?.file
      ? el("a", { href: fileAddress(job.result.file), download: "" }, job.result.file)
      : [],
    ended(job)
      ? []
      : el(
          "button.second.small",
          { type: "button", onclick: guarded(() => cancelJob(job.id)) },
          "Cancel",
        ),
  );
}

let drawing = 0;
on("job", (job) => {
  notify(job);
  drawing ||= requestAnimationFrame(() => {
    drawing = 0;
    drawJobs();
  });
});

function toggleJobs(on_ = $("jobs").hidden) {
  $("jobs").hidden = !on_;
  $("jobsButton").setAttribute("aria-expanded", String(on_));
  drawJobs();
}
$("jobsButton").addEventListener("click", () => toggleJobs());
document.addEventListener("keydown", (event) => {
  /** @type {HTMLDetailsElement} */
  const form = opened.get(here)?.element.querySelector("details.by[open]");
  if (event.key === "Escape" && form && $("jobs").hidden) {
    form.open = false;
    form.querySelector("summary").focus();
  }
  if (event.key === "Escape" && !$("jobs").hidden) {
    toggleJobs(false);
    $("jobsButton").focus();
  }
});

// ---- begin ----

try {
  const start = await begin();
  $("folder").textContent = start.folder;
  $("places").replaceChildren(
    ...Object.entries(PLACES).map(([place, [words]]) =>
      el("a", { href: `#${place}`, "data-place": place }, words),
    ),
  );
  addEventListener("hashchange", show);
  drawJobs();
  await show();
  document.body.dataset.ready = "yes";
} catch (error) {
  told(error);
}
