/* What searches: a preset or a file, and what differs from it; or no vehicle: then a plan has the
   time of the search alone. */
import { on, state } from "../../shared/api.js";
import { fieldRow, makeForm } from "../../shared/form.js";
import { el } from "../../shared/page.js";

const SECTIONS = [
  { title: "Vehicle", open: true, fields: ["preset", "altitude", "cruise_speed", "endurance"] },
  {
    title: "Camera or detector",
    fields: [
      "detector_width",
      "sensor_width",
      "sensor_height",
      "focal_length",
      "image_width",
      "image_height",
      "side_overlap",
      "front_overlap",
      "gimbal_pitch",
      "yaw",
    ],
  },
  {
    title: "Climbs, turns, wind and battery",
    fields: [
      "climb_speed",
      "sink_speed",
      "acceleration",
      "turn_time",
      "turn_radius",
      "acceptance_radius",
      "wind_speed",
      "wind_from",
      "reserve",
      "recharge",
    ],
  },
];

const NONE = "";

export function vehicleForm(changed) {
  const schema = state.start.schemas.vehicle,
    files = el("select", {
      id: "vehicleFile",
      onchange: () => {
        usual();
        changed("file");
      },
    });
  const before = fieldRow(
    "file",
    "from a file",
    { id: "vehicleFile", element: files },
    "A .toml or .json file in the folder. The settings below replace fields of the file.",
  );
  const form = makeForm(
    schema,
    [{ ...SECTIONS[0], before: [before.element] }, ...SECTIONS.slice(1)],
    {
      label: "Settings of the vehicle",
      changed: (_, name) => {
        if (name === "preset") usual();
        changed(name);
      },
    },
  );

  const { input: preset } = form.row("preset");
  preset.prepend(el("option", { value: NONE }, "none: time of the search alone"));

  function listFiles(wanted = files.value) {
    const found = state.files
      .filter(
        (file) =>
          /\.(toml|json)$/i.test(file.name) && !/\.(episode|comparison)\.json$/.test(file.name),
      )
      .map((file) => file.name);
    if (wanted && !found.includes(wanted)) found.unshift(wanted);
    files.replaceChildren(
      el("option", { value: "" }, "none: the preset"),
      ...found.map((name) => el("option", { value: name }, name)),
    );
    files.value = wanted;
  }

  const none = () => !files.value && preset.value === NONE;

  /** What a preset has stands in its empty fields; without a vehicle there are none. */
  function usual() {
    const own = files.value ? {} : (schema.presets[form.row("preset").read()] ?? {}),
      names = Object.keys(schema.properties);
    form.show(names, !none());
    form.show(["preset"], !files.value);
    for (const section of form.element.querySelectorAll("details.section:not(:first-child)"))
      section.hidden = none();
    for (const name of names) {
      const input = form.element.querySelector(`[data-field="${name}"] input[type=number]`);
      if (input) input.placeholder = own[name] ?? (files.value ? "from the file" : "none");
    }
  }

  on("files", () => listFiles());
  listFiles("");
  usual();
  return {
    element: form.element,
    form,
    file: before,
    value() {
      if (none()) return undefined;
      const { preset, ...others } = form.values(),
        changes = Object.entries(others).map(([name, value]) => `${name}=${value}`);
      return files.value
        ? [files.value, ...changes].join(",")
        : { preset: form.row("preset").read(), ...others };
    },
    write(given) {
      const [file, ...changes] = typeof given === "string" ? given.split(",") : [""],
        known = Object.hasOwn(schema.presets, file);
      form.write(
        typeof given === "string"
          ? {
              ...(known ? { preset: file } : {}),
              ...Object.fromEntries(
                changes
                  .map((word) => word.split("="))
                  .map(([name, value]) => [
                    name,
                    Number.isFinite(Number(value)) ? Number(value) : value,
                  ]),
              ),
            }
          : (given ?? {}),
      );
      if (!given) preset.value = NONE;
      listFiles(known ? "" : file);
      usual();
    },
  };
}
