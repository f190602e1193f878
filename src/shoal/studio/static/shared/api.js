/* Talking with the server: questions, jobs, files, and the socket that tells of them. */

import { capital, guarded, settled } from "./page.js";

export const state = { start: null, jobs: new Map(), files: [], counts: {} };
const listeners = { job: new Set(), files: new Set() };
const watchers = new Map(); // job number: what is called with each piece, and with the job
let socket = null,
  patience = 500;

/** An answer that says what is wrong, in `error` and at which `field`; as a message of its own, it
 *  names the field. Its cause is what was asked for. */
export class Refused extends Error {
  constructor({ error, field = null, label = null }, cause = null) {
    super(label ? `${capital(label)}: ${error}` : error, { cause });
    Object.assign(this, { error, field });
  }
}

const SILENCE = "no answer";
/** Ask the server; `what` names the request among others of its kind. */
export async function request(method, path, body, what = `${method} ${path.split("?")[0]}`) {
  const json = body !== undefined && !(body instanceof Blob);
  let answer;
  try {
    answer = await fetch(path, {
      method,
      headers: json ? { "content-type": "application/json" } : {},
      body: json ? JSON.stringify(body) : body,
    });
  } catch {
    throw new Refused(
      { error: "The studio does not answer. Is the command shoal studio still running?" },
      SILENCE,
    );
  }
  settled(SILENCE);
  if (!answer.ok) {
    const fault = await answer.json().catch(() => ({}));
    throw new Refused(
      { error: `The studio refused the request (status ${answer.status}).`, ...fault },
      what,
    );
  }
  settled(what);
  return answer.json();
}

export const ask = (what, about) => request("POST", `/api/ask/${what}`, about);
export const addJob = (kind, spec) =>
  request("POST", "/api/jobs", { kind, spec, urgent: true }, `job ${kind}`);
export const cancelJob = (number) =>
  request("DELETE", `/api/jobs/${number}`, undefined, "cancel a job");
export const fileAddress = (name) => `/files/${name.split("/").map(encodeURIComponent).join("/")}`;

export async function upload(file) {
  const { file: name } = await request(
    "PUT",
    `/api/files/${encodeURIComponent(file.name)}`,
    file,
    "upload",
  );
  await loadFiles();
  return name;
}

const PARTS = /\.(shx|dbf|prj|cpg)$/i; // of a Shapefile
export const onlyParts = (files) => files.every((file) => PARTS.test(file.name));

/** Put files into the folder that were brought together, and return the name of the one to open:
 *  the first whose name fits, with the other parts of its Shapefile. */
export async function uploadTogether(files, fits = /./) {
  if (onlyParts(files))
    throw new Refused({
      error: "A Shapefile needs its .shp file: drop all files of the Shapefile together.",
    });
  const shape = files.find((file) => /\.shp$/i.test(file.name));
  const name = await upload(shape ?? files.find((file) => fits.test(file.name)));
  for (const part of shape ? files.filter((file) => PARTS.test(file.name)) : []) {
    const end = part.name.slice(part.name.lastIndexOf(".")).toLowerCase();
    await upload(new File([part], name.replace(/\.shp$/i, end)));
  }
  return name;
}

/** A page of the files of one kind, newest first: those after `skip` newer ones, with `name` in
 *  their names. */
export const listed = (kind, { skip = 0, name = "" } = {}) =>
  request("GET", `/api/files?${new URLSearchParams({ kind, skip: String(skip), name })}`);

/** How many files of one kind are older than those that are listed. */
export const leftOut = (kind) =>
  (state.counts[kind] ?? 0) - state.files.filter((file) => file.kind === kind).length;

/** The newest files of each kind, and how many there are. */
export async function loadFiles() {
  Object.assign(state, await request("GET", "/api/files"));
  listeners.files.forEach((tell) => tell(state.files));
}

export async function begin() {
  state.start = await request("GET", "/api/start");
  state.files = state.start.files;
  state.counts = state.start.counts;
  for (const job of state.start.jobs) state.jobs.set(job.id, job);
  connect();
  return state.start;
}

/** Call back whenever a job changes, or the files do; returns what ends it. */
export function on(what, tell) {
  listeners[what].add(tell);
  return () => listeners[what].delete(tell);
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/live`);
  socket.addEventListener("open", () => {
    patience = 500;
    for (const number of watchers.keys()) socket.send(JSON.stringify({ watch: number }));
  });
  socket.addEventListener("message", (event) => hear(JSON.parse(event.data)));
  socket.addEventListener("close", () => {
    for (const watcher of watchers.values()) watcher.answered = false;
    setTimeout(async () => {
      try {
        const { jobs } = await request("GET", "/api/jobs");
        jobs.forEach(heardOf);
      } catch {
        /* tried again */
      }
      connect();
    }, patience);
    patience = Math.min(8000, 2 * patience);
  });
}

function hear(message) {
  const watcher = watchers.get(message.of);
  if (watcher && message.job) watcher.answered = true;
  if (message.job?.id !== undefined) heardOf(message.job);
  if (message.files) loadFiles().catch(() => {});
  if (!watcher || !message.piece) return;
  // after a break all pieces are told once more; what follows a lost one is of no use
  if (message.nth !== (watcher.seen ?? 0)) return;
  watcher.seen = message.nth + 1;
  watcher.piece?.(message.piece);
}

export const ended = (job) => ["done", "failed", "cancelled", "interrupted"].includes(job.state);

/** A job has changed. Its watcher hears of its end when the studio has answered that it is watched,
 *  with all pieces before: a short job may end earlier. */
function heardOf(job) {
  state.jobs.set(job.id, job);
  listeners.job.forEach((tell) => tell(job));
  const watcher = watchers.get(job.id);
  watcher?.job?.(job);
  if (watcher?.answered && ended(job)) {
    watchers.delete(job.id);
    if (job.state === "done") watcher.done?.(job.result, job);
    else watcher.failed?.(job);
  }
}

/** Queue a job and follow it: `piece`, `job`, `done(result)` and `failed(job)` are called as it
 *  goes. A button, `stop`, cancels it from now on, although the studio has not answered yet. */
export async function run(kind, spec, { stop = null, ...watcher }) {
  const adding = addJob(kind, spec);
  if (stop) stop.onclick = guarded(async () => cancelJob((await adding).id));
  const job = await adding;
  watchers.set(job.id, watcher);
  heardOf(state.jobs.get(job.id) ?? job);
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ watch: job.id }));
  return job;
}

/** Stop following a job, which goes on. */
export const forget = (number) => watchers.delete(number);

/** Return a function that asks with the newest arguments only: while an answer is awaited, all
 *  but the last call are dropped. */
export function newest(work) {
  let busy = false,
    next = null;
  return async function call(...given) {
    if (busy) {
      next = given;
      return;
    }
    busy = true;
    try {
      await work(...given);
    } finally {
      busy = false;
      if (next) {
        const again = next;
        next = null;
        call(...again);
      }
    }
  };
}
