/* Run: the episode in the player, move by move as it is computed, and earlier episodes of the
   folder. */
import { ask, leftOut, on, run, state } from "../../shared/api.js";
import { el, guarded, number, progressText, say } from "../../shared/page.js";
import { PlayerFrame } from "../../shared/player.js";
import { exports, sayFailed } from "../../shared/share.js";
import { dated } from "../../shared/store.js";

const PRESS = "Press Run to watch the swarm here, move by move.";
const BEGINS = "The studio opens the map and chooses the first moves …";
const MOST_LISTED = 200; // episodes to choose from at once; the Lab has all
const ALL = "all of them";
const OF_LAB = `#lab?${encodeURIComponent(JSON.stringify({ tab: "episodes" }))}`;

/** `problem()` gives the problem with painted cells in a file; `open()` shows this panel. */
export function running({ store, problem, open, below }) {
  const frame = new PlayerFrame("swarm", { title: "The player of the episode" });
  const word = el("p.soft", { role: "status" }),
    result = el("div.result", {});
  const bar = el("progress", { max: 1, value: 0, hidden: true, "aria-label": "Played" });
  const go = el("button.main", { type: "button", onclick: guarded(play) }, "Run");
  const stop = el("button.second.stop", { type: "button", hidden: true }, "Stop");
  const empty = el("p.empty", {}, PRESS);
  let turns = 0; // of what is on the stage
  let shown = null; // the episode on the stage: its file and its sentence

  /** What is on the stage says so if it is of other settings than those that are set now. */
  const dates = dated(
    () => store.text,
    frame.element,
    (fresh) => {
      setBelow();
      const began = "The settings have changed since this run began.";
      if (!shown) result.replaceChildren(...(fresh ? [] : [el("p.soft", {}, began)]));
      else {
        const since = "the settings have changed since. Run plays them as they are now.";
        result.replaceChildren(
          el("p", {}, shown.sentence),
          fresh ? "" : el("p.soft", {}, `${shown.file}: ${since}`),
          exports(shown.file, { fresh }),
        );
      }
    },
  );

  /** The photograph under the player, if what is played is of the settings that are set. */
  function setBelow() {
    frame.setBelow(dates.fresh ? below() : null);
  }

  function showResult(file, sentence, at) {
    shown = { file, sentence };
    store.look({ file, at });
    dates.is(at);
  }

  /** Show an episode of the folder, made or opened with the settings `at`. */
  async function show(file, at) {
    const turn = (turns += 1),
      { data, sentence } = await ask("page", { file });
    if (turn !== turns) return;
    await frame.open(data);
    showResult(file, sentence, at);
  }

  async function play() {
    const asked = performance.now(),
      given = await problem(),
      at = store.text;
    const turn = (turns += 1),
      here = () => turn === turns; // else another one is on the stage
    open();
    result.replaceChildren();
    shown = null;
    dates.is(at);
    let inside = null,
      opening = null,
      whole = false, // whether the last piece has come
      waiting = [];
    const take = (piece) => {
      if (piece.commands !== undefined) inside.shoalPlayer?.grow(piece.commands, piece.scans);
      if (piece.end === undefined) return;
      whole = true;
      inside.shoalPlayer?.end(piece.end, piece.unreachable);
    };
    const begin = async (data) => {
      inside = await frame.open({ ...data, live: true, playing: true });
      setBelow();
      performance.measure("shoal-first-frame", { start: asked });
      waiting.forEach(take);
      waiting = [];
    };
    go.disabled = true;
    stop.hidden = bar.hidden = false;
    empty.textContent = BEGINS;
    await run(
      "play",
      { problem: given, seed: JSON.parse(at).seed },
      {
        stop,
        piece(piece) {
          if (!here()) return;
          if (piece.begin) opening = begin(piece.begin);
          else if (inside) take(piece);
          else waiting.push(piece);
        },
        job: (now) => {
          bar.value = now.done ?? 0;
          word.textContent = progressText(now);
        },
        done: guarded(async ({ file, sentence }) => {
          finish();
          await opening;
          if (!here()) return say(`The run is saved as ${file}`);
          if (!whole) await frame.open((await ask("page", { file })).data);
          return showResult(file, sentence, at);
        }),
        failed: (now) => {
          finish();
          if (now.state === "cancelled") {
            inside?.shoalPlayer?.end("interrupted");
            return;
          }
          if (here()) dates.is(null);
          sayFailed(now);
        },
      },
    ).catch((error) => {
      finish();
      throw error;
    });
  }

  function finish() {
    go.disabled = false;
    empty.textContent = PRESS;
    stop.hidden = bar.hidden = true;
    word.textContent = "";
  }

  const episodes = el("select", {
    "aria-label": "Episodes of the folder",
    onchange: guarded(async () => {
      const file = episodes.value;
      episodes.value = "";
      if (file === ALL) location.hash = OF_LAB;
      else if (file) await show(file, store.text);
    }),
  });
  function list() {
    const found = state.files.filter((file) => file.name.endsWith(".npz"));
    const listed = found.slice(0, MOST_LISTED);
    const others = leftOut("episode") + found.length - listed.length;
    const more = `${number(others, 9)} older ones: in the Lab …`;
    episodes.replaceChildren(
      el("option", { value: "" }, found.length ? "open an earlier episode" : "no episode yet"),
      ...listed.map((file) => el("option", { value: file.name }, file.name)),
      ...(others > 0 ? [el("option", { value: ALL }, more)] : []),
    );
  }
  on("files", list);
  list();
  frame.element.addEventListener(
    "load",
    () => {
      empty.hidden = !!frame.shown;
    },
    true,
  );

  return {
    go,
    play,
    stop,
    word,
    bar,
    children: [el("div.stageHead", {}, result, episodes), frame.element, empty],
    refresh: () => dates.refresh(),
    setBelow,
    look: () => (dates.fresh ? frame.look() : undefined),
    lookAt: (view) => dates.fresh && frame.lookAt(view),
    show: guarded(show),
    /** The file of the episode on the stage, if it is of the settings that are set. */
    get current() {
      return shown && dates.fresh ? shown.file : null;
    },
  };
}
