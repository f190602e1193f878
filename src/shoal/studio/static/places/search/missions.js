/* Missions: files for vehicles, checked, as a zip. */
import { fileAddress, run, state } from "../../shared/api.js";
import { fieldRow, makeForm } from "../../shared/form.js";
import { dataTable, el, guarded, number, precise, progressText, say } from "../../shared/page.js";
import { sayFailed } from "../../shared/share.js";
import { dated } from "../../shared/store.js";
import { heightProfile } from "./profile.js";
import { lasting } from "./simulate.js";

const SECTIONS = [
  {
    title: "Missions",
    open: true,
    fields: [
      "format",
      "autopilot",
      "separation",
      "delay_tolerance",
      "altitude_frame",
      "terrain",
      "terrain_error",
      "rally",
      "cap",
    ],
  },
];

const MOST_SAID = 50; // mistakes and warnings
const inFiles = ([first, ...more]) => (more.length ? `${first} and ${more.length} more` : first);

/** `current()` is a text of all that missions are made from: results of another one are not current
 *  any more. `lacking()` says what there must be before missions are written; null: nothing. */
export function missionsPanel({ ready, current, lacking, changed, store }) {
  const schema = state.start.schemas.missions;
  // the plan of a search alone, such as that of an episode, has no missions
  const wanted = el("input.switch", {
    type: "checkbox",
    id: "missionsWanted",
    checked: true,
    onchange: () => changed(null, "wanted"),
  });
  const { element: first } = fieldRow(
    "wanted",
    "plan for missions",
    { id: wanted.id, element: wanted },
    "The plan has the margin, reserve and start times of missions.",
    { inline: true },
  );
  const form = makeForm(
    schema,
    SECTIONS.map((section) => ({ ...section, before: [first] })),
    { label: "Settings of missions", changed },
  );
  const word = el("p.soft", { role: "status" }),
    bar = el("progress", { max: 1, hidden: true, "aria-label": "Done" });
  const go = el("button.main", { type: "button", onclick: guarded(start) }, "Write missions");
  const stop = el("button.second", { type: "button", hidden: true }, "Cancel");
  const result = el("div.missions", {}),
    empty = el(
      "p.empty",
      {},
      `Press Write missions: the studio writes files in the chosen formats (${schema.properties.format.names.join(", ")}), and checks them in a simulated flight.`,
    );

  let last = null; // what was written
  const dates = dated(current, result, (fresh) => {
    go.className = fresh ? "second" : "main";
    if (fresh) show(last);
    else
      result.replaceChildren(
        el(
          "p.warning",
          {},
          `The settings have changed since ${last.file} was written, so its missions are not shown here. Write the missions again.`,
        ),
      );
  });
  function take(found, of) {
    last = found;
    store.look({ missions: { found, of } });
    dates.is(of);
  }

  async function start() {
    const why = lacking();
    if (why) return say(why);
    const of = current(),
      { seed, missions } = JSON.parse(of),
      problem = await ready();
    go.disabled = true;
    bar.hidden = stop.hidden = false;
    const free = () => {
      go.disabled = false;
      bar.hidden = stop.hidden = true;
      word.textContent = "";
    };
    await run(
      "missions",
      { problem, missions, seed },
      {
        stop,
        job: (now) => {
          bar.value = now.done ?? 0;
          word.textContent = progressText(now);
        },
        done: (found) => {
          free();
          take(found, of);
        },
        failed: (now) => {
          free();
          if (now.state !== "cancelled") sayFailed(now);
        },
      },
    ).catch((error) => {
      free();
      throw error;
    });
    return undefined;
  }

  function show({ file, map, missions, check, command, profiles = [] }) {
    const near = missions.nearest_approach,
      good = !check.errors && (check.covered_fraction ?? 1) > 0.999;
    const facts = [
      [
        "Seen",
        check.covered_fraction === null
          ? "not measured"
          : `${Number(precise(100 * check.covered_fraction, 6))} %`,
      ],
      [
        "Mistakes",
        `${check.errors}, and ${check.warnings} warning${check.warnings === 1 ? "" : "s"}`,
      ],
      [
        "Nearest approach",
        !missions.separation_m
          ? "no separation required"
          : near
            ? `${number(near.horizontal_m)} m: robots ${near.robots.join(" and ")} after ${lasting(near.time_s)}`
            : `none nearer than ${number(missions.separation_m[1])} m in height`,
      ],
      ["Sorties", String(missions.sorties)],
      ["Waypoints", number(check.waypoints, 9)],
    ];
    // a mission is written in several formats: what is said of all of them is said once
    const said = [
      ...Map.groupBy(check.diagnostics, (one) => one.sentence ?? one.message ?? ""),
    ].map(([sentence, of]) => [sentence, of.map((one) => one.file ?? "")]);
    empty.hidden = true;
    result.replaceChildren(
      el(
        "div.verdictLine",
        {},
        el(
          `span.verdictChip.${good ? "agrees" : "differs"}`,
          {},
          good ? "checked: no mistakes found" : "checked: mistakes are listed below",
        ),
        el("a.main.download", { href: fileAddress(file), download: file }, "Download the zip"),
        el("span.soft", {}, file),
      ),
      el(
        "dl.measures",
        {},
        facts.map(([term, value]) => el("div", {}, el("dt", {}, term), el("dd", {}, value))),
      ),
      said.length
        ? dataTable(
            "Mistakes and warnings",
            ["File", "What"],
            said.slice(0, MOST_SAID).map(([sentence, files]) => [inFiles(files), sentence]),
          )
        : [],
      said.length > MOST_SAID
        ? el(
            "p.soft",
            {},
            `The first ${MOST_SAID} of ${number(said.length, 9)}: the file check.json in the zip has all.`,
          )
        : [],
      el(
        "figure.missionMap",
        {},
        el("img", {
          src: `${fileAddress(map)}?${Date.now()}`,
          alt: "Map of the missions: paths of the robots, launch points, holes, zones, fence",
        }),
      ),
      profiles.length ? heightProfile(profiles, near) : [],
      dataTable(
        "Sorties",
        ["Robot", "Sortie", "Sets out after", "Altitude"],
        missions.starts.map((one) => [
          String(one.robot),
          String(one.sortie),
          lasting(one.start_s),
          `${number(one.altitude_m)} m`,
        ]),
      ),
      el("p.soft", {}, "The same in a terminal"),
      el("pre.code", { tabIndex: 0 }, command),
    );
  }

  return {
    form,
    /** The settings of missions; null for a plan without them. */
    value: () => (wanted.checked ? form.values() : null),
    write(given) {
      wanted.checked = given !== null;
      form.write(given ?? {});
    },
    refresh: () => dates.refresh(),
    /** Missions that were written before, of the settings that are set. */
    open: (found) => take(found, current()),
    revive() {
      const { missions } = store.view;
      if (missions) take(missions.found, missions.of);
    },
    children: [el("div.stageHead", {}, go, stop, bar, word), result, empty],
  };
}
