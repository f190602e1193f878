/* Taking it along: a problem as Python, command and file; an episode as figure, film, page and
 * file. */
import { Refused, ask, ended, fileAddress, run } from "./api.js";
import { el, guarded, openSheet, say, tabs, told } from "./page.js";

const WAYS = [
  ["python", "As Python"],
  ["command", "As command"],
  ["file", "As file"],
];
const HOW = {
  python: "Save the text as a script, and run the script in this folder.",
  command: "Enter the command in a terminal, in this folder.",
  file: "Commands take this file in place of a map, workspace or region.",
};
const FORMATS = [
  ["png", "Figure", "PNG"],
  ["svg", "Figure", "SVG"],
  ["pdf", "Figure", "PDF"],
  ["mp4", "Film", "MP4"],
  ["gif", "Film", "GIF"],
  ["html", "Player page", "HTML"],
];

/** What to do with the forms of a sweep. */
export const HOW_OF_SWEEP = { ...HOW, file: "The command shoal sweep run takes this file." };

/** The page of each part. */
export const PLACES = { swarm: "vessels", steering: "steering", search: "search" };

/** The address of a place with a problem and its seed, and what else there is of `more`: what was
 *  drawn, the settings of missions. */
export const placeOf = (kind, problem, seed, more = {}) => {
  const state = JSON.stringify({ problem, seed, ...more });
  return `#${PLACES[kind]}?${encodeURIComponent(state)}`;
};

const saving = (problem, seed) =>
  el(
    "button.second",
    {
      type: "button",
      onclick: guarded(async () => {
        const { file } = await ask("save", { problem, seed });
        say(`Written into the folder: ${file}`);
      }),
    },
    "Write the file into the folder",
  );

/** Show a problem as Python, as a command and as a file, ready to copy; a search with the settings
 *  of its `missions`. */
export const showCopies = guarded(async (problem, seed, missions = null) => {
  showForms(await ask("copies", { problem, seed, missions, slow: missions !== null }), {
    more: saving(problem, seed),
    about: "The settings of this page.",
  });
});

/** The same for an episode of the folder: its own problem and seed, whatever the form says. */
export const showCopiesOf = guarded(async (file) => {
  const copies = await ask("copies", { file }),
    { problem, seed } = copies;
  const link = `${location.origin}${location.pathname}${placeOf(problem.kind, problem, seed)}`;
  showForms(copies, { more: saving(problem, seed), about: `The episode ${file}.`, link });
});

/** Show something in its three forms: `about` says what it is, `more` are further buttons,
 *  `link` is its address, and `how` tells what to do with each form. */
export function showForms(copies, { more = [], about = "", link = location.href, how = HOW } = {}) {
  const text = el("pre.code", { tabIndex: 0, "aria-label": "Text to copy" }),
    advice = el("p.help", {});
  let shown = "python";
  const choice = tabs(
    "Form of the copy",
    WAYS,
    (name) => {
      shown = name;
      text.textContent = copies[name];
      advice.textContent = [
        about,
        how[name],
        name === "file" && copies.beside ? `With the file, add ${copies.beside}.` : "",
      ]
        .join(" ")
        .trim();
    },
    "panel-copies",
  );
  openSheet(
    "The same result elsewhere",
    choice.list,
    el("div", { id: "panel-copies", role: "tabpanel" }, advice, text),
    el(
      "div.actions",
      {},
      el(
        "button.main",
        {
          type: "button",
          onclick: guarded(async () => {
            await copy(copies[shown]);
            say("Copied.");
          }),
        },
        "Copy",
      ),
      more,
      el(
        "button.second",
        {
          type: "button",
          onclick: guarded(async () => {
            await copy(link);
            say("The link opens these settings.");
          }),
        },
        "Copy a link to it",
      ),
    ),
  );
  choice.pick("python");
}

async function copy(text) {
  await navigator.clipboard.writeText(text);
}

/** Ask for a figure as journals want it: its width, the size of its text, and the moment that it
 *  shows. */
function openPrint(episode) {
  const field = (id, words, attributes) => {
    const input = el("input.short", { type: "number", step: "any", id, ...attributes });
    return { input, row: el("div.field", {}, el("label", { htmlFor: id }, words), input) };
  };
  const width = field("printWidth", "Width in mm", { min: 30, max: 1000, value: 85 });
  const text = field("printText", "Size of the text in points", { min: 4, max: 20, value: 8 });
  const at = field("printAt", "Moment: number of moves, or of a search seconds", {
    min: 0,
    placeholder: "the end",
  });
  const spec = () => ({
    episode,
    width: width.input.valueAsNumber,
    font_size: text.input.valueAsNumber,
    ...(at.input.value === "" ? {} : { at: at.input.valueAsNumber }),
  });
  openSheet(
    "A figure for print",
    el(
      "p.help",
      {},
      "Without a heading, and with its caption in a text file beside it. One column of a journal is about 85 mm wide, two are 180 mm.",
    ),
    width.row,
    text.row,
    at.row,
    exportsOf("export", spec, [
      ["pdf", "Figure for print", "PDF"],
      ["svg", "Figure for print", "SVG"],
      ["png", "Figure for print", "PNG"],
    ]),
  );
}

/** Ask for a film as presentations want it: its size, and the frames per second of a video. */
function openFilm(episode) {
  const choice = (id, words, options) => {
    const input = el(
      "select",
      { id },
      options.map(([value, name]) => el("option", { value }, name)),
    );
    return { input, row: el("div.field", {}, el("label", { htmlFor: id }, words), input) };
  };
  const size = choice("filmSize", "Size", [
    ["wide", "wide: 1920 x 1080"],
    ["square", "square: 1080 x 1080"],
  ]);
  const rate = choice("filmRate", "Frames per second of a video", [
    ["30", "30"],
    ["60", "60"],
  ]);
  const shown = () => ({ episode, size: size.input.value });
  const video = exportsOf("export", () => ({ ...shown(), rate: Number(rate.input.value) }), [
    ["mp4", "Film for a talk", "MP4"],
  ]);
  openSheet(
    "A film for a talk",
    el(
      "p.help",
      {},
      "With a title, a scale, moves between cells, the photograph under its map, and a card at the end.",
    ),
    size.row,
    rate.row,
    video,
    exportsOf("export", shown, [["gif", "Film for a talk", "GIF"]]),
  );
}

/** Buttons that export an episode of the folder; one of other settings than those of the page is
 *  named an earlier one. */
export const exports = (episode, { fresh = true } = {}) =>
  exportsOf(
    "export",
    () => ({ episode }),
    FORMATS,
    [
      el(
        "button.chip",
        {
          type: "button",
          title: "A figure for print, at any moment",
          "aria-label": "Figure for print",
          onclick: () => openPrint(episode),
        },
        "For print …",
      ),
      el(
        "button.chip",
        {
          type: "button",
          title: "A film for a talk, wide or square",
          "aria-label": "Film for a talk",
          onclick: () => openFilm(episode),
        },
        "For a talk …",
      ),
      el("a.chip", { href: fileAddress(episode), download: "" }, "Episode"),
      el(
        "button.chip",
        {
          type: "button",
          title: "The script, the command and the problem of this episode",
          "aria-label": "Python script of this episode",
          onclick: () => showCopiesOf(episode),
        },
        "Python",
      ),
    ],
    fresh ? "Export" : "Export the earlier episode",
  );

/** Buttons that write a file each, by a job of that kind; `spec(format)` is what the job is
 *  told. */
export function exportsOf(kind, spec, formats, more = [], words = "Export") {
  const buttons = formats.map(([format, what, word]) => {
    const button = el(
      "button.chip",
      { type: "button", title: `${what} as ${word}`, "aria-label": `${what} as ${word}` },
      word,
    );
    button.addEventListener(
      "click",
      guarded(async () => {
        button.disabled = true;
        button.classList.add("working");
        const free = () => {
          button.disabled = false;
          button.classList.remove("working");
          button.textContent = word;
        };
        try {
          await run(
            kind,
            { ...spec(format), format },
            {
              job: (now) => {
                // a figure is there at once, a film is not
                if (now.done) button.textContent = `${word} ${Math.floor(100 * now.done)} %`;
              },
              done: ({ file }) => {
                free();
                give(file);
              },
              failed: (job) => {
                free();
                sayFailed(job);
              },
            },
          );
        } catch (error) {
          free();
          throw error;
        }
      }),
    );
    return button;
  });
  return el(
    "div.exports",
    { role: "group", "aria-label": words },
    el("span.soft", {}, words),
    buttons,
    more,
  );
}

/** Why a job has no result, in words. */
export const failure = (job) =>
  job.result?.error ? new Refused(job.result).message : `The job was ${job.state}.`;
/** Say so, until another job of its kind begins. */
export const sayFailed = (job) => told(new Error(failure(job)), `job ${job.kind}`);

/** Hand a file of the folder to the browser, and say where it is. */
function give(file) {
  const link = el("a", { href: fileAddress(file), download: file });
  link.click();
  say(`Written into the folder: ${file}`);
}

export { ended };
