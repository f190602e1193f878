/* Drive it yourself: the arrow keys move the swarm, and a ghost shows what a policy did from the
   same start. */
import { run } from "../../shared/api.js";
import { NEED_OPTIONS } from "../../shared/form.js";
import { el, guarded, say, symbol } from "../../shared/page.js";
import { PlayerFrame } from "../../shared/player.js";
import { exports, sayFailed } from "../../shared/share.js";
import { dated } from "../../shared/store.js";

const PAD = [
  ["u", "up", "M12 19V5M6 11l6-6 6 6"],
  ["l", "left", "M19 12H5M11 6l-6 6 6 6"],
  ["r", "right", "M5 12h14M13 6l6 6-6 6"],
  ["d", "down", "M12 5v14M6 13l6 6 6-6"],
  ["i", "in", "M8 8l8 8M16 8l-8 8"],
  ["o", "out", "M12 10a2 2 0 1 0 .01 0z"],
];

const moved = (count) => `${count} ${count === 1 ? "move" : "moves"}`;

export function driving({ names, problem, seed, current, look, view, below }) {
  const frame = new PlayerFrame("swarm", {
    title: "Your swarm: drive it with the arrow keys",
    bare: "driven",
  });
  const rivals = el(
    "select",
    { id: "rival", onchange: () => look({ rival: rivals.value }) },
    names
      .filter((name) => ![...NEED_OPTIONS, "auto"].includes(name))
      .map((name) => el("option", { value: name }, name)),
  );
  const mine = bar("You"),
    theirs = bar("The ghost"),
    verdict = el("p.verdict", { role: "status" }),
    kept = el("div.result", {});
  const pad = el(
    "div.pad",
    { role: "group", "aria-label": "Move the swarm", hidden: true },
    PAD.map(([letter, words, path]) =>
      el(
        "button.tool",
        {
          type: "button",
          "data-letter": letter,
          "aria-label": `Move ${words}`,
          onclick: () => drive?.drive(letter),
        },
        symbol(path),
      ),
    ),
  );
  const go = el("button.main", { type: "button", onclick: guarded(start) }, "Start the race");
  const agedWord = el(
    "p.warning",
    { role: "status", hidden: true },
    "The settings have changed since this race began.",
  );
  const aged = dated(current, frame.element, (fresh) => {
    agedWord.hidden = fresh;
    setBelow();
  });
  /** The photograph under the race, if the race is of the settings that are set. */
  function setBelow() {
    frame.setBelow(aged.fresh ? below() : null);
  }
  let drive = null,
    begun = null,
    rival = null, // the policy, and how its run ended: its status and moves
    mineDone = false,
    races = 0;

  function bar(words) {
    const meter = el("meter", { min: 0, max: 1, value: 0, "aria-label": `${words}: share done` }),
      count = el("b", {}, "0 %");
    return {
      element: el("div.racer", {}, el("span", {}, words), meter, count),
      set(share, note) {
        meter.value = share;
        count.textContent = `${Math.floor(share * 100)} %${note}`;
      },
    };
  }

  async function start() {
    const given = { ...(await problem()), policy: rivals.value };
    const started = seed();
    if (given.slip || given.misplace || given.miss)
      throw new Error("A race has no noise: set slip, misplace and miss to 0.");
    const race = (races += 1); // what comes of an earlier one is not of this one
    aged.is(current());
    verdict.textContent = "";
    kept.replaceChildren();
    begun = drive = null;
    rival = { policy: given.policy };
    mineDone = false;
    let pieces = [];
    const take = (piece) => {
      if (piece.commands !== undefined) drive.ghostMoves(piece.commands, piece.scans);
      show();
    };
    const ended = ({ status, moves }) => {
      if (race !== races) return;
      Object.assign(rival, { status, moves });
      judge();
    };
    await run(
      "play",
      { problem: given, seed: started },
      {
        piece(piece) {
          if (race !== races) return;
          if (piece.begin) {
            begun = { ...piece.begin, policy: "you", scanned: null, live: true, playing: false };
            frame.open(begun).then((inside) => {
              if (race !== races) return;
              drive = inside.shoalDrive(begun, {
                onMove: show,
                onEnd: () => {
                  if (race === races) guarded(finish)(given, started);
                },
              });
              drive.ghost(piece.begin);
              setBelow();
              pieces.forEach(take);
              pieces = null;
              pad.hidden = false;
              for (const button of pad.children)
                button.hidden = !"lurdio"
                  .slice(0, 2 * begun.shape.length)
                  .includes(button.dataset.letter);
              frame.focus();
              show();
            });
          } else if (pieces) pieces.push(piece);
          else take(piece);
        },
        done: ({ report }) => ended(report),
        failed: (job) => {
          ended({ status: job.state, moves: drive?.ghostLength ?? 0 });
          sayFailed(job);
        },
      },
    );
  }

  /** Say who has won, as soon as both have ended. */
  function judge() {
    if (!mineDone) return;
    const { length } = drive,
      { policy, status, moves } = rival;
    const other = !status
      ? "has not ended yet."
      : status !== "complete"
        ? `did not finish: its run ended after ${moved(moves)}. You win.`
        : `needed ${moves}. ${length === moves ? "A draw." : length < moves ? "You win." : "The ghost wins."}`;
    verdict.textContent = `Done in ${moved(length)}; ${policy} ${other}`;
  }

  /** Both at the same move, that of yours. */
  function show() {
    if (!drive) return;
    const at = drive.length;
    mine.set(drive.share(at), `, ${moved(at)}`);
    theirs.set(drive.ghostShare(at), at > drive.ghostLength ? "" : ` at move ${at}`);
  }

  async function finish(given, started) {
    if (mineDone) return;
    mineDone = true;
    judge();
    const { letters } = drive;
    const {
      policy,
      budget,
      max_moves: most,
      time_per_move: time,
      scan_every: scans,
      ...rest
    } = given; // what limits the policy is none of yours
    await run(
      "play",
      { problem: { ...rest, policy: `manual:${letters}` }, seed: started },
      {
        done: ({ file }) => {
          kept.replaceChildren(exports(file));
          say(`Your race is saved as ${file}`);
        },
        failed: sayFailed,
      },
    );
  }

  const element = el(
    "div.race",
    {},
    el(
      "div.stageHead",
      {},
      el("label", { htmlFor: "rival" }, "Against"),
      rivals,
      go,
      mine.element,
      theirs.element,
    ),
    agedWord,
    verdict,
    kept,
    frame.element,
    el(
      "p.empty",
      {},
      "Press Start the race: your swarm and the swarm of the policy start in the same cells.",
    ),
    pad,
    el(
      "p.soft.hintline",
      {},
      "Arrow keys move all particles at once (Page up and Page down: in and out). The violet ghosts show the particles of the policy after as many moves as yours.",
    ),
  );
  const revive = () => {
    if (view().rival) rivals.value = view().rival;
  };
  return {
    element,
    start,
    refresh: () => aged.refresh(),
    setBelow,
    revive,
    look: () => (aged.fresh ? frame.look() : undefined),
    lookAt: (view) => aged.fresh && frame.lookAt(view),
  };
}
